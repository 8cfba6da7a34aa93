"""Friction from a Lagrangian, and friction as a force: the Caldirola–Kanai oscillator and a fall
with drag.

Claim: L = e^{γt} (½ m ẋ² − ½ m ω² x²) gives ẍ + γ ẋ + ω² x = 0, the same as F = −γ m ẋ in the
Lagrange–d'Alembert principle; both rules have their full order, and forced and free oscillation
superpose, also at resonance.
Source: Caldirola 1941; Kanai 1948; Landau & Lifshitz, Mechanics, §22, §25.
Run: python examples/damping.py [folder of the picture]
"""

import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import varint as vi

plt.style.use("tableau-colorblind10")


def with_friction(gamma: float) -> vi.System:
    q, v = vi.coordinates("x")
    c = vi.Parameters(omega=1.5, gamma=gamma)
    return vi.System(q, v, (v**2 - c.omega**2 * q**2) / 2, force=-c.gamma * v, params=c)


def main(out: Path = Path("out")) -> None:
    figure, (motions, order, forced) = plt.subplots(1, 3, figsize=(13, 4), layout="constrained")
    for gamma, name in ((0.4, "under-damped"), (3.0, "critical"), (5.0, "over-damped")):
        model = vi.models.caldirola_kanai(gamma=gamma)
        motion = vi.simulate(model.system, vi.gauss(4), **model.start | {"duration": 8.0})
        q, _ = model.exact(motion.t)
        print(f"x(8), {name:14}         found {motion.q[-1, 0]:.12f}   exact {q[-1, 0]:.12f}")
        motions.plot(motion.t, motion.q, label=name)
    motions.set(xlabel="t", ylabel="x", title="Damped by a growing mass")
    motions.legend()

    model = vi.models.caldirola_kanai()
    exact = model.exact(8.0)[0][0, 0]
    steps = np.array([40, 80, 160, 320])
    for system, name in ((model.system, "growing mass"), (with_friction(0.4), "force")):
        for rule in (vi.midpoint(), vi.gauss(2)):
            errors = [
                abs(
                    vi.simulate(system, rule, q0=1.0, v0=-0.5, duration=8.0, steps=int(n)).q[-1, 0]
                    - exact
                )
                for n in steps
            ]
            order.loglog(8.0 / steps, errors, "o-", label=f"{rule}, {name}")
            print(
                f"order of {rule!r:9} {name:12}  found {np.log2(errors[-2] / errors[-1]):.2f}   "
                f"theory {rule.order}"
            )
    order.set_xscale("log", base=2)
    order.set(xlabel="step", ylabel="error at t = 8", title="Two ways to write friction")
    order.legend(fontsize="small")

    fall = vi.models.linear_drag()
    motion = vi.simulate(fall.system, vi.gauss(4), **fall.start)
    print(
        f"speed of fall after 10 s     found {motion.v[-1, 0]:.12f}   exact "
        f"{fall.exact(10.0)[1][0, 0]:.12f}"
    )

    for Omega, name in ((2.3, "Ω = 2.3"), (1.2, "resonance, Ω = ω = 1.2")):
        model = vi.models.forced_oscillator(Omega=Omega)
        motion = vi.simulate(model.system, **model.start)
        q, _ = model.exact(motion.t)
        print(f"x(50), {name:22} found {motion.q[-1, 0]:.8f}   exact {q[-1, 0]:.8f}")
        forced.plot(motion.t, motion.q, lw=0.8, label=name)
    forced.plot(motion.t, 0.7 * motion.t / 2.4, "k--", lw=0.8, label="F t / 2mω")
    forced.set(xlabel="t", ylabel="x", title="Forced oscillator")
    forced.legend(fontsize="small")
    out.mkdir(parents=True, exist_ok=True)
    figure.savefig(out / "damping.png", dpi=120)


if __name__ == "__main__":
    main(Path(sys.argv[1] if sys.argv[1:] else "out"))

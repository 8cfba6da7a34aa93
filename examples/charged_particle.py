"""A charge in electric and magnetic fields, and the freedom of gauge.

Claim: E × B makes it drift, a cycloid from rest; φ → φ + ∂χ/∂t, A → A − ∇χ leaves the path, adds −e
[χ] to the action and −e ∇χ to the momentum: to round-off for linear χ, to the order of the rule for
any other; in B = k/r the orbit is a rosette whose turning angle is known in closed form.
Source: Landau & Lifshitz, The Classical Theory of Fields, §16–18, §22.
Run: python examples/charged_particle.py [folder of the picture]
"""

import sys
from pathlib import Path

import casadi as ca
import matplotlib.pyplot as plt
import numpy as np

import varint as vi

plt.style.use("tableau-colorblind10")


def wavy(q: ca.SX, t: ca.SX) -> ca.SX:
    return 0.3 * q[0] ** 2 * q[1] + 0.5 * ca.sin(q[0] + 2 * q[2]) + 0.25 * t * q[1]


def linear(q: ca.SX, t: ca.SX) -> ca.SX:
    return 0.4 * q[0] - 0.3 * q[1] + 0.2 * q[2] + 0.7 * t


def main(out: Path = Path("out")) -> None:
    figure, (drift, gauge, rosette) = plt.subplots(1, 3, figsize=(13, 4), layout="constrained")
    for speed in (0.0, 0.5, 1.5):
        model = vi.models.uniform_fields(v0=(speed, 0.0, 0.0))
        motion = vi.simulate(model.system, vi.gauss(4), **model.start)
        q, _ = model.exact(motion.t)
        print(
            f"x(20), v₀ = {speed:3.1f}              found {motion.q[-1, 0]:.12f}   exact "
            f"{q[-1, 0]:.12f}"
        )
        drift.plot(motion.q[:600, 0], motion.q[:600, 1], label=f"v₀ = {speed}")
    drift.set(
        xlabel="x", ylabel="y", title="E along y, B along z: drift along x", ylim=(-1.05, 0.85)
    )
    drift.legend(loc="upper center", ncols=3, fontsize="small")

    data = {
        "E": (0.2, -0.1, 0.05),
        "B": (0.0, 0.0, 1.5),
        "q0": (0.3, -0.2, 0.1),
        "v0": (0.7, 0.4, -0.2),
    }
    steps = np.array([25, 50, 100, 200, 400])
    for rule in (vi.midpoint(), vi.gauss(2), vi.gauss(3)):
        for chi, style in ((wavy, "o-"), (linear, "x:")):
            gaps = []
            for count in steps:
                paths = [
                    vi.simulate(m.system, rule, q0=m.q0, v0=m.v0, duration=2.0, steps=int(count)).q
                    for m in (
                        vi.models.uniform_fields(**data),
                        vi.models.uniform_fields(**data, gauge=chi),
                    )
                ]
                gaps.append(np.abs(paths[0] - paths[1]).max() + 1e-17)
            gauge.loglog(2.0 / steps, gaps, style, label=f"{rule}, {chi.__name__} χ")
            if chi is wavy:
                print(
                    f"order of the gap, {rule!r:9}      found {np.log2(gaps[1] / gaps[2]):.2f}   "
                    f"theory {rule.order}"
                )
    gauge.set_xscale("log", base=2)
    gauge.set(
        xlabel="step", ylabel="distance of the paths in two gauges", title="Gauge transformation"
    )
    gauge.set_ylim(top=1)
    gauge.legend(fontsize="x-small", loc="upper center", ncols=2)

    model = vi.models.inverse_distance_field()
    period, angle = vi.models.inverse_distance_period(model.q0, model.v0)
    motion = vi.simulate(
        model.system, vi.gauss(4), q0=model.q0, v0=model.v0, duration=4 * period, steps=3200
    )
    turned = np.unwrap(np.arctan2(motion.q[:, 1], motion.q[:, 0]))
    print(f"B = 1/r, angle per period    found {turned[800]:.12f}   exact {angle:.12f}")
    rosette.plot(*motion.q.T, lw=0.8)
    rosette.set(aspect="equal", xlabel="x", ylabel="y", title="B = 1/r: four radial periods")
    out.mkdir(parents=True, exist_ok=True)
    figure.savefig(out / "charged_particle.png", dpi=120)


if __name__ == "__main__":
    main(Path(sys.argv[1] if sys.argv[1:] else "out"))

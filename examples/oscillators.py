"""Oscillators: beats of two coupled ones, ellipses of an isotropic one, and what a step does to the
frequency.

Claim: two equal oscillators with a weak spring pass the energy to and fro in the time 2π/(ω₂ − ω₁);
a rule changes the frequency of a harmonic oscillator but not its amplitude: Störmer–Verlet turns by
arccos(1 − h²ω²/2) a step, the midpoint rule by 2 arctan(hω/2), s-stage Gauss by the Padé
approximant's angle.
Source: Landau & Lifshitz, Mechanics, §23; Hairer, Lubich & Wanner, Geometric Numerical Integration,
I.5.2.
Run: python examples/oscillators.py [folder of the picture]
"""

import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import varint as vi

plt.style.use("tableau-colorblind10")


def main(out: Path = Path("out")) -> None:
    figure, (beats, ellipse, phase) = plt.subplots(1, 3, figsize=(13, 4), layout="constrained")
    model = vi.models.coupled_oscillators()
    motion = vi.simulate(model.system, **model.start)
    q, _ = model.exact(motion.t)
    print(f"x₁(70)                       found {motion.q[-1, 0]:.6f}   exact {q[-1, 0]:.6f}")
    beats.plot(motion.t, motion.q, lw=0.9, label=["x₁", "x₂"])
    beat = 2 * np.pi / (np.sqrt(1.2) - 1)
    beats.axvline(beat, color="k", ls="--", lw=0.8, label="2π/(ω₂ − ω₁)")
    beats.set(xlabel="t", ylabel="displacement", title="Beats", ylim=(-1.1, 1.5))
    beats.legend(fontsize="small", loc="upper right", ncols=3)

    model = vi.models.isotropic_oscillator()
    motion = vi.simulate(model.system, vi.composition("kahan-li8"), **model.start)
    tensor = motion.value(model.invariants["Fradkin's tensor"])
    print(
        "drift of Fradkin's tensor (orientation and axes of the ellipse) "
        f"{np.ptp(tensor, axis=0).max():.1e}"
    )
    ellipse.plot(motion.q[:, 0], motion.q[:, 1], lw=0.8)
    ellipse.set(aspect="equal", xlabel="x", ylabel="y", title="Isotropic oscillator, ten rounds")

    x, v = vi.coordinates("x")
    system = vi.System(x, v, (v**2 - x**2) / 2)
    sizes = np.array([0.8, 0.4, 0.2, 0.1])
    rules = {  # angle turned in one step of size h at ω = 1
        vi.trapezoidal(): lambda h: np.arccos(1 - h**2 / 2),
        vi.midpoint(): lambda h: 2 * np.arctan(h / 2),
        vi.gauss(2): lambda h: 2 * np.arctan(h / 2 / (1 - h**2 / 12)),
    }
    for rule, angle in rules.items():
        found = []
        for h in sizes:
            run = vi.simulate(system, rule, q0=1.0, v0=0.0, h=h, steps=200)
            # x_k = cos(k α) whatever the rule: α from the nodes
            cosine = np.sum((run.q[2:] + run.q[:-2]) * run.q[1:-1]) / (2 * np.sum(run.q[1:-1] ** 2))
            found.append(np.arccos(cosine))
        print(f"angle of a step, {rule!r:13} found {found[0]:.12f}   exact {angle(sizes[0]):.12f}")
        phase.loglog(sizes, np.abs(np.array(found) / sizes - 1), "o-", label=f"{rule}")
    phase.set_xscale("log", base=2)
    phase.set(
        xlabel="hω",
        ylabel="relative error of the frequency",
        title="What a rule does to an oscillator",
    )
    phase.legend()
    out.mkdir(parents=True, exist_ok=True)
    figure.savefig(out / "oscillators.png", dpi=120)


if __name__ == "__main__":
    main(Path(sys.argv[1] if sys.argv[1:] else "out"))

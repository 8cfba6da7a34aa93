"""Lotka–Volterra: a Lagrangian linear in the velocities.

Claim: L = η ξ̇ − H(ξ, η), ξ = log prey, η = log predators, is degenerate (no mass matrix) but
variational: the midpoint rule runs round closed curves H = const where the explicit Euler method
spirals out.
Source: Hairer, Lubich & Wanner, Geometric Numerical Integration, I.1.1.
Run: python examples/predator_prey.py [folder of the picture]
"""

import sys
import warnings
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import varint as vi

plt.style.use("tableau-colorblind10")


def explicit_euler(start: np.ndarray, h: float, steps: int) -> np.ndarray:
    x = [start]
    for _ in range(steps):
        prey, hunters = x[-1]
        x.append(x[-1] + h * np.array([prey * (1 - hunters), hunters * (prey - 1)]))
    return np.array(x)


def main(out: Path = Path("out")) -> None:
    warnings.simplefilter("ignore")  # varint says that the Lagrangian is degenerate: it is
    figure, (phase, series, energy) = plt.subplots(1, 3, figsize=(13, 4), layout="constrained")
    for prey in (1.3, 2.0, 3.0):
        model = vi.models.lotka_volterra(prey=prey)
        motion = vi.simulate(model.system, vi.midpoint(), q0=model.q0, h=0.05, duration=200.0)
        phase.plot(
            *np.exp(motion.q).T, lw=0.8, color="C0", label="midpoint" if prey == 2.0 else None
        )
    spiral = explicit_euler(np.array([2.0, 1.0]), 0.05, 600)
    phase.plot(*spiral.T, lw=0.8, color="C1", label="explicit Euler")
    phase.set(
        xlabel="prey",
        ylabel="predators",
        title="4,000 steps of 0.05 each",
        xlim=(0, 6),
        ylim=(0, 6),
    )
    phase.legend()

    model = vi.models.lotka_volterra()
    motion = vi.simulate(model.system, vi.midpoint(), q0=model.q0, h=0.05, duration=1000.0)
    series.plot(motion.t[:500], np.exp(motion.q[:500]), label=["prey", "predators"])
    series.set(xlabel="t", ylabel="number", title="One chases the other", ylim=(0.3, 2.4))
    series.legend(loc="upper right", ncols=2)
    # over whole rounds the mean numbers are those of the fixed point (Volterra's principle)
    rounds = np.flatnonzero((motion.q[:-1, 1] < 0) & (motion.q[1:, 1] >= 0))
    mean = np.exp(motion.q[rounds[0] : rounds[-1]]).mean(axis=0)
    for name, value in zip(("prey", "predators"), mean, strict=True):
        print(f"mean number of {name:9}     found {value:.5f}   theory {1.0:.5f}")

    steps = np.array([0.2, 0.1, 0.05, 0.025])
    spread = []
    for h in steps:
        run = vi.simulate(model.system, vi.midpoint(), q0=model.q0, h=h, duration=200.0)
        spread.append(np.ptp(run.energy))
        energy.plot(run.t, run.energy - run.energy[0], lw=0.4, label=f"h = {h:g}")
    order = np.log2(spread[-2] / spread[-1])
    print(f"order of the energy error    found {order:.2f}   theory 2")
    energy.set(
        xlabel="t", ylabel="H − H₀", title="Energy error of the midpoint rule", ylim=(-9e-4, 1.8e-3)
    )
    energy.legend(fontsize="small", loc="upper right", ncols=2)
    out.mkdir(parents=True, exist_ok=True)
    figure.savefig(out / "predator_prey.png", dpi=120)


if __name__ == "__main__":
    main(Path(sys.argv[1] if sys.argv[1:] else "out"))

"""Blades and wheels: a knife edge on an incline, a rolling disc, the Chaplygin sleigh.

Claim: with the velocity constraint in d'Alembert's principle, not in the action, the knife edge
runs on a cycloid across the slope and never downhill, the disc on a circle, and the sleigh's speed
along its blade is V tanh(κVt + c): an attractor although the energy is kept. The rules are of
second order; two step sizes give the limit to order four.
Source: Bloch, Nonholonomic Mechanics and Control, 2nd ed., §1.4, §1.6, §1.7.
Run: python examples/rolling.py [folder of the picture]
"""

import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import varint as vi

plt.style.use("tableau-colorblind10")


def states(model: vi.models.Model, h: float) -> tuple[vi.Trajectory, np.ndarray]:
    """The motion with step h, and q, v, λ at its end with the error of second order removed by a
    run with h/2.
    """
    coarse, fine = (vi.simulate(model.system, **model.start | {"h": size}) for size in (h, h / 2))
    ends = [
        np.concatenate([motion.q[-1], motion.v[-1], motion.multipliers[-1]])
        for motion in (coarse, fine)
    ]
    return coarse, (4 * ends[1] - ends[0]) / 3


def main(out: Path = Path("out")) -> None:
    figure, axes = plt.subplots(1, 4, figsize=(15, 4), layout="constrained")
    edge = vi.models.knife_edge()
    motion, end = states(edge, 0.005)
    q, _ = edge.exact(10.0)
    push = (
        -2 * 9.81 * np.sin(0.4) * np.sin(q[0, 2])
    )  # mass times φ̇ v, and the weight's part across the blade
    print(f"knife edge, downhill after 10 s, m found {end[0]:.10f}   exact {q[0, 0]:.10f}")
    print(f"knife edge, across after 10 s, m   found {end[1]:.10f}   exact {q[0, 1]:.10f}")
    print(f"knife edge, side force, N          found {end[6]:.10f}   exact {push:.10f}")
    power = np.einsum("ij,ij->i", motion.reaction_forces, motion.v)
    print(f"knife edge: largest power of the reaction {np.abs(power).max():.1e} W")
    axes[0].plot(motion.q[:, 1], -motion.q[:, 0], label="simulated")
    axes[0].plot(*(edge.exact(motion.t[::40])[0][:, [1, 0]] * [1, -1]).T, ".", label="cycloid")
    axes[0].set(
        xlabel="across the slope, m",
        ylabel="up the slope, m",
        title="Knife edge on an incline",
        ylim=(-1.2, 0.3),
    )
    axes[0].legend(loc="upper right", ncols=2, fontsize="small")

    disc = vi.models.rolling_disc()
    motion, end = states(disc, 0.01)
    q, _ = disc.exact(10.0)
    print(f"disc, x after 10 s, m              found {end[0]:.10f}   exact {q[0, 0]:.10f}")
    print(f"disc, y after 10 s, m              found {end[1]:.10f}   exact {q[0, 1]:.10f}")
    # the friction is centripetal: speed times turning rate
    print(
        f"disc, friction, N                  found {np.hypot(*end[8:]):.10f}   exact "
        f"{2.0 * 0.5:.10f}"
    )
    axes[1].plot(motion.q[:, 0], motion.q[:, 1])
    axes[1].set(aspect="equal", xlabel="x in m", ylabel="y in m", title="Rolling disc")

    sleigh = vi.models.chaplygin_sleigh()
    arm, inertia, speed, turn = 0.7, 0.3, 0.4, 1.0
    whole = inertia + arm**2
    top = np.sqrt(speed**2 + whole * turn**2)

    def along(t):
        return top * np.tanh(arm / whole * top * t + np.arctanh(speed / top))

    motion, end = states(sleigh, 0.005)
    blade = end[3] * np.cos(end[2]) + end[4] * np.sin(end[2])
    print(f"sleigh, speed after 6 s, m/s       found {blade:.10f}   exact {along(6.0):.10f}")
    # ω² = (V² − v²)/(I + a²), so φ is the integral of a hyperbolic secant
    start = np.arctanh(speed / top)
    gudermann = [2 * np.arctan(np.tanh(x / 2)) for x in (arm / whole * top * 6 + start, start)]
    heading = np.sqrt(whole) / arm * (gudermann[0] - gudermann[1])
    print(f"sleigh, heading after 6 s, rad     found {end[2]:.10f}   exact {heading:.10f}")
    axes[2].plot(motion.q[:, 0], motion.q[:, 1])
    axes[2].set(
        aspect="equal",
        xlabel="x in m",
        ylabel="y in m",
        title="Chaplygin sleigh, path of the blade",
    )
    run = motion.v[:, 0] * np.cos(motion.q[:, 2]) + motion.v[:, 1] * np.sin(motion.q[:, 2])
    axes[3].plot(motion.t, run, label="speed along the blade")
    axes[3].plot(motion.t[::60], along(motion.t[::60]), ".", label="V tanh(κVt + c)")
    axes[3].plot(motion.t, motion.energy, lw=1, label="energy")
    axes[3].set(
        xlabel="t in s",
        ylabel="speed in m/s, energy in J",
        title="An attractor that keeps its energy",
    )
    axes[3].legend(loc="lower right")
    out.mkdir(parents=True, exist_ok=True)
    figure.savefig(out / "rolling.png", dpi=120)


if __name__ == "__main__":
    main(Path(sys.argv[1] if sys.argv[1:] else "out"))

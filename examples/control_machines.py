"""Walking with impacts, a satellite that turns like a falling cat, robot and orbit transfer,
pendulum on a rod.

Claim: a robot that need not turn moves at J = 3 M² d²/T³ = 76.8; the low-thrust transfer costs
1.0650580279977e-3; the pendulum as a particle on a rod costs what it costs in its angle; a
satellite turns with zero angular momentum; a gait repeats itself after the impact.
Source: PROPT user's guide; Junge, Marsden, Ober-Blöbaum 2005; Leyendecker et al. 2010; Montgomery
1993; Goswami 1998.
Run: python examples/control_machines.py [folder of the picture]
"""

import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import varint as vi

plt.style.use("tableau-colorblind10")


def draw_walk(axes, walk: vi.Trajectory) -> None:
    """Stick figures of two strides; after the impact the legs change names."""
    for stride in range(2):
        for k in range(0, len(walk), 4):
            x, y, stance, swing = walk.q[k]
            for angle, colour in ((stance, "C0"), (swing, "C1")):
                foot = x + np.sin(angle), y - np.cos(angle)
                axes.plot(np.array([x, foot[0]]) + 0.5 * stride, [y, foot[1]], colour, lw=1)
    axes.set(
        aspect="equal", xlabel="x in m", ylabel="y in m", title=f"Walk: cost {walk.cost:.3f} a step"
    )


def draw_cat(axes, turn: vi.Trajectory) -> None:
    """Body and arms at five moments."""
    for k in np.linspace(0, len(turn) - 1, 5).astype(int):
        body, *arms = turn.q[k]
        for side, arm in zip((-1, 1), arms, strict=True):
            shoulder = 0.6 * side * np.array([np.cos(body), np.sin(body)])
            hand = shoulder + side * np.array([np.cos(body + arm), np.sin(body + arm)])
            x, y = np.array([[0, 0], shoulder, hand]).T
            axes.plot(
                x + 4 * turn.t[k], y, "o-", ms=3, color=plt.get_cmap("viridis")(k / len(turn))
            )
    axes.set(
        aspect="equal",
        title="Satellite turns 0.6 rad without angular momentum",
        xticks=[],
        yticks=[],
    )
    axes.set_xlabel("at five moments from left to right, each drawn about its own centre")


def main(out: Path = Path("out")) -> None:
    models = vi.models
    for what, model in (
        ("cost of the robot's move", models.free_floating_robot()),
        ("cost of the orbit transfer", models.orbit_transfer()),
        ("cost of the swing-up on a rod", models.swing_up_rod()),
        ("cost of the swing-up in the angle", models.swing_up_pendulum()),
    ):
        found = model.solve()[0]
        print(f"{what}   found {found.cost:.12f}   exact {model.cost:.12f}")
    walk, turn = models.walker().solve()[0], models.falling_cat().solve()[0]
    print(f"largest angular momentum of the satellite: {np.abs(turn.p[:, 0]).max():.1e}")
    figure, (left, right) = plt.subplots(
        1, 2, figsize=(11, 3.4), layout="constrained", width_ratios=[1, 2]
    )
    draw_walk(left, walk)
    draw_cat(right, turn)
    out.mkdir(parents=True, exist_ok=True)
    figure.savefig(out / "control_machines.png", dpi=120)


if __name__ == "__main__":
    main(Path(sys.argv[1] if sys.argv[1:] else "out"))

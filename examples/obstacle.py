"""The shortest way past a disc: a path of least action that leans on an obstacle.

Claim: the path is a taut string, two tangents and an arc; it touches the disc without entering it,
and the multiplier of the contact, v²/2R², is the force that bends it round: along the arc the
acceleration v²/R must be λ ∂g/∂q, and g = x² + y² − R² has the slope 2R. The tangents from (±2, 0)
touch at 60° from the axis, which leaves an arc of 60°; the speed is the same everywhere, as the
obstacle does no work.
Source: Gelfand & Fomin, Calculus of Variations, §3.6 and 16 (one-sided variations); plane geometry.
Run: python examples/obstacle.py [folder of the picture]
"""

import sys
from pathlib import Path

import casadi as ca
import matplotlib.pyplot as plt
import numpy as np

import varint as vi

plt.style.use("tableau-colorblind10")
LENGTH = 2 * np.sqrt(3) + np.pi / 3  # from (−2, 0) to (2, 0) round the unit disc


def main(out: Path = Path("out")) -> None:
    q, v = vi.coordinates("x", "y")
    free = vi.System(q, v, ca.sumsqr(v) / 2)
    figure, (plane, force) = plt.subplots(1, 2, figsize=(10, 3.8), layout="constrained")
    paths = [
        vi.least_action(
            free,
            vi.midpoint(),
            q_start=[-2, 0],
            q_end=[2, 0],
            duration=1.0,
            steps=1000,
            guess=[[-2, 0], [0, side], [2, 0]],
            bounds=[(1, ca.sumsqr(q), None)],
        )
        for side in (1.2, -1.2)
    ]
    path, contact = paths[0], paths[0].solution
    touching = contact.touches[:, 0]
    print(f"length                      found {np.sqrt(2 * path.action):.9f}   exact {LENGTH:.9f}")
    middle = float(np.median(contact.multipliers[touching]))
    print(f"multiplier of the contact   found {middle:.6f}   theory {LENGTH**2 / 2:.6f}")
    print(
        f"deepest penetration: {max(0.0, 1 - contact.values.min()):.1e}; nodes in contact: "
        f"{touching.sum()}"
    )
    arc = path.q[touching]
    angle = np.ptp(np.arctan2(arc[:, 1], arc[:, 0]))
    print(f"angle of the arc            found {angle:.5f}   theory {np.pi / 3:.5f}")
    first = contact.t[touching].min()
    print(f"time of first contact       found {first:.5f}   theory {np.sqrt(3) / LENGTH:.5f}")
    speed = np.linalg.norm(np.diff(path.q, axis=0), axis=1) / path.h
    print(f"speed, least                found {speed.min():.6f}   theory {LENGTH:.6f}")
    print(f"speed, largest              found {speed.max():.6f}   theory {LENGTH:.6f}")
    for one in paths:
        plane.plot(*one.q.T)
    plane.add_patch(plt.Circle((0, 0), 1, color="lightgray"))
    plane.plot(*path.q[touching].T, "k", lw=3, label="in contact")
    plane.set(aspect="equal", xlabel="x", ylabel="y", title="Least action past a disc: two minima")
    plane.legend(fontsize="small")
    force.plot(contact.t, contact.multipliers[:, 0])
    force.axhline(LENGTH**2 / 2, color="gray", ls=":", label="v²/2R²")
    force.set(xlabel="t", ylabel="multiplier", title="How hard it leans on the disc")
    force.legend()
    out.mkdir(parents=True, exist_ok=True)
    figure.savefig(out / "obstacle.png", dpi=120)


if __name__ == "__main__":
    main(Path(sys.argv[1] if sys.argv[1:] else "out"))

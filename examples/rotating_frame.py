"""Coriolis and centrifugal forces from L = ½ m |ṙ + Ω × r|²: a turntable, Foucault's pendulum.

Claim: turned back to the inertial frame, the spiral is a straight line; the plane of Foucault's
pendulum turns by −Ω sin(latitude), 11.3° an hour in Paris.
Source: Landau & Lifshitz, Mechanics, §39 and its problem 3.
Run: python examples/rotating_frame.py [folder of the picture]
"""

import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import varint as vi

plt.style.use("tableau-colorblind10")


def turned(q: np.ndarray, angle: np.ndarray) -> np.ndarray:
    z = (q[:, 0] + 1j * q[:, 1]) * np.exp(1j * angle)
    return np.stack([z.real, z.imag], -1)


def main(out: Path = Path("out")) -> None:
    figure, (spiral, line, swing) = plt.subplots(1, 3, figsize=(13, 4), layout="constrained")
    for stiffness, label in ((0.0, "free"), (0.3, "on a spring")):
        model = vi.models.turntable(stiffness=stiffness)
        motion = vi.simulate(model.system, vi.gauss(4), **model.start)
        q, _ = model.exact(motion.t)
        print(
            f"x({motion.t[-1]:g}) {label:12}            found {motion.q[-1, 0]:.12f}   exact "
            f"{q[-1, 0]:.12f}"
        )
        spiral.plot(*motion.q.T, label=label)
        line.plot(*turned(motion.q, 0.7 * motion.t).T, label=label)
    spiral.set(aspect="equal", xlabel="x", ylabel="y", title="Seen from the turntable, Ω = 0.7")
    line.set(aspect="equal", xlabel="x", ylabel="y", title="The same, seen from the ground")
    spiral.set_ylim(-31, 39)
    spiral.legend(loc="upper right", ncols=2)
    line.legend(loc="upper left", bbox_to_anchor=(1, 1))

    space = vi.models.rotating_frame()
    motion = vi.simulate(space.system, vi.gauss(4), **space.start)
    q, _ = space.exact(motion.t)
    print(
        f"z({motion.t[-1]:g}) about an oblique axis   found {motion.q[-1, 2]:.12f}   exact "
        f"{q[-1, 2]:.12f}"
    )

    # an hour in Paris, and the same pendulum on an Earth that turns 300 times faster for the
    # picture
    paris = vi.models.foucault_pendulum()
    hour = vi.simulate(paris.system, vi.gauss(4), **paris.start)
    z = hour.q[:, 0] + 1j * hour.q[:, 1]
    far = np.abs(z) > 2.999  # near the ends of the swing
    angle = np.unwrap(2 * np.angle(z[far])) / 2  # of the plane: opposite ends are the same
    rate = np.polyfit(hour.t[far], angle, 1)[0]
    theory = -7.292115e-5 * np.sin(np.deg2rad(48.85))
    print(
        f"Paris, degrees an hour       found {3600 * np.rad2deg(rate):.4f}   theory "
        f"{3600 * np.rad2deg(theory):.4f}"
    )
    quick = vi.models.foucault_pendulum(Omega=300 * 7.292115e-5)
    motion = vi.simulate(quick.system, vi.gauss(4), **quick.start | {"duration": 160.0})
    swing.plot(*motion.q.T, lw=0.7)
    swing.set(
        aspect="equal",
        xlabel="x in m",
        ylabel="y in m",
        title="Foucault's pendulum, Earth 300 times faster",
    )
    out.mkdir(parents=True, exist_ok=True)
    figure.savefig(out / "rotating_frame.png", dpi=120)


if __name__ == "__main__":
    main(Path(sys.argv[1] if sys.argv[1:] else "out"))

"""Geodesics as paths of free particles: on the sphere both ways round, on a torus, on the Earth's
spheroid.

Claim: a metric is a Lagrangian; lengths of geodesics come out to 10 digits, and the long way round
the sphere has Morse index 1, since it passes the antipode of its start.
Source: do Carmo, Differential Geometry of Curves and Surfaces, §4.4; Karney, J. Geodesy 87 (2013)
43 (New York–London).
Run: python examples/geodesics.py [folder of the picture]
"""

import sys
from pathlib import Path

import casadi as ca
import matplotlib.pyplot as plt
import numpy as np

import varint as vi

plt.style.use("tableau-colorblind10")
AIRPORTS = ([0.7093244972907716, -1.2876707608656286], [0.8983209660014816, -0.007929030791810239])
FLIGHT = 5549.6818523709435  # km
AROUND = [1.8904584017481063, 1.1625892819954589]  # where the torus's geodesic is after length 3


def main(out: Path = Path("out")) -> None:
    q, v = vi.coordinates("x", "y", "z")
    sphere = vi.System(q, v, ca.sumsqr(v) / 2, constraint=ca.sumsqr(q) - 1)
    a, b = np.array([0.8, 0.0, 0.6]), np.array([-0.28, 0.96, 0.0])
    angle = np.arccos(a @ b)
    figure = plt.figure(figsize=(10, 4.6), layout="constrained")
    ball, ring = (figure.add_subplot(1, 2, k, projection="3d") for k in (1, 2))
    for guess, exact in ((None, angle), ([a, -2 * (a + b), b], 2 * np.pi - angle)):
        path = vi.least_action(
            sphere, vi.lobatto(5), q_start=a, q_end=b, duration=1.0, steps=60, guess=guess
        )
        length = np.sqrt(2 * path.action)
        print(
            f"sphere, index {path.morse_index}             found {length:.12f}   exact {exact:.12f}"
        )
        ball.plot(*path.q.T, lw=2, label=f"length {length:.3f}, index {path.morse_index}")
        for t in path.conjugate_times:
            print(f"  distance of its conjugate found {t * length:.9f}   exact {np.pi:.9f}")
            ball.plot(*path.at(t).q[:, None], "ks")
    u, w = np.meshgrid(np.linspace(0, 2 * np.pi, 40), np.linspace(0, np.pi, 20))
    ball.plot_wireframe(
        np.cos(u) * np.sin(w), np.sin(u) * np.sin(w), np.cos(w), lw=0.2, color="gray"
    )
    ball.legend(fontsize="small")
    ball.set_title("Great circles; the square is the antipode")

    earth = vi.models.spheroid_geodesic().system
    path = vi.least_action(
        earth, vi.gauss(6), q_start=AIRPORTS[0], q_end=AIRPORTS[1], duration=1.0, steps=20
    )
    print(f"New York to London in km    found {np.sqrt(2 * path.action):.9f}   exact {FLIGHT:.9f}")

    torus = vi.models.torus_geodesic()
    guess = [[0, 0], [0.95, 0.24], AROUND]
    path = vi.least_action(
        torus.system, vi.gauss(6), q_start=[0, 0], q_end=AROUND, duration=3.0, steps=60, guess=guess
    )
    print(f"length on the torus         found {np.sqrt(2 * path.action * 3):.12f}   exact {3:.12f}")
    both = [
        path.q,
        vi.simulate(torus.system, vi.gauss(6), q0=[0, 0], v0=torus.v0, duration=60.0, steps=1200).q,
    ]
    for (turn, axis), lw in zip((x.T for x in both), (3, 0.8), strict=True):
        around = 2 + 0.8 * np.cos(turn)
        ring.plot(around * np.cos(axis), around * np.sin(axis), 0.8 * np.sin(turn), lw=lw)
    ring.set(title="A geodesic on the torus", aspect="equal")
    for axes in (ball, ring):
        axes.locator_params(nbins=3)  # labels in perspective stand close
        axes.set(xlabel="x", ylabel="y", zlabel="z")
    out.mkdir(parents=True, exist_ok=True)
    figure.savefig(out / "geodesics.png", dpi=120)


if __name__ == "__main__":
    main(Path(sys.argv[1] if sys.argv[1:] else "out"))

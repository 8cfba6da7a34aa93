"""Lambert's problem: the orbit from one place to another in a given time is a path of stationary
action.

Claim: the departure velocities of three textbook cases come out to all published digits, the short
and the long way are two stationary paths, and the long way is no minimum: it passes the point
opposite the start.
Source: Curtis, Orbital Mechanics, examples 5.2 and 5.3; Der's Molniya case; exact values by
universal variables.
Run: python examples/lambert.py [folder of the picture]
"""

import sys
from pathlib import Path

import casadi as ca
import matplotlib.pyplot as plt
import numpy as np

import varint as vi

plt.style.use("tableau-colorblind10")
CASES = (  # name, μ, r1, r2, T, first component of the departure velocity
    ("Curtis 5.2", 398600.0, [5000, 10000, 2100], [-14600, 2500, 7000], 3600.0, -5.992494639666396),
    ("Curtis 5.3", 398600.0, [273378, 0, 0], [145820, 12758, 0], 48600.0, -2.435667235437024),
    (
        "Molniya",
        398600.4418,
        [22592.145603, -1599.915239, -19783.950506],
        [1922.067697, 4054.157051, -8925.727465],
        36000.0,
        2.000652697025627,
    ),
)
WAYS = ((False, 0.12135356134702864), (True, -0.9819155403520962))  # long?, first component of v(0)


def main(out: Path = Path("out")) -> None:
    mu = vi.Parameters(mu=1.0)
    q, v = vi.coordinates("x", "y", "z")
    kepler = vi.System(q, v, ca.sumsqr(v) / 2 + mu.mu / ca.norm_2(q), params=mu)
    for name, strength, r1, r2, duration, exact in CASES:
        path = vi.least_action(
            kepler,
            vi.gauss(8),
            q_start=r1,
            q_end=r2,
            duration=duration,
            steps=60,
            params=dict(mu=strength),
        )
        print(f"{name:10}  v_x in km/s      found {path.v[0, 0]:.12f}   exact {exact:.12f}")
    figure, axes = plt.subplots(figsize=(8, 4.2), layout="constrained")
    a, b = np.array([1.0, 0, 0]), np.array([0, 1.5, 0])
    for far, exact in WAYS:
        guess = [a, -(a + b), b] if far else None
        path = vi.least_action(
            kepler, vi.gauss(8), q_start=a, q_end=b, duration=2.0, steps=60, guess=guess
        )
        name = "the long way" if far else "the short way"
        print(f"{name:14}  v_x          found {path.v[0, 0]:.12f}   exact {exact:.12f}")
        axes.plot(
            *path.q[:, :2].T, label=f"{name}: S = {path.action:.4f}, index {path.morse_index}"
        )
        for t in path.conjugate_times:
            axes.plot(*path.at(t).q[:2], "s", color="k", label="conjugate to the start")
    axes.plot(0, 0, "o", color="orange", ms=12)
    axes.plot(*np.array([a, b])[:, :2].T, "k.", ms=10)
    axes.set(
        aspect="equal", xlabel="x", ylabel="y", title="Two orbits from (1, 0) to (0, 1.5) in T = 2"
    )
    axes.legend(fontsize="small", loc="upper left", bbox_to_anchor=(1, 1))
    out.mkdir(parents=True, exist_ok=True)
    figure.savefig(out / "lambert.png", dpi=120)


if __name__ == "__main__":
    main(Path(sys.argv[1] if sys.argv[1:] else "out"))

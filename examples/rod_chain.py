"""A chain of rods in x and y: what it carries at rest, and how it falls.

Claim: with a multiplier for every rod the chain needs no angles. At rest rod i carries the weight
below it, and released level it moves as the same chain in angles does, whose mass matrix is full;
the rods are kept to round-off.
Source: Leimkuhler & Skeel, J. Comput. Phys. 112 (1994) 117; Landau & Lifshitz, Mechanics, §5,
problem 1 (two links).
Run: python examples/rod_chain.py [folder of the picture]
"""

import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import varint as vi

plt.style.use("tableau-colorblind10")
N, G = 6, 9.81


def joints(angles: np.ndarray) -> np.ndarray:
    """Places of the masses, (times, N, 2), from the angles of unit rods with the downward
    vertical.
    """
    return np.cumsum(np.stack([np.sin(angles), -np.cos(angles)], -1), axis=1)


def main(out: Path = Path("out")) -> None:
    rods = vi.models.chain_rods(N)
    still = joints(np.zeros((1, N))).ravel()
    rest = vi.simulate(rods.system, q0=still, v0=rods.v0, h=0.01, steps=100)
    carried = -2 * rest.multipliers[-1]
    for i, tension in enumerate(carried):
        print(f"rod {i + 1} carries at rest, N   found {tension:.12f}   exact {(N - i) * G:.12f}")

    rule = vi.lobatto(5)
    start = {"h": 0.005, "duration": 2.0}
    falls = vi.simulate(rods.system, rule, q0=rods.q0, v0=rods.v0, **start)
    angles = vi.models.chain_pendulum(N)
    same = {"m": np.ones(N), "length": np.ones(N), "g": G}
    turns = vi.simulate(
        angles.system, vi.gauss(4), q0=np.full(N, np.pi / 2), v0=np.zeros(N), params=same, **start
    )
    places = falls.q.reshape(-1, N, 2)
    exact = joints(turns.q)
    print(
        f"end of the chain, x at 2 s, m  found {places[-1, -1, 0]:.10f}   exact "
        f"{exact[-1, -1, 0]:.10f}"
    )
    print(
        f"end of the chain, y at 2 s, m  found {places[-1, -1, 1]:.10f}   exact "
        f"{exact[-1, -1, 1]:.10f}"
    )
    # the whole chain accelerates by its weight and by the pull of the support, along the first rod
    pull = -2 * falls.multipliers[:, :1] * -places[:, 0]
    momentum = falls.p.reshape(-1, N, 2).sum(axis=1)
    weight = np.array([0.0, -N * G])
    simpson = np.r_[1, np.tile([4, 2], len(falls) // 2)[:-1], 1] * falls.h / 3
    impulse = simpson @ (pull + weight)
    print(f"momentum after 2 s, x, N s     found {momentum[-1, 0]:.6f}   exact {impulse[0]:.6f}")
    print(f"momentum after 2 s, y, N s     found {momentum[-1, 1]:.6f}   exact {impulse[1]:.6f}")
    links = np.diff(places, axis=1, prepend=0.0)
    gap = np.abs(np.linalg.norm(links, axis=2) - 1).max()
    print(
        f"worst length of a rod off by {gap:.1e}; worst place off by "
        f"{np.abs(places - exact).max():.1e} m"
    )
    print(f"energy off by {np.abs(falls.energy - falls.energy[0]).max():.1e} J")
    for name, motion in (("rods", falls), ("angles", turns)):
        print(
            f"{name:>7}: {motion.stats['seconds'] / motion.stats['steps'] * 1e6:7.1f} µs a step, "
            f"{motion.rule}"
        )

    figure, (shapes, pulls, error) = plt.subplots(1, 3, figsize=(13, 4), layout="constrained")
    for i, k in enumerate(range(0, len(falls), 40)):
        x, y = np.vstack([[0, 0], places[k]]).T
        shapes.plot(x, y, "o-", ms=3, lw=1, color=plt.get_cmap("viridis")(i / 10))
    shapes.set(
        aspect="equal", xlabel="x in m", ylabel="y in m", title="Every 0.2 s after the release"
    )
    pulls.plot(falls.t, -2 * falls.multipliers / G, lw=1, label=[f"rod {i + 1}" for i in range(N)])
    pulls.set(xlabel="t in s", ylabel="tension in weights of a mass", title="Tensions of the rods")
    pulls.legend(fontsize="small")
    error.semilogy(
        falls.t[1:], np.abs(places - exact)[1:].max(axis=(1, 2)) + 1e-17, label="rods − angles, m"
    )
    error.semilogy(
        falls.t[1:],
        np.abs(falls.energy - falls.energy[0])[1:] + 1e-17,
        lw=1,
        label="energy of the rods, J",
    )
    error.set(xlabel="t in s", title=f"{rule} in rods, gauss(4) in angles")
    error.legend()
    out.mkdir(parents=True, exist_ok=True)
    figure.savefig(out / "rod_chain.png", dpi=120)


if __name__ == "__main__":
    main(Path(sys.argv[1] if sys.argv[1:] else "out"))

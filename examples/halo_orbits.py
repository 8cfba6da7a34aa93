"""Halo orbits of Earth and Moon: points of rest, planar orbits, and those that leave the plane.

Claim: the five points at which a satellite rests beside Earth and Moon solve Euler's quintics;
about L1 begins a family of planar orbits, from which at C = 3.1744 halo orbits branch off into
space; the famous one of nine turns in two months closes.
Source: Szebehely, Theory of Orbits, 1967; Howell, Celestial Mechanics 32 (1984) 53.
Run: python examples/halo_orbits.py [folder of the picture]
"""

import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import varint as vi

plt.style.use("tableau-colorblind10")
GUESSES = [[0.8, 0, 0], [1.2, 0, 0], [-1.0, 0, 0], [0.5, 0.8, 0], [0.5, -0.8, 0]]


def euler_quintic(mu: float) -> float:
    """x of L1: one less its distance from the Moon, a root of Euler's polynomial."""
    roots = np.roots([1, -(3 - mu), 3 - 2 * mu, -mu, 2 * mu, -mu])
    distance = next(x.real for x in roots if abs(x.imag) < 1e-9 and 0 < x.real < 1)
    return 1 - mu - distance


def main(out: Path = Path("out")) -> None:
    model = vi.models.restricted_three_body()
    system, mu = model.system, float(model.system.defaults["mu"])
    points = vi.orbits.equilibria(system, GUESSES)
    print(points)
    print(f"x of L1   found {points[0].q[0]:.12f}   exact {euler_quintic(mu):.12f}")
    triangle = points[3].q
    print(f"y of L4   found {triangle[1]:.12f}   exact {np.sqrt(3) / 2:.12f}")

    modes = vi.orbits.normal_modes(system, points[0])
    flat = max(range(len(modes)), key=lambda k: (modes.frequencies[k] > 0, abs(modes.shapes[k, 1])))
    planar = vi.orbits.family(modes.orbit(flat, 2e-3), to=-1.56, longest=0.4)
    [birth] = planar.bifurcations
    print(f"C of the first halo orbit   found {-2 * birth.value:.4f}   theory 3.1744")
    halos = vi.orbits.family(birth.branch(), most=14, longest=0.5, bifurcations=False)

    ready = vi.orbits.periodic(system, (model.q0, model.v0), period=model.duration)
    print(ready)
    print(ready.floquet)
    after = ready.motion.energy[-1]
    print(f"energy after a turn   found {after:.10f}   exact {ready.energy:.10f}")

    figure = plt.figure(figsize=(13, 4), layout="constrained")
    plane, space = figure.add_subplot(131), figure.add_subplot(132)
    for one in planar.orbits[::2]:
        plane.plot(*one.motion.q[:, :2].T, lw=0.8, color="C0")
    plane.plot(*birth.orbit.motion.q[:, :2].T, lw=1.6, color="C1", label="halo orbits begin")
    places = np.array([one.q[:2] for one in points])
    plane.plot(*places.T, "k+", label="points of rest")
    plane.plot(1 - mu, 0, "o", color="0.5", label="Moon")
    plane.set(xlim=(0.75, 1.2), ylim=(-0.25, 0.25), xlabel="x", ylabel="y", title="Planar family")
    plane.legend(fontsize="small")

    for one in (*halos.orbits[::2], ready):
        space.plot(one.motion.q[:, 1], one.motion.q[:, 2], lw=0.8)
    space.plot(0, 0, "o", color="0.5")
    space.set(xlabel="y", ylabel="z", title="Halo orbits, seen from the Earth")
    space.set_aspect("equal")

    indices = figure.add_subplot(133)
    for family, name in ((planar, "planar"), (halos, "halo")):
        values = np.abs(family.indices).real
        indices.semilogy(
            family.energies, values, ".-", label=[f"{name}, largest", f"{name}, other"]
        )
    indices.axhline(1, color="0.6", lw=0.8)
    indices.set(xlabel="energy", ylabel="stability indices", title="Stable below 1")
    indices.legend(fontsize="small")
    out.mkdir(parents=True, exist_ok=True)
    figure.savefig(out / "halo_orbits.png", dpi=120)


if __name__ == "__main__":
    main(Path(sys.argv[1] if sys.argv[1:] else "out"))

"""Close encounters: Arenstorf's orbit, its neighbours and its stability, and Burrau's triangle.

Claim: the satellite that passes the Moon at 0.006 of its distance is back after 17.0652165601580;
with steps that are short there alone, the orbit takes 400 of them and closes to 14 digits, and a
neighbour's distance grows 285-fold in a turn. Three bodies at rest part into a pair and one alone.
Source: Arenstorf, American Journal of Mathematics 85 (1963) 27; Hairer, Nørsett & Wanner, Solving
Ordinary Differential Equations I, II.0; Szebehely & Peters, Astronomical Journal 72 (1967) 876.
Run: python examples/arenstorf.py [folder of the picture]
"""

import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import varint as vi

plt.style.use("tableau-colorblind10")
MOON = 0.012277471  # its part of the mass, as Arenstorf took it
PAIRS = ((0, 1), (0, 2), (1, 2))


def burraus_triangle() -> vi.Trajectory:
    """Masses 3, 4 and 5 from rest, past many close encounters, in steps of equal angles."""
    model = vi.models.pythagorean_three_body()
    return vi.simulate(
        model.system,
        vi.gauss(8),
        q0=model.q0,
        v0=model.v0,
        h=0.4,
        duration=70.0,
        time_scale="auto",
    )


def main(out: Path = Path("out")) -> None:
    model = vi.models.arenstorf()
    orbit = vi.orbits.periodic(model.system, (model.q0, model.v0), period=model.duration)
    print(orbit)
    print(orbit.floquet)
    print(f"start x        found {orbit.q0[0]:.12f}   exact {model.q0[0]:.12f}")
    print(f"start y'       found {orbit.v0[1]:.12f}   exact {model.v0[1]:.12f}")
    pair = orbit.floquet.multipliers.real
    print(f"μ · 1/μ        found {pair[0] * pair[-1]:.12f}   exact {1:.12f}")
    print(f"energy after   found {orbit.motion.energy[-1]:.12f}   exact {orbit.energy:.12f}")
    family = vi.orbits.family(orbit, most=8, bifurcations=False)
    print(family)

    three = burraus_triangle()
    places = three.q.reshape(len(three.q), 3, 2)
    apart = np.array([np.linalg.norm(places[:, i] - places[:, j], axis=1) for i, j in PAIRS])
    print(f"Burrau: {len(three.t) - 1} steps, closest {apart.min():.1e} at t = ", end="")
    print(f"{three.t[apart.min(axis=0).argmin()]:.2f}; lightest {apart[:2, -1].min():.1f} away")
    print(f"energy         found {three.energy[-1]:.9f}   exact {three.energy[0]:.9f}")

    figure, axes = plt.subplots(1, 3, figsize=(13, 4.2), layout="constrained")
    for one in family.orbits[::2]:
        axes[0].plot(*one.motion.at(np.linspace(0, one.period, 2000)).q.T, lw=0.6, color="0.7")
    axes[0].plot(*orbit.motion.at(np.linspace(0, orbit.period, 4000)).q.T, lw=1.2, color="C0")
    axes[0].plot([-MOON, 1 - MOON], [0, 0], "o", color="C1", ms=4)
    axes[0].set(xlabel="x", ylabel="y", title="Arenstorf's orbit and neighbours", aspect="equal")
    away = np.linalg.norm(orbit.motion.q[:-1] - [1 - MOON, 0], axis=1)
    axes[1].loglog(away, orbit.motion.sizes, ".", ms=4)
    axes[1].set(xlabel="distance from the Moon", ylabel="step", title="Steps of one period")
    for i, mass in enumerate((3, 4, 5)):
        axes[2].plot(*places[:, i].T, lw=0.7, label=f"mass {mass}")
    axes[2].set(xlim=(-6, 8), ylim=(-8, 8), xlabel="x", ylabel="y", title="Three bodies from rest")
    axes[2].legend(fontsize="small")
    out.mkdir(parents=True, exist_ok=True)
    figure.savefig(out / "arenstorf.png", dpi=120)


if __name__ == "__main__":
    main(Path(sys.argv[1] if sys.argv[1:] else "out"))

"""The Sun and eight planets: elements over ages, with a checkpoint and a progress bar.

Claim: semi-major axes stay where they are while eccentricities and inclinations breathe; the
Earth's mean longitude goes round once in a sidereal year. A run of 1e8 days (274,000 years) is
`python examples/planets.py out 1e8`: its bar shows the time left, and after a crash, a kill or
Ctrl-C the same call goes on from the checkpoint.
Source: Standish, Keplerian Elements for Approximate Positions of the Major Planets (JPL); Laskar,
Icarus 88 (1990) 266, for the frequencies of the ages.
Run: python examples/planets.py [folder of the picture] [days]
"""

import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import matplotlib.pyplot as plt
import numpy as np

import varint as vi
from varint.models.planets import PLANETS

plt.style.use("tableau-colorblind10")
YEAR = 365.25  # days
SIDEREAL = 365.25636  # days; Allen's Astrophysical Quantities, 4th ed.
H = 20.0  # days: Mercury takes 88


def run(days: float, checkpoint: Path) -> tuple[vi.Trajectory, vi.orbits.Elements]:
    """The planets and their elements."""
    model = vi.models.solar_system()
    steps = round(days / H)
    motion = vi.simulate(
        model.system,
        vi.gauss(8),
        q0=model.q0,
        v0=model.v0,
        h=H,
        steps=steps,
        save_every=max(steps // 4000, 1),
        checkpoint=checkpoint,
    )
    return motion, vi.orbits.jacobi_elements(motion, names=["Sun", *PLANETS])


def year(motion: vi.Trajectory, elements: vi.orbits.Elements) -> float:
    """How long the Earth goes round once, by a fit through its mean longitude."""
    i = elements.names.index("Earth")
    turns = np.cumsum(np.diff(motion.t) / (2 * np.pi / elements.mean_motion[0, i]))
    off = elements.mean_longitude[:, i] / (2 * np.pi)
    whole = np.append(off[0], off[0] + turns)  # to within a small part of a turn, for long
    count = off + np.round(whole - off)
    return 1 / np.polyfit(motion.t, count, 1)[0]


def secular(elements: vi.orbits.Elements) -> None:
    """The frequencies of Jupiter's e exp(iϖ), where the run is long enough to tell them."""
    one = elements.of("Jupiter")
    z = one.e * np.exp(1j * elements.longitude_of_pericentre[:, elements.names.index("Jupiter")])
    found = vi.orbits.naff(elements.t, z, 3)
    arcseconds = np.degrees(found.frequencies) * 3600 * YEAR
    shown = ", ".join(f"{x:.3f}" for x in arcseconds[:2])
    print(f"Jupiter's e exp(iϖ) turns by {shown} arcseconds a year")
    print("(g5 = 4.257 and g6 = 28.245 of ephemerides; these starts are fits, good to 1e-3)")


def main(out: Path = Path("out"), days: float = 2e5) -> None:
    with TemporaryDirectory() as folder:
        motion, elements = run(days, Path(folder) / "planets")
    drift = np.abs(motion.energy / motion.energy[0] - 1).max()
    print(f"{days:.3g} days, {days / YEAR:,.0f} years: energy kept to {drift:.0e}")
    print(f"sidereal year, days   found {year(motion, elements):.5f}   theory {SIDEREAL}")
    if days > 3e7:
        secular(elements)
    figure = elements.plot()
    figure.suptitle(f"{days / YEAR:,.0f} years")
    out.mkdir(parents=True, exist_ok=True)
    figure.savefig(out / "planets.png", dpi=120)


if __name__ == "__main__":
    main(
        Path(sys.argv[1] if sys.argv[1:] else "out"),
        float(sys.argv[2]) if sys.argv[2:] else 2e5,
    )

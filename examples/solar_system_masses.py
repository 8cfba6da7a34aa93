"""Masses of the Sun and the giant planets from where the planets were, by JPL's ephemeris.

Claim: from positions every 400 days over 150 years, and guesses of the masses that are 20 % off,
those of the Sun, Jupiter, Saturn, Uranus and Neptune come out within 1e-5 of the published ones.
Source: Folkner, Williams & Boggs, IPN Progress Report 42-178 (2009), DE421: its masses (GM), its
positions from the package skyfield-data; the potential for the advance of perihelia: Nobili &
Roxburgh, in Relativity in Celestial Mechanics and Astrometry (1986) 105.
Run: python examples/solar_system_masses.py [folder], after pip install skyfield-data jplephem
"""

import sys
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path

import casadi as ca
import matplotlib.pyplot as plt
import numpy as np

import varint as vi

plt.style.use("tableau-colorblind10")
AU = 149597870.6996262  # km
LIGHT = 299792.458 * 86400 / AU  # AU a day
GM = {  # km³/s² of DE421, planets with their moons
    "sun": 132712440040.944, "mercury": 22032.09, "venus": 324858.592, "earth": 403503.233,
    "mars": 42828.375214, "jupiter": 126712764.8, "saturn": 37940585.2, "uranus": 5794548.6,
    "neptune": 6836535.0, "pluto": 977.0,
}  # fmt: skip
GM = {name: gm * 86400**2 / AU**3 for name, gm in GM.items()}
INNER = {"mercury": 0.3871, "venus": 0.7233, "earth": 1.0, "mars": 1.5237}  # radii, AU
OUTER = ("jupiter", "saturn", "uranus", "neptune", "pluto")
SOUGHT = ("sun", "jupiter", "saturn", "uranus", "neptune")
NORMAL = np.array([0.0, -0.397777, 0.917482])  # of the ecliptic


def data(days: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Positions and velocities of the outer planets relative to the Sun with the inner ones."""
    try:
        from jplephem.spk import SPK

        files = distribution("skyfield-data").files or []
    except (ImportError, PackageNotFoundError):
        sys.exit("This example reads an ephemeris: pip install skyfield-data jplephem")
    [path] = [x.locate() for x in files if x.name == "de421.bsp"]
    with SPK.open(str(path)) as kernel:
        order = (10, 1, 2, 3, 4, 5, 6, 7, 8, 9)
        states = {
            name: np.array(kernel[0, i].compute_and_differentiate(days)) / AU
            for name, i in zip(GM, order, strict=True)
        }
    middle = sum(GM[x] * states[x] for x in ("sun", *INNER)) / sum(GM[x] for x in ("sun", *INNER))
    q, v = np.concatenate([states[x] - middle for x in OUTER], axis=1).transpose(0, 2, 1)
    return q, v


def scene() -> vi.System:
    """The outer planets and a centre that is the Sun with rings of the inner planets' masses."""
    q, v = vi.coordinates(*(f"{axis}_{name}" for name in OUTER for axis in "xyz"))
    guess = dict(zip(SOUGHT, (1.001, 1.03, 0.9, 1.2, 0.8), strict=True))
    c = vi.Parameters(**{name: GM[name] * guess[name] for name in SOUGHT})
    mu = [c.jupiter, c.saturn, c.uranus, c.neptune, GM["pluto"]]
    centre, r, w = c.sun + sum(GM[x] for x in INNER), ca.vertsplit(q, 3), ca.vertsplit(v, 3)
    total, drift = centre + sum(mu), sum(m * x for m, x in zip(mu, w, strict=True))
    lagrangian = sum(m * ca.sumsqr(x) for m, x in zip(mu, w, strict=True)) / 2
    lagrangian -= ca.sumsqr(drift) / 2 / total  # the centre's own motion, momentum being zero
    ring = sum(GM[x] * INNER[x] ** 2 for x in INNER) / 4
    for i, (m, x) in enumerate(zip(mu, r, strict=True)):
        far = ca.norm_2(x)
        lagrangian += centre * m / far + 3 * centre**2 * m / (LIGHT * far) ** 2
        lagrangian += m * ring / far**3 * (1 - 3 * (ca.dot(x, NORMAL) / far) ** 2)
        lagrangian += sum(m * mu[j] / ca.norm_2(x - r[j]) for j in range(i))
    return vi.System(q, v, lagrangian, params=c)


def main(out: Path = Path("out")) -> None:
    days = np.arange(2415000.5, 2471000.5, 400.0)
    q, v = data(days)
    system, t = scene(), days - days[0]
    seen = vi.Measurement(system.q, t, q, sigma=1e-7)  # some 15 km: what the scene leaves out
    unknown = [*SOUGHT, "q0", "v0"]
    found = vi.fit(system, vi.gauss(4), data=seen, unknown=unknown, h=40.0, q0=q[0], v0=v[0])
    ratios = found.estimates[: len(SOUGHT)] / [GM[name] for name in SOUGHT] - 1
    for name, off, s in zip(SOUGHT, ratios, found.sigma, strict=False):
        gm = found.params[name].item() * AU**3 / 86400**2
        print(f"{name:8} GM {gm:.8e} km³/s², off by {off:+.1e}, standard error {s / GM[name]:.0e}")
        print(f"    over the published   found {1 + off:.9f}   theory 1.0")
    print(f"largest error {np.abs(ratios).max():.1e}, asked for 1e-5")
    left = found.residuals[0][0].reshape(len(t), -1, 3) * 1e-7 * AU
    figure, (path, below) = plt.subplots(1, 2, figsize=(11, 5), layout="constrained")
    motion = found.trajectories[0]
    for i, name in enumerate(OUTER):
        path.plot(*motion.q[:, 3 * i : 3 * i + 2].T, lw=0.7)
        path.plot(*q[:, 3 * i : 3 * i + 2].T, ".", ms=2, color=f"C{i}")
        below.semilogy(1900 + t / 365.25, np.linalg.norm(left[:, i], axis=1), lw=0.8, label=name)
    path.set(aspect="equal", xlabel="x in AU", ylabel="y in AU", title="Ephemeris, fitted motion")
    below.set(xlabel="year", ylabel="km", title="Distance between them")
    below.legend(fontsize="small", ncols=3)
    out.mkdir(parents=True, exist_ok=True)
    figure.savefig(out / "solar_system_masses.png", dpi=120)


if __name__ == "__main__":
    main(Path(sys.argv[1] if sys.argv[1:] else "out"))

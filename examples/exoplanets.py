"""Two planets in the measured wobble of their star: the orbits of HD 164922 b and c.

Claim: from 401 radial velocities and a periodogram's guesses comes what is likeliest by radvel's
own posterior too; periods, noise and what is well told lie within the published errors. Of c's
eccentricity little is told: 0.60 is likeliest, `found.profile("e_c", 0.68)` (some 40 s) goes from
0.40 to 0.71, and the published 0.29, a median of all that is possible, is hardly less likely.
Source: data and published medians of radvel (Fulton et al., PASP 130 (2018) 044504); with priors
and basis of its example its posterior (1.6.7) has its maximum there, from seven starts. Mass of the
star: Fulton et al., ApJ 830 (2016) 46.
Run: python examples/exoplanets.py [folder of the picture], after pip install radvel
"""

import sys
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path

import casadi as ca
import matplotlib.pyplot as plt
import numpy as np

import varint as vi

# GM of the Sun in AU³/day², that of the star in Suns, and m/s in an AU a day
SUN, STAR, METRES = 0.01720209895**2, 0.874, 149597870700.0 / 86400
TELESCOPES = "kja"  # Keck before and after 2004, the Automated Planet Finder
PUBLISHED = dict(  # median, how far the 68 % interval goes below and above; radvel's likeliest
    P_b=(1198.4, 4.1, 4.1, 1198.51), K_b=(7.23, 0.25, 0.25, 7.347), e_b=(0.085, 0.034, 0.037, 0.07),
    P_c=(75.73, 0.039, 0.046, 75.723), K_c=(2.21, 0.26, 0.33, 2.783), e_c=(0.29, 0.13, 0.21, 0.607),
    noise_k=(2.68, 0.35, 0.40, 2.395), noise_j=(2.94, 0.14, 0.15, 2.899),
    noise_a=(1.11, 0.44, 0.39, 0.972),
)  # fmt: skip


def data() -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Days, velocities, their errors in m/s, and the telescope of each."""
    try:
        files = distribution("radvel").files or []
    except PackageNotFoundError:
        sys.exit("This example reads data of the package radvel: pip install radvel")
    [path] = [Path(x.locate()) for x in files if x.name == "164922_fixed.txt"]
    *numbers, where = np.loadtxt(path, str, skiprows=1, usecols=range(4), unpack=True)
    return *(np.array(numbers, dtype=float) - [[2450000], [0], [0]]), where


def guesses(t, speed, sigma, zeros) -> dict[str, float]:
    """The circular orbits that fit best, one after the other: period, amplitude, longitude."""
    found = {}
    for letter, low, high in (("b", 700, 2500), ("c", 30, 150)):
        best = (np.inf, speed)
        for period in 1 / np.arange(1 / high, 1 / low, 0.1 / np.ptp(t)):
            phase = 2 * np.pi * (t - t[0]) / period
            columns = np.column_stack([np.cos(phase), np.sin(phase), zeros])
            x = np.linalg.lstsq(columns / sigma[:, None], speed / sigma, rcond=None)[0]
            left = speed - columns @ x
            if (chi := ((left / sigma) ** 2).sum()) < best[0]:
                best, mine = (chi, left), {"P_": period, "K_": np.hypot(*x[:2])}
                mine["theta_"] = np.arctan2(-x[1], x[0]) + np.pi  # the star moves against it
        speed, found = best[1], found | {name + letter: value for name, value in mine.items()}
    return found


def orbit(period, amplitude, e, w, theta) -> tuple[ca.SX, ca.SX, ca.SX]:
    """Position and velocity relative to the star, sight along y, and mass in Suns."""
    h, k, inverse = e * ca.cos(w), e * ca.sin(w), ca.sqrt(1 - e**2)
    mass = amplitude / METRES * STAR * inverse * (period / (2 * np.pi * SUN * STAR)) ** (1 / 3)
    a = (SUN * (STAR + mass) * (period / (2 * np.pi)) ** 2) ** (1 / 3)
    r = a * inverse**2 / (1 + h * ca.cos(theta) + k * ca.sin(theta))
    speed = 2 * np.pi * a / period / inverse
    turned = ca.vertcat(-ca.sin(theta) - k, ca.cos(theta) + h)
    return r * ca.vertcat(ca.cos(theta), ca.sin(theta)), speed * turned, mass


def main(out: Path = Path("out")) -> None:
    t, speed, error, where = data()
    zeros = np.column_stack([where == x for x in TELESCOPES]).astype(float)
    first = guesses(t, speed, np.hypot(error, 2.5), zeros)
    first |= {f"gamma_{x}": 0.0 for x in TELESCOPES} | dict(e_b=0.1, w_b=0.0, e_c=0.2, w_c=0.0)
    c, (q, v) = vi.Parameters(**first), vi.coordinates("x_b", "y_b", "x_c", "y_c")
    r_b, w_b, m_b = orbit(c.P_b, c.K_b, c.e_b, c.w_b, c.theta_b)
    r_c, w_c, m_c = orbit(c.P_c, c.K_c, c.e_c, c.w_c, c.theta_c)
    total, drift = STAR + m_b + m_c, m_b * v[:2] + m_c * v[2:]
    kinetic = (m_b * ca.sumsqr(v[:2]) + m_c * ca.sumsqr(v[2:]) - ca.sumsqr(drift) / total) / 2
    pull = STAR * (m_b / ca.norm_2(q[:2]) + m_c / ca.norm_2(q[2:]))
    pull += m_b * m_c / ca.norm_2(q[:2] - q[2:])
    system = vi.System(q, v, kinetic + SUN * pull, params=c)
    star, gammas = -METRES * drift[1] / total, dict(k=c.gamma_k, j=c.gamma_j, a=c.gamma_a)
    seen = [
        vi.Measurement(star + gamma, t[at], speed[at], error[at], jitter=vi.free(2.5, 0, 10))
        for gamma, at in ((gammas[x], where == x) for x in TELESCOPES)
    ]
    start = dict(q0=ca.vertcat(r_b, r_c), v0=ca.vertcat(w_b, w_c), t0=t[0], h=2.0)
    found = vi.fit(system, vi.gauss(4), data=seen, unknown=list(first), **start)
    z = dict(zip(found.names, zip(found.estimates, found.sigma, strict=True), strict=True))
    for x, m, spread in zip(TELESCOPES, found.data[0], found.jitter_sigma[0], strict=True):
        z[f"noise_{x}"] = m.level, spread
    for name, (median, low, high, likeliest) in PUBLISHED.items():
        off = (z[name][0] - median) / (high if z[name][0] > median else low)
        beside = f"{(z[name][0] - likeliest) / z[name][1]:+.2f} σ"
        print(f"{name:8}{z[name][0]:9.3f} ± {z[name][1]:.3f}, radvel {likeliest}: {beside}, "
              f"published {median} +{high} −{low}: {off:+.2f} of it")  # fmt: skip
    start |= dict(data=found.data[0], params=found.params | dict(e_c=PUBLISHED["e_c"][0]))
    held = vi.fit(system, vi.gauss(4), unknown=[x for x in first if x != "e_c"], **start)
    print(f"with the published e_c χ² is {held.chi_squared - found.chi_squared:.2f} more")
    for x in ("P_b", "P_c"):
        print(f"{x}  found {z[x][0]:.3f}   theory {PUBLISHED[x][0]}")
    figure, (path, below) = plt.subplots(1, 2, figsize=(12, 4), layout="constrained")
    path.plot((best := found.trajectories[0]).t, best.value(star), lw=0.7, label="fitted")
    for k, (x, m, r) in enumerate(zip(gammas, found.data[0], found.residuals[0], strict=True)):
        level, style = m.values[:, 0] - found.params[f"gamma_{x}"], dict(ms=3, lw=0.6, label=x)
        path.errorbar(m.t, level, m.spread[:, 0], fmt=".", **style)
        below.plot(m.t, r, ".", ms=3, color=f"C{k + 1}")
    path.set(xlabel="JD − 2450000", ylabel="m/s of the star along the sight")
    below.set(xlabel="JD − 2450000", ylabel="residual / σ")
    path.legend(fontsize="small", ncols=4)
    out.mkdir(parents=True, exist_ok=True)
    figure.savefig(out / "exoplanets.png", dpi=120)


if __name__ == "__main__":
    main(Path(sys.argv[1] if sys.argv[1:] else "out"))

"""Two planets in the measured wobble of their star: the orbits of HD 164922 b and c.

Claim: from 401 radial velocities and guesses that a periodogram gives, both periods come out within
the published errors, amplitudes and eccentricities within two of them, with standard errors of that
size; planets attract each other, their start is written in the elements of their orbits.
Source: data of the package radvel (Fulton et al., PASP 130 (2018) 044504), whose own posterior is
what is published here; mass of the star: Fulton et al., ApJ 830 (2016) 46.
Run: python examples/exoplanets.py [folder of the picture], after pip install radvel
"""

import sys
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path

import casadi as ca
import matplotlib.pyplot as plt
import numpy as np

import varint as vi

plt.style.use("tableau-colorblind10")
SUN, STAR = 0.01720209895**2, 0.874  # GM in AU³/day² of the Sun, and of the star in those
METRES = 149597870700.0 / 86400  # m/s in an AU a day
JITTER = dict(k=2.5, j=2.9, a=1.0)  # m/s of star and telescope beside the stated errors
PUBLISHED = dict(  # median and half of the 68 % interval
    P_b=(1198.4, 4.1), K_b=(7.23, 0.25), e_b=(0.085, 0.036),
    P_c=(75.73, 0.043), K_c=(2.21, 0.30), e_c=(0.29, 0.17),
)  # fmt: skip


def data() -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Days, velocities, their errors in m/s, and the telescope of each."""
    try:
        files = distribution("radvel").files or []
    except PackageNotFoundError:
        sys.exit("This example reads data of the package radvel: pip install radvel")
    [path] = [x.locate() for x in files if x.name == "164922_fixed.txt"]
    rows = [line.split() for line in Path(path).read_text().splitlines()[1:]]
    t, speed, error = np.array([row[:3] for row in rows], dtype=float).T
    return t - 2450000, speed, error, np.array([row[3] for row in rows])


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
        speed = best[1]
        found |= {name + letter: value for name, value in mine.items()}
    return found


def orbit(period, amplitude, h, k, theta) -> tuple[ca.SX, ca.SX, ca.SX]:
    """Position and velocity relative to the star, sight along y, and mass in Suns."""
    inverse = ca.sqrt(1 - h**2 - k**2)
    mass = amplitude / METRES * STAR * inverse * (period / (2 * np.pi * SUN * STAR)) ** (1 / 3)
    mu = SUN * (STAR + mass)
    a = (mu * (period / (2 * np.pi)) ** 2) ** (1 / 3)
    r = a * inverse**2 / (1 + h * ca.cos(theta) + k * ca.sin(theta))
    speed = 2 * np.pi * a / period / inverse
    position = r * ca.vertcat(ca.cos(theta), ca.sin(theta))
    return position, speed * ca.vertcat(-ca.sin(theta) - k, ca.cos(theta) + h), mass


def main(out: Path = Path("out")) -> None:
    t, speed, error, where = data()
    sigma = np.hypot(error, [JITTER[x] for x in where])
    first = guesses(t, speed, sigma, np.column_stack([where == x for x in JITTER]).astype(float))
    first |= {f"gamma_{x}": 0.0 for x in JITTER} | dict(h_b=0.0, k_b=0.0, h_c=0.0, k_c=0.0)
    c, (q, v) = vi.Parameters(**first), vi.coordinates("x_b", "y_b", "x_c", "y_c")
    r_b, w_b, m_b = orbit(c.P_b, c.K_b, c.h_b, c.k_b, c.theta_b)
    r_c, w_c, m_c = orbit(c.P_c, c.K_c, c.h_c, c.k_c, c.theta_c)
    total, drift = STAR + m_b + m_c, m_b * v[:2] + m_c * v[2:]
    kinetic = (m_b * ca.sumsqr(v[:2]) + m_c * ca.sumsqr(v[2:]) - ca.sumsqr(drift) / total) / 2
    pull = STAR * (m_b / ca.norm_2(q[:2]) + m_c / ca.norm_2(q[2:]))
    pull += m_b * m_c / ca.norm_2(q[:2] - q[2:])
    system = vi.System(q, v, kinetic + SUN * pull, params=c)
    star, gammas = -METRES * drift[1] / total, dict(k=c.gamma_k, j=c.gamma_j, a=c.gamma_a)
    seen = [
        vi.Measurement(star + gamma, t[where == x], speed[where == x], sigma[where == x])
        for x, gamma in gammas.items()
    ]
    start = dict(q0=ca.vertcat(r_b, r_c), v0=ca.vertcat(w_b, w_c), t0=t[0], h=4.0)
    found = vi.fit(system, vi.gauss(4), data=seen, unknown=list(first), **start)
    print(f"χ² = {found.chi_squared:.0f} for {found.freedom} degrees of freedom")
    z = dict(zip(found.names, zip(found.estimates, found.sigma, strict=True), strict=True))
    for x in "bc":
        i = [found.names.index(f"{name}_{x}") for name in "hk"]
        e = np.hypot(*found.estimates[i])
        slope = found.estimates[i] / e
        z[f"e_{x}"] = e, np.sqrt(slope @ found.covariance[np.ix_(i, i)] @ slope)
    for name, (median, half) in PUBLISHED.items():
        (value, spread), off = z[name], abs(z[name][0] - median) / half
        print(f"{name}  {value:8.3f} ± {spread:.3f}, published {median} ± {half}: {off:.2f} σ")
    for x in "bc":
        print(f"P_{x}  found {z[f'P_{x}'][0]:.3f}   theory {PUBLISHED[f'P_{x}'][0]}")
    figure, (path, below) = plt.subplots(1, 2, figsize=(12, 4), layout="constrained")
    fine = np.linspace(t[0], t[-1], 4000)
    path.plot(fine, found.trajectories[0].at(fine).value(star), lw=0.7, label="fitted")
    for k, (x, m, r) in enumerate(zip(gammas, seen, found.residuals[0], strict=True)):
        level = m.values - found.params[f"gamma_{x}"]
        path.errorbar(m.t, level[:, 0], m.sigma[:, 0], fmt=".", ms=3, lw=0.6, label=x)
        below.plot(m.t, r, ".", ms=3, color=f"C{k + 1}")
    path.set(xlabel="JD − 2450000", ylabel="m/s", title="Velocity of the star along the sight")
    path.legend(fontsize="small", ncols=4)
    below.set(xlabel="JD − 2450000", ylabel="residual / σ", title="What is left")
    out.mkdir(parents=True, exist_ok=True)
    figure.savefig(out / "exoplanets.png", dpi=120)


if __name__ == "__main__":
    main(Path(sys.argv[1] if sys.argv[1:] else "out"))

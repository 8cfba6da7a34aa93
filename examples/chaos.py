"""Order and chaos: sections of Hénon–Heiles, of the double pendulum, and the standard map; Lyapunov
exponents, MEGNO and frequencies from the same runs.

Claim: sections turn from curves to a sea as the energy grows; exponents come in pairs ±λ to
round-off; MEGNO tends to 2 on a torus; the kicked rotor stretches by ln(K/2) a kick, and the
pendulum's frequency is that of its elliptic integral.
Source: Hénon & Heiles, Astronomical Journal 69 (1964) 73; Chirikov, Physics Reports 52 (1979) 263;
Cincotta & Simó, Astronomy and Astrophysics Supplement 147 (2000) 205.
Run: python examples/chaos.py [folder of the picture]
"""

import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import varint as vi

plt.style.use("tableau-colorblind10")
orbits = vi.orbits


def henon_heiles(energy: float) -> orbits.Section:
    """The section x = 0 at one energy, of starts along y."""
    system = vi.models.henon_heiles().system
    y = np.linspace(-0.3, 0.45, 9)
    y = y[y**2 / 2 - y**3 / 3 < 0.98 * energy]
    q0 = np.column_stack([0 * y, y])
    starts = orbits.starts_at_energy(system, energy, q0=q0, v0=[0, 0], free=system.v[0])
    runs = vi.ensemble(system, vi.gauss(6), **starts, h=0.3, steps=4000)
    return orbits.poincare_section(runs, system.q[0])


def double_pendulum(energy: float) -> orbits.Section:
    """The section θ₂ = 0 of the double pendulum, of starts at different θ₁."""
    system = vi.models.double_pendulum().system
    theta = np.linspace(-0.9, 0.9, 8)
    q0 = np.column_stack([theta, 0 * theta])
    starts = orbits.starts_at_energy(system, energy, q0=q0, v0=[0, 0], free=system.v[1])
    runs = vi.ensemble(system, vi.gauss(6), **starts, h=0.05, steps=4000)
    return orbits.poincare_section(runs, system.q[1])


def standard_map(K: float) -> list[np.ndarray]:
    """Angles and momenta of the kicked rotor between kicks, of several starts."""
    model = vi.models.kicked_rotor(K=K)
    starts = dict(q0=np.linspace(0.2, 6.0, 14)[:, None], v0=np.linspace(-2.6, 2.6, 14)[:, None])
    runs = vi.ensemble(model.system, vi.trapezoidal(), **starts, h=1.0, steps=900)
    turn = 2 * np.pi
    theta, p = np.asarray(runs.q)[:, :, 0], np.asarray(runs.p)[:, :, 0]
    between = p - K / 2 * np.sin(theta)
    return [
        np.column_stack([a % turn, (b + np.pi) % turn - np.pi])
        for a, b in zip(theta, between, strict=True)
    ]


def numbers() -> None:
    """Exponents, MEGNO and a frequency beside what they must be."""
    model = vi.models.henon_heiles(q0=(0.0, -0.25), total=1 / 8)
    start = dict(q0=model.q0, v0=model.v0)
    chaotic = vi.simulate(model.system, vi.gauss(6), **start, h=0.3, steps=10_000)
    found = orbits.lyapunov_spectrum(chaotic)
    print(f"Hénon–Heiles, E = 1/8: {found}, pairs to {found.pairing:.0e}")
    model = vi.models.henon_heiles(q0=(0.0, 0.1), total=1 / 12)
    start = dict(q0=model.q0, v0=model.v0)
    ordered = vi.simulate(model.system, vi.gauss(6), **start, h=0.3, steps=80_000, save_every=100)
    print(f"MEGNO at E = 1/12      found {orbits.megno(ordered).value:.4f}   theory 2.0000")
    rotor = vi.models.kicked_rotor(K=20.0)
    kicked = vi.simulate(
        rotor.system, vi.trapezoidal(), q0=rotor.q0, v0=rotor.v0, h=1.0, steps=8_000
    )
    stretch = orbits.megno(kicked).exponent
    print(f"kicked rotor, K = 20   found {stretch:.4f}   theory {np.log(10):.4f}")
    swing = vi.models.pendulum(theta0=2.0)
    motion = vi.simulate(swing.system, vi.gauss(8), **swing.start)
    nu = orbits.frequencies(motion, swing.system.q, 3).frequencies[0]
    exact = 2 * np.pi / vi.models.pendulum_period(2.0, np.sqrt(9.81))
    print(f"pendulum's frequency   found {nu:.10f}   exact {exact:.10f}")


def main(out: Path = Path("out")) -> None:
    figure, axes = plt.subplots(2, 3, figsize=(12, 7.6), layout="constrained")
    sections = [(f"Hénon–Heiles, E = {name}", henon_heiles(e)) for name, e in ENERGIES.items()]
    sections.append(("double pendulum, E = −20", double_pendulum(-20.0)))
    for axis, (title, section) in zip(axes.flat, sections, strict=False):
        for i in np.unique(section.motion):
            axis.plot(*section.of(i).T, ".", ms=1.2)
        if section.boundary:
            axis.contour(*section.boundary, levels=[0.0], colors="0.4", linewidths=1)
        axis.set(xlabel=section.names[0], ylabel=section.names[1], title=title)
    for axis, K in zip(axes.flat[4:], (0.6, 1.2), strict=True):
        for points in standard_map(K):
            axis.plot(*points.T, ".", ms=0.8)
        axis.set(xlabel="$\\theta$", ylabel="$P$", title=f"kicked rotor, K = {K}")
    numbers()
    out.mkdir(parents=True, exist_ok=True)
    figure.savefig(out / "chaos.png", dpi=120)


ENERGIES = {"1/12": 1 / 12, "1/8": 1 / 8, "1/6": 0.1666}

if __name__ == "__main__":
    main(Path(sys.argv[1] if sys.argv[1:] else "out"))

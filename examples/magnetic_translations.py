"""A uniform magnetic field: translations with a gauge term, whatever the vector potential.

Claim: a charge in a uniform field has two translations whose conserved quantities p·ξ − K fix the
centre of its circle, and a rotation. In the Landau gauge one translation is plain and one needs a
gauge term, in the symmetric gauge both do; the conserved quantities, m v_x − e B y and m v_y + e B
x, are the same. Rules keep them to round-off. Translations commute, but the two quantities do not:
their Poisson bracket is −e B, a central charge, in every gauge.
Source: Landau & Lifshitz, Quantum Mechanics, §112 (their quantum form); Mechanics of a charge:
Jackson, §12.
Run: python examples/magnetic_translations.py [folder of the picture]
"""

import sys
from pathlib import Path

import casadi as ca
import matplotlib.pyplot as plt
import numpy as np

import varint as vi

plt.style.use("tableau-colorblind10")
M, E, B = 1.5, 0.8, 2.0
START = dict(q0=[1.0, 0.2], v0=[0.3, 0.9])


def charge(gauge: str) -> vi.System:
    """A charge in a uniform field along z."""
    q, v = vi.coordinates("x", "y")
    c = vi.Parameters(m=M, e=E, B=B)
    potential = {"symmetric": (q[0] * v[1] - q[1] * v[0]) / 2, "Landau": q[0] * v[1]}[gauge]
    return vi.System(q, v, c.m * ca.sumsqr(v) / 2 + c.e * c.B * potential, params=c)


def main(out: Path = Path("out")) -> None:
    figure, (orbit, error) = plt.subplots(1, 2, figsize=(11, 4), layout="constrained")
    centre = 1.0 + M * 0.9 / (E * B), 0.2 - M * 0.3 / (E * B)
    for gauge in ("symmetric", "Landau"):
        system = charge(gauge)
        motion = vi.simulate(system, vi.gauss(2), h=0.05, steps=20_000, **START)
        conserved = motion.conserved()
        print(f"{gauge} gauge:\n{vi.symmetries(system, vi.gauss(2))}\n")
        p = ca.SX.sym("p", 2)  # v = (p − e A)/m, so that J becomes a function of q and p
        velocity = ca.substitute(system.v, system.v, (p - (system.momentum - M * system.v)) / M)
        first, second = (
            ca.substitute(m.symmetry.quantity, system.v, velocity)
            for m in conserved
            if "translation along" in m.symmetry.name
        )
        gradients = [(ca.gradient(j, system.q), ca.gradient(j, p)) for j in (first, second)]
        bracket = ca.dot(gradients[0][0], gradients[1][1]) - ca.dot(
            gradients[0][1], gradients[1][0]
        )
        value = ca.Function("bracket", [system.q, p, system.c], [bracket])(
            START["q0"], [0.1, 0.2], [M, E, B]
        )
        print(f"bracket of the quantities     found {float(value):.12f}   exact {-E * B:.12f}")
        moved = {
            m.symmetry.name[-1]: m for m in conserved if "translation along" in m.symmetry.name
        }
        print(
            f"x of the circle's centre      found {moved['y'].values[-1] / (E * B):.12f}   exact "
            f"{centre[0]:.12f}"
        )
        print(
            f"y of the circle's centre      found {-moved['x'].values[-1] / (E * B):.12f}   exact "
            f"{centre[1]:.12f}"
        )
        orbit.plot(
            *motion.q[:120].T,
            lw=1,
            ls={"symmetric": "-", "Landau": "--"}[gauge],
            label=f"{gauge} gauge",
        )
        for m in conserved:
            if m.symmetry.tau.is_zero():
                so_far = np.maximum.accumulate(np.abs(m.error)) + 1e-18
                error.semilogy(motion.t, so_far, lw=1, label=f"{m.symmetry.name}, {gauge}")
    orbit.plot(*centre, "k+", ms=10)
    orbit.set(aspect="equal", xlabel="x", ylabel="y", title="The circle and its conserved centre")
    error.set(
        xlabel="t",
        ylabel="largest relative change so far",
        title="Momentum maps",
        ylim=(1e-17, 1e-11),
    )
    orbit.legend(fontsize="small", loc="upper right")
    error.legend(fontsize="x-small")
    out.mkdir(parents=True, exist_ok=True)
    figure.savefig(out / "magnetic_translations.png", dpi=120)


if __name__ == "__main__":
    main(Path(sys.argv[1] if sys.argv[1:] else "out"))

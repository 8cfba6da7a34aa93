"""Galilean boosts: the centre of mass moves uniformly, because L changes by a total derivative
only.

Claim: under x → x + s t the Lagrangian changes by d/dt of K = Σ m x; conserved is t P − M X, so
that X moves on a straight line with the velocity P/M. Every rule keeps this to round-off, and
uniform gravity does not destroy it: it moves all masses alike, so the distance between them swings
as it does without (the equivalence principle).
Source: Landau & Lifshitz, Mechanics, §8; Lévy-Leblond, Galilei group and Galilean invariance, 1971.
Run: python examples/galilean_boosts.py [folder of the picture]
"""

import sys
from pathlib import Path

import casadi as ca
import matplotlib.pyplot as plt
import numpy as np

import varint as vi

plt.style.use("tableau-colorblind10")
START = dict(q0=[0.0, 0.0, 1.0, 0.3], v0=[1.0, 6.0, 0.2, 5.0])


def thrown(g: float) -> vi.System:
    """Two masses on a spring, in uniform gravity."""
    q, v = vi.coordinates("x1", "y1", "x2", "y2")
    c = vi.Parameters(m1=1.0, m2=2.0, k=40.0, g=g)
    kinetic = c.m1 * ca.sumsqr(v[:2]) / 2 + c.m2 * ca.sumsqr(v[2:]) / 2
    spring = c.k * (ca.norm_2(q[:2] - q[2:]) - 1) ** 2 / 2
    return vi.System(q, v, kinetic - spring - c.g * (c.m1 * q[1] + c.m2 * q[3]), params=c)


def main(out: Path = Path("out")) -> None:
    apart = []
    figure, (path, error) = plt.subplots(1, 2, figsize=(11, 4), layout="constrained")
    for g in (0.0, 9.81):
        system = thrown(g)
        found = vi.symmetries(system)
        print(f"g = {g}:\n{found}\n")
        motion = vi.simulate(system, vi.gauss(2), h=0.005, steps=240, **START)
        x, y = (motion.q[:, i] / 3 + 2 * motion.q[:, i + 2] / 3 for i in (0, 1))
        apart.append(motion.q[:, :2] - motion.q[:, 2:])
        t = motion.t[-1]
        for name, value, at, speed, fall in (
            ("X", x[-1], 2 / 3, 1.4 / 3, 0.0),
            ("Y", y[-1], 0.2, 16 / 3, g),
        ):
            exact = at + speed * t - fall * t**2 / 2
            print(f"{name} of the centre of mass        found {value:.12f}   exact {exact:.12f}")
        path.plot(motion.q[:, 0], motion.q[:, 1], lw=0.8, label=f"mass 1, g = {g}")
        path.plot(x, y, "--", lw=1.5, label=f"centre of mass, g = {g}")
        for quantity in motion.conserved():
            if "boost" in quantity.symmetry.name:
                so_far = np.maximum.accumulate(np.abs(quantity.error)) + 1e-18
                error.semilogy(motion.t, so_far, lw=1, label=f"{quantity.symmetry.name}, g = {g}")
    print(
        "largest change of the vector between the masses by gravity: "
        f"{np.abs(apart[1] - apart[0]).max():.1e}"
    )
    span = [np.linalg.norm(one, axis=1).max() for one in apart]
    print(f"longest spring, in free fall          found {span[1]:.12f}   exact {span[0]:.12f}")
    path.set(xlabel="x", ylabel="y", title="Two masses on a spring, thrown")
    error.set(
        xlabel="t",
        ylabel="largest relative change so far",
        title="t P − M X (+ ½ M g t²)",
        ylim=(1e-18, 1e-13),
    )
    path.legend(fontsize="small")
    error.legend(fontsize="small")
    out.mkdir(parents=True, exist_ok=True)
    figure.savefig(out / "galilean_boosts.png", dpi=120)


if __name__ == "__main__":
    main(Path(sys.argv[1] if sys.argv[1:] else "out"))

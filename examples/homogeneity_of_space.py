"""Homogeneity of space: what does not ask where it is conserves momentum.

Claim: for three bodies that feel each other alone, translations are found as symmetries and total
momentum is kept to round-off by rules of every order; tie one body to a place and both translations
are gone. What P_x then loses is the impulse of the tie, −k ∫ x₁ dt, while the centre of mass of the
free bodies runs on a straight line.
Source: Landau & Lifshitz, Mechanics, §7; Noether, Invariante Variationsprobleme, 1918.
Run: python examples/homogeneity_of_space.py [folder of the picture]
"""

import sys
from pathlib import Path

import casadi as ca
import matplotlib.pyplot as plt
import numpy as np

import varint as vi

plt.style.use("tableau-colorblind10")
MASSES = (1.0, 0.7, 0.4)
START = dict(q0=[1, 0, -0.5, 0.8, -0.4, -0.9], v0=[0.1, 0.5, -0.4, 0.1, 0.6, -0.3])


def bodies(tied: float = 0.0) -> vi.System:
    """Three bodies with springs of length 1 between them; `tied` is the stiffness that ties the
    first to the origin.
    """
    q, v = vi.coordinates("x1", "y1", "x2", "y2", "x3", "y3")
    at = [q[2 * i : 2 * i + 2] for i in range(3)]
    kinetic = sum(m * ca.sumsqr(v[2 * i : 2 * i + 2]) / 2 for i, m in enumerate(MASSES))
    springs = sum((ca.norm_2(at[i] - at[j]) - 1) ** 2 for i, j in ((0, 1), (0, 2), (1, 2)))
    return vi.System(q, v, kinetic - 2 * springs - tied * ca.sumsqr(at[0]) / 2)


def main(out: Path = Path("out")) -> None:
    free, tied = bodies(), bodies(tied=0.5)
    print(
        vi.symmetries(free),
        vi.symmetries(tied),
        sep="\n\nthe first body tied to the origin:\n",
        end="\n\n",
    )
    exact = MASSES[0] * 0.1 - MASSES[1] * 0.4 + MASSES[2] * 0.6
    figure, (kept, lost) = plt.subplots(1, 2, figsize=(11, 4), layout="constrained")
    for rule in (vi.trapezoidal(), vi.gauss(2), vi.composition("blanes-moan6")):
        motion = vi.simulate(free, rule, h=0.02, steps=20_000, **START)
        momentum = motion.conserved()["translation along x"]
        print(f"P_x by {rule!s:28}  found {momentum.values[-1]:.14f}   exact {exact:.14f}")
        kept.plot(motion.t, np.maximum.accumulate(np.abs(momentum.error)), lw=1, label=str(rule))
    x = motion.q[:, ::2] @ np.array(MASSES) / sum(MASSES)
    line = x[0] + exact / sum(MASSES) * motion.t[-1]
    print(f"X of the centre of mass                found {x[-1]:.12f}   exact {line:.12f}")
    held = vi.simulate(tied, vi.gauss(2), h=0.02, steps=1000, **START)
    impulse = -0.5 * held.h * (held.q[1:, 0] + held.q[:-1, 0]).sum() / 2
    change = (held.p[-1] - held.p[0])[::2].sum()
    print(f"impulse of the tie                     found {change:.6f}   theory {impulse:.6f}")
    for name, run in (("free", motion[:1001]), ("first body tied", held)):
        lost.plot(run.t, run.p[:, ::2].sum(axis=1), label=name)
    kept.set(
        xlabel="t",
        ylabel="largest relative change so far",
        title="Total momentum, free bodies",
        yscale="log",
    )
    lost.set(xlabel="t", ylabel="$P_x$", title="A tied body takes the symmetry away")
    kept.legend(fontsize="small")
    lost.legend(fontsize="small")
    out.mkdir(parents=True, exist_ok=True)
    figure.savefig(out / "homogeneity_of_space.png", dpi=120)


if __name__ == "__main__":
    main(Path(sys.argv[1] if sys.argv[1:] else "out"))

"""Isotropy of space: what has no preferred direction conserves angular momentum.

Claim: a central force in space has three rotations, kept to round-off; a field along z leaves the
one about z. The Runge–Lenz vector of the Kepler problem belongs to no point symmetry: it is not
listed, and rules do not keep it. They keep it to their order, 4 here. A central motion stays in a
plane; in the field L_x changes by the torque ∫ y F dt.
Source: Landau & Lifshitz, Mechanics, §9, 15.
Run: python examples/isotropy.py [folder of the picture]
"""

import sys
from pathlib import Path

import casadi as ca
import matplotlib.pyplot as plt
import numpy as np

import varint as vi

plt.style.use("tableau-colorblind10")
START = dict(q0=[1.0, 0.0, 0.2], v0=[0.1, 0.9, 0.3])


def kepler(field: float = 0.0) -> vi.System:
    """A planet, and a homogeneous field along z."""
    q, v = vi.coordinates("x", "y", "z")
    return vi.System(q, v, ca.sumsqr(v) / 2 + 1 / ca.norm_2(q) + field * q[2])


def turn(system: vi.System, h: float) -> np.ndarray:
    """Change of the Runge–Lenz vector in 40 units of time."""
    q, p = system.q, system.momentum
    motion = vi.simulate(system, vi.gauss(2), h=h, duration=40.0, **START)
    runge = motion.value(ca.cross(p, ca.cross(q, p)) - q / ca.norm_2(q))
    return runge[-1] - runge[0]


def main(out: Path = Path("out")) -> None:
    figure, axes = plt.subplots(1, 2, figsize=(11, 4), layout="constrained", sharey=True)
    exact = np.cross(START["q0"], START["v0"])
    for panel, field, title in zip(
        axes, (0.0, 0.05), ("central force", "central force and a field along z"), strict=True
    ):
        system = kepler(field)
        found = vi.symmetries(system, vi.gauss(2))
        print(f"{title}:\n{found}\n")
        motion = vi.simulate(system, vi.gauss(2), h=0.02, steps=10_000, **START)
        q, p = system.q, system.momentum
        momentum = motion.value(ca.cross(q, p))
        runge = motion.value(ca.cross(p, ca.cross(q, p)) - q / ca.norm_2(q))
        for i, axis in enumerate("xyz"):
            if f"rotation about {axis}" in [s.name for s in found]:
                print(
                    f"L_{axis}                          found {momentum[-1, i]:.14f}   exact "
                    f"{exact[i]:.14f}"
                )
            change = np.maximum.accumulate(np.abs(momentum[:, i] - momentum[0, i])) + 1e-17
            panel.semilogy(motion.t, change, lw=1, label=f"$L_{axis}$")
        panel.semilogy(
            motion.t,
            np.linalg.norm(runge - runge[0], axis=1) + 1e-17,
            "k",
            lw=0.6,
            label="Runge–Lenz",
        )
        panel.set(xlabel="t", ylabel="change", title=title, ylim=(1e-17, 1e1))
        panel.legend(fontsize="small", loc="center right")
        if not field:
            normal = np.array(exact) / np.linalg.norm(exact)
            print(
                f"largest distance from the plane across L: {np.abs(motion.q @ normal).max():.1e}"
            )
            turns = [np.abs(turn(system, h)).max() for h in (0.04, 0.02)]
            print(
                f"order of the Runge–Lenz vector  found {np.log2(turns[0] / turns[1]):.3f}   "
                "theory 4"
            )
        else:
            torque = field * motion.h * motion.q[:-1, 1].sum()
            print(
                f"change of L_x                found {momentum[-1, 0] - momentum[0, 0]:.6f}   "
                f"theory {torque:.6f}"
            )
    out.mkdir(parents=True, exist_ok=True)
    figure.savefig(out / "isotropy.png", dpi=120)


if __name__ == "__main__":
    main(Path(sys.argv[1] if sys.argv[1:] else "out"))

"""Homogeneity of time: a Lagrangian without t conserves energy; a fixed grid keeps it to the rule's
order.

Claim: a fixed step breaks the shift of time, so that energy oscillates with an amplitude ∝ h^order,
yet does not drift where explicit Runge–Kutta methods do. In a potential that turns, neither energy
nor angular momentum is conserved but their combination H − Ω L_z is: time shift and rotation
together.
Source: Hairer, Lubich & Wanner, Geometric Numerical Integration, IX.8; Ge & Marsden, Physics
Letters A 133 (1988).
Run: python examples/homogeneity_of_time.py [folder of the picture]
"""

import sys
from pathlib import Path

import casadi as ca
import matplotlib.pyplot as plt
import numpy as np

import varint as vi

plt.style.use("tableau-colorblind10")


def turning() -> vi.System:
    """A particle in a saddle-shaped well that turns at the rate Ω."""
    q, v, t = *vi.coordinates("x", "y"), vi.time()
    c = vi.Parameters(Omega=0.7)
    turn, cross = ca.cos(c.Omega * t), ca.sin(c.Omega * t)
    x, y = turn * q[0] + cross * q[1], turn * q[1] - cross * q[0]
    return vi.System(q, v, ca.sumsqr(v) / 2 - x**2 / 2 - y**2 - x**4, params=c, t=t)


def main(out: Path = Path("out")) -> None:
    pendulum = vi.models.pendulum(theta0=1.0)
    start = dict(q0=pendulum.q0, v0=pendulum.v0)
    figure, (drift, jacobi) = plt.subplots(1, 2, figsize=(11, 4), layout="constrained")
    for rule in (vi.midpoint(), vi.gauss(2), vi.lobatto(4)):
        sizes = []
        for h in (0.04, 0.02):
            motion = vi.simulate(pendulum.system, rule, h=h, duration=400, **start)
            sizes.append(np.ptp(motion.energy))
        print(
            f"order of the energy error, {rule!s:10}  found {np.log2(sizes[0] / sizes[1]):.2f}   "
            f"theory {rule.order}"
        )
        slope = vi.diagnostics.energy_slope(pendulum.system, rule, h=0.04, steps=10_000, **start)
        print(f"  {slope}")
        drift.semilogy(
            slope.t, np.abs(slope.energy - slope.energy[0]) + 1e-17, lw=0.3, label=str(rule)
        )
    drift.set(
        xlabel="t", ylabel="|H − H₀|", title="Pendulum: bounded energy errors", ylim=(1e-16, 1e-1)
    )
    drift.legend(fontsize="small", loc="lower right")

    system = turning()
    print(vi.symmetries(system))
    motion = vi.simulate(system, vi.gauss(4), q0=[0.5, 0.0], v0=[0.0, 0.4], h=0.05, steps=1000)
    (kept,) = motion.conserved()
    spin = motion.value(system.q[0] * system.momentum[1] - system.q[1] * system.momentum[0])
    print(f"H − Ω L_z                    found {kept.values[-1]:.9f}   exact {kept.values[0]:.9f}")
    for values, name in ((motion.energy, "H"), (spin, "$L_z$"), (kept.values, "$H − Ω L_z$")):
        jacobi.plot(motion.t, values, lw=1, label=name)
    jacobi.set(xlabel="t", title="A well that turns", ylim=(0.02, 0.33))
    jacobi.legend(fontsize="small", loc="upper right", ncols=3)
    out.mkdir(parents=True, exist_ok=True)
    figure.savefig(out / "homogeneity_of_time.png", dpi=120)


if __name__ == "__main__":
    main(Path(sys.argv[1] if sys.argv[1:] else "out"))

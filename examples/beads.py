"""Beads on a turning hoop and on a turning wire: constraints that move are built into the
coordinates.

Claim: above Ω² = g/R the lowest point of the hoop is unstable and the bead swings about cos θ =
g/(Ω² R); on the wire it is flung out as cosh Ωt. Not the energy but the Jacobi integral v·p − L is
conserved.
Source: Goldstein, Classical Mechanics, 1.6 and 2.7.
Run: python examples/beads.py [folder of the picture]
"""

import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import varint as vi

plt.style.use("tableau-colorblind10")


def main(out: Path = Path("out")) -> None:
    figure, (fork, phase, wire) = plt.subplots(1, 3, figsize=(13, 4), layout="constrained")
    critical = np.sqrt(9.81)
    speeds = np.linspace(0.1, 8.0, 200)
    rest = np.arccos(np.minimum(1.0, 9.81 / speeds**2))
    fork.plot(speeds, rest, "k--", lw=1, label="cos θ = g/(Ω² R)")
    fork.plot(speeds, -rest, "k--", lw=1)
    model = vi.models.rotating_hoop(theta0=0.05)
    for Omega in np.linspace(0.5, 7.5, 15):  # one system, its parameter varied
        motion = vi.simulate(model.system, vi.gauss(3), **model.start, params={"Omega": Omega})
        fork.plot(
            [Omega, Omega], [motion.q.min(), motion.q.max()], "-", lw=3, color="C1", alpha=0.6
        )
    fork.axvline(critical, color="0.6", lw=0.8)
    fork.set(xlabel="Ω in rad/s", ylabel="θ in rad", title="Rest (dashed) and range from θ₀ = 0.05")
    fork.legend(fontsize="small")

    for theta0 in (0.3, 0.6, 0.9, 1.1, 1.8, 2.2):
        motion = vi.simulate(model.system, vi.gauss(4), q0=theta0, v0=0.0, h=0.02, duration=4.0)
        phase.plot(motion.q, motion.v, lw=0.9)
    phase.set(xlabel="θ in rad", ylabel="dθ/dt in rad/s", title="Ω = 5 rad/s")

    model = vi.models.rotating_hoop()
    swing = vi.simulate(model.system, vi.gauss(6), q0=model.q0, v0=model.v0, h=0.01, steps=20)
    half = vi.simulate(
        model.system,
        vi.gauss(6),
        q0=swing.q[-1],
        p0=swing.p[-1],
        h=0.01,
        steps=200,
        until=model.system.v,
    )
    exact = vi.models.rotating_hoop_period(0.6, R=1.0, Omega=5.0, g=9.81)
    print(
        f"period on one side           found {2 * (0.2 + half.duration):.12f}   exact {exact:.12f}"
    )
    small = vi.models.rotating_hoop(theta0=np.arccos(9.81 / 25) + 1e-4)
    nodes = vi.simulate(small.system, vi.gauss(6), **small.start)
    x = nodes.q[:, 0] - np.arccos(9.81 / 25)
    found = np.arccos(np.sum((x[2:] + x[:-2]) * x[1:-1]) / (2 * np.sum(x[1:-1] ** 2))) / nodes.h
    print(
        f"frequency about the rest     found {found:.6f}   theory "
        f"{5 * np.sin(np.arccos(9.81 / 25)):.6f}"
    )

    model = vi.models.rotating_wire()
    motion = vi.simulate(model.system, vi.gauss(4), **model.start | {"duration": 2.0})
    print(
        f"r(2) on the wire             found {motion.q[-1, 0]:.12f}   exact "
        f"{model.exact(2.0)[0][0, 0]:.12f}"
    )
    wire.plot(motion.q[:, 0] * np.cos(1.5 * motion.t), motion.q[:, 0] * np.sin(1.5 * motion.t))
    wire.set(
        aspect="equal", xlabel="x in m", ylabel="y in m", title="Bead on a turning wire, from above"
    )
    out.mkdir(parents=True, exist_ok=True)
    figure.savefig(out / "beads.png", dpi=120)


if __name__ == "__main__":
    main(Path(sys.argv[1] if sys.argv[1:] else "out"))

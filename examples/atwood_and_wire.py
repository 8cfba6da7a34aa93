"""What ropes, rods and wires carry: Atwood's machines, a pendulum over full turns, a turning wire.

Claim: the multiplier of a constraint is its reaction, at every node and as accurate as the motion:
the ropes of the single and the double Atwood machine carry constant tensions, the rod of a pendulum
in x and y carries m g cos θ + m ℓ θ̇² through full turns, and a wire that turns evenly pushes its
bead with 2 m ṙ Ω.
Source: Goldstein, Classical Mechanics, 3rd ed., §1.6; Hairer & Wanner, Solving ODEs II, VII.1.
Run: python examples/atwood_and_wire.py [folder of the picture]
"""

import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import varint as vi

plt.style.use("tableau-colorblind10")
G, RULE = 9.81, vi.lobatto(5)


def main(out: Path = Path("out")) -> None:
    figure, axes = plt.subplots(1, 3, figsize=(13, 4), layout="constrained")
    m1, m2, m3 = 3.0, 2.0, 1.0
    model = vi.models.atwood(m1, m2)
    motion = vi.simulate(model.system, **model.start)
    print(
        f"Atwood: the rope carries, N     found {-motion.multipliers[-1, 0]:.12f}   exact "
        f"{2 * m1 * m2 * G / 5:.12f}"
    )
    print(
        f"Atwood: x₁ after 2 s, m         found {motion.q[-1, 0]:.12f}   exact "
        f"{model.exact(2.0)[0][0, 0]:.12f}"
    )
    model = vi.models.double_atwood(4.0, m2, m3)
    double = vi.simulate(model.system, **model.start)
    upper = 8 * 4.0 * m2 * m3 * G / (4.0 * (m2 + m3) + 4 * m2 * m3)
    print(
        f"double: the upper rope, N       found {-double.multipliers[-1, 0]:.12f}   exact "
        f"{upper:.12f}"
    )
    print(
        f"double: the lower rope, N       found {-double.multipliers[-1, 1]:.12f}   exact "
        f"{upper / 2:.12f}"
    )
    axes[0].plot(double.t, double.q, label=["4 kg", "2 kg", "1 kg", "pulley"])
    axes[0].set(xlabel="t in s", ylabel="x downwards in m", title="Double Atwood machine")
    axes[0].legend()

    # faster than the separatrix, 2 √(g/ℓ) = 6.26 rad/s: the rod pulls below and, near the top,
    # pushes
    for rate, name in ((6.6, "a full turn"), (4.0, "a swing")):
        model = vi.models.pendulum_cartesian(theta0=0.0, thetadot0=rate)
        turning = vi.simulate(model.system, RULE, **model.start)
        q, v = model.exact(turning.t)
        tension = -2 * turning.multipliers[:, 0]
        exact = -G * q[:, 1] + np.sum(v**2, axis=1)
        k = np.abs(turning.t - 9.7).argmin()
        print(f"{name}: tension at 9.7 s, N  found {tension[k]:.10f}   exact {exact[k]:.10f}")
        inwards = -np.einsum("ij,ij->i", turning.reaction_forces, turning.q)
        print(
            f"{name}: worst error {np.abs(tension - exact).max():.1e} N, of the force on the bob",
            end=" ",
        )
        print(f"{np.abs(inwards - exact).max():.1e} N")
        axes[1].plot(turning.t[:501], tension[:501], label=f"{name}, θ̇₀ = {rate} rad/s")
    axes[1].axhline(0, color="0.6", lw=1, ls="--")
    axes[1].set(xlabel="t in s", ylabel="tension in N", title=f"Pendulum in x and y, {RULE}")
    axes[1].set_ylim(-10, 75)
    axes[1].legend(loc="upper right")

    omega, r0, rdot0 = 1.5, 0.5, -0.3
    model = vi.models.turning_wire(omega, r0, rdot0)
    bead = vi.simulate(model.system, RULE, **model.start)
    grows, falls = np.cosh(omega * bead.t), np.sinh(omega * bead.t)
    rdot = r0 * omega * falls + rdot0 * grows
    push = 2 * omega * rdot
    distance = r0 * grows + rdot0 / omega * falls
    print(
        f"wire: distance after 2 s, m     found {np.hypot(*bead.q[-1]):.12f}   exact "
        f"{distance[-1]:.12f}"
    )
    print(
        f"wire: it pushes with, N         found {bead.multipliers[-1, 0]:.12f}   exact "
        f"{push[-1]:.12f}"
    )
    power = np.einsum("ij,ij->i", bead.reaction_forces, bead.v)
    print(
        f"wire: its power at the end, W   found {power[-1]:.12f}   exact "
        f"{push[-1] * omega * distance[-1]:.12f}"
    )
    axes[2].plot(bead.t, bead.multipliers[:, 0], label="multiplier")
    axes[2].plot(bead.t[::5], push[::5], ".", label="2 m ṙ Ω")
    axes[2].set(xlabel="t in s", ylabel="N", title="Push of a turning wire on its bead")
    axes[2].legend()
    out.mkdir(parents=True, exist_ok=True)
    figure.savefig(out / "atwood_and_wire.png", dpi=120)


if __name__ == "__main__":
    main(Path(sys.argv[1] if sys.argv[1:] else "out"))

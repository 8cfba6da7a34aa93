"""Controls as forces: cart-pole, acrobot and a two-link arm under given pushes and torques.

Claim: a force enters as δ∫L dt + ∫F·δq dt = 0 with values at every node of the rule, so the
momentum balance holds to round-off: the push changes p_x by its time integral, the shoulder's
torque the angular momentum of the arm, while the elbow's motor alone never does.
Source: Marsden & West, Acta Numerica 10 (2001) 357, §3; Spong, IEEE Control Systems 15 (1995) 49.
Run: python examples/machines.py [folder of the picture]
"""

import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import varint as vi

plt.style.use("tableau-colorblind10")
RULE, H, STEPS = vi.gauss(3), 0.01, 400


def at_nodes(function) -> np.ndarray:
    """A function of time at every quadrature node of every step, (steps, r, controls)."""
    t = H * (np.arange(STEPS)[:, None] + np.array(RULE.nodes))
    return np.stack(np.broadcast_arrays(*function(t)), axis=-1)


def main(out: Path = Path("out")) -> None:
    figure, axes = plt.subplots(1, 3, figsize=(13, 4), layout="constrained")
    cart = vi.models.cart_pole(q0=(0.0, 0.0))
    push = at_nodes(lambda t: (2 * np.sin(3 * t),))
    motion = vi.simulate(cart.system, RULE, q0=cart.q0, v0=cart.v0, h=H, steps=STEPS, u=push)
    impulse = 2 / 3 * (1 - np.cos(3 * motion.t[-1]))
    print(f"cart-pole, p_x after 4 s     found {motion.p[-1, 0]:.12f}   exact {impulse:.12f}")
    axes[0].plot(motion.t, motion.q, label=["x in m", "θ in rad"])
    axes[0].plot(motion.t, motion.p[:, 0], "k--", lw=1, label="p_x in N s")
    axes[0].set(xlabel="t in s", title="Cart-pole pushed by 2 sin 3t")

    arm = vi.models.two_link_arm(v0=(0.0, 0.0))
    torques = at_nodes(lambda t: (0.2 * np.cos(2 * t), 0.3 * np.sin(5 * t)))
    motion = vi.simulate(arm.system, RULE, q0=arm.q0, v0=arm.v0, h=H, steps=STEPS, u=torques)
    turning = 0.1 * np.sin(2 * motion.t[-1])
    print(f"arm, angular momentum        found {motion.p[-1, 0]:.12f}   exact {turning:.12f}")
    inner = at_nodes(lambda t: (0.0 * t, 0.3 * np.sin(5 * t)))
    free = vi.simulate(arm.system, RULE, q0=arm.q0, v0=arm.v0, h=H, steps=STEPS, u=inner)
    print(f"elbow's motor alone: largest angular momentum {np.abs(free.p[:, 0]).max():.1e}")
    axes[1].plot(motion.t, motion.q, label=["shoulder", "elbow"])
    axes[1].plot(free.t, free.q, "--", label=["shoulder, elbow's motor alone", "elbow"])
    axes[1].set(xlabel="t in s", ylabel="rad", title="Two-link arm on a table")

    # pumping: the acrobot's elbow torque follows the shoulder's velocity, step by step, and so
    # feeds energy in
    acrobot = vi.models.acrobot(q0=(0.2, 0.0))
    q, p, t = acrobot.q0, None, 0.0
    times, energies, work = [0.0], [], [0.0]
    v = acrobot.v0
    for _ in range(600):
        start = {"v0": v} if p is None else {"p0": p}
        leg = vi.simulate(
            acrobot.system, RULE, q0=q, **start, h=H, steps=1, u=[1.5 * np.sign(v[0])]
        )
        energies += [leg.energy[0]] if not energies else []
        energies.append(leg.energy[1])
        work.append(work[-1] + 1.5 * np.sign(v[0]) * (leg.q[1, 1] - leg.q[0, 1]))
        q, p, v, t = leg.q[1], leg.p[1], leg.v[1], t + H
        times.append(t)
    gained = energies[-1] - energies[0]
    print(f"acrobot, energy pumped in    found {gained:.9f}   exact {work[-1]:.9f}")
    axes[2].plot(times, np.array(energies) - energies[0], label="energy gained")
    axes[2].plot(times, work, "k--", lw=1, label="work of the elbow's motor")
    axes[2].set(xlabel="t in s", ylabel="J", title="Acrobot pumped at its elbow")
    for axis in axes:
        axis.legend(fontsize="small")
    out.mkdir(parents=True, exist_ok=True)
    figure.savefig(out / "machines.png", dpi=120)


if __name__ == "__main__":
    main(Path(sys.argv[1] if sys.argv[1:] else "out"))

"""Scenes that depend on time: a driven pendulum, a shaken pivot, a pendulum that grows longer.

Claim: the energy changes at the rate −∂L/∂t and by nothing else; a rule keeps its order with
explicit time; slow change of the length keeps energy over frequency (adiabatic invariant), so the
angle shrinks as ℓ^(−3/4).
Source: Landau & Lifshitz, Mechanics, §6, §49; Lorentz's question at Solvay, 1911.
Run: python examples/driven_pendulum.py [folder of the picture]
"""

import sys
from pathlib import Path

import casadi as ca
import matplotlib.pyplot as plt
import numpy as np

import varint as vi

plt.style.use("tableau-colorblind10")


def main(out: Path = Path("out")) -> None:
    figure, (section, order, slow) = plt.subplots(1, 3, figsize=(13, 4), layout="constrained")
    # the energy's change is the time integral of −∂L/∂t, by Gauss quadrature on each step
    model = vi.models.driven_pendulum(torque=6.0)
    motion = vi.simulate(model.system, vi.gauss(4), **model.start | {"duration": 4.0})
    nodes, weights = np.polynomial.legendre.leggauss(6)
    times = (motion.t[:-1, None] + motion.h * (nodes + 1) / 2).ravel()
    power = (
        motion.at(times).value(-ca.jacobian(model.system.lagrangian, model.system.t)).reshape(-1, 6)
    )
    gained = (power @ weights).sum() * motion.h / 2
    print(
        f"energy gained in 4 s         found {motion.energy[-1] - motion.energy[0]:.12f}   exact "
        f"{gained:.12f}"
    )

    # stroboscopic picture: one point per period of the drive
    beat = 2 * np.pi / 2.0
    stirred = vi.models.driven_pendulum(torque=1.0)
    for theta0 in (0.3, 0.8, 1.3, 1.8, 2.3, 2.8):
        strobe = vi.simulate(
            stirred.system,
            vi.gauss(3),
            q0=theta0,
            v0=0.0,
            h=beat / 60,
            steps=60 * 300,
            save_every=60,
        )
        section.plot(
            np.mod(strobe.q[:, 0] + np.pi, 2 * np.pi) - np.pi,
            strobe.v[:, 0],
            ".",
            ms=2,
            label=f"{theta0:g}",
        )
    section.set(xlabel="θ in rad", ylabel="dθ/dt in rad/s", title="Once per period of the torque")
    section.set_ylim(-7.5, 10.5)
    section.legend(
        title="θ₀ in rad",
        fontsize="small",
        loc="upper center",
        ncols=6,
        columnspacing=0.6,
        markerscale=4,
        handletextpad=0,
    )

    pivot = vi.models.horizontal_pivot()
    best = vi.simulate(
        pivot.system, vi.gauss(8), q0=pivot.q0, v0=pivot.v0, duration=5.0, steps=400
    ).q[-1]
    steps = np.array([25, 50, 100, 200])
    for rule in (vi.midpoint(), vi.gauss(2), vi.lobatto(4)):
        errors = [
            np.abs(
                vi.simulate(
                    pivot.system, rule, q0=pivot.q0, v0=pivot.v0, duration=5.0, steps=int(n)
                ).q[-1]
                - best
            )[0]
            for n in steps
        ]
        order.loglog(5.0 / steps, errors, "o-", label=f"{rule}")
        print(
            f"order of {rule!r:11}         found {np.log2(errors[-2] / errors[-1]):.2f}   theory "
            f"{rule.order}"
        )
    order.set_xscale("log", base=2)
    order.set(xlabel="step in s", ylabel="error at t = 5 s", title="Pivot shaken sideways")
    order.legend()

    growing = vi.models.lengthening_pendulum(theta0=0.1, rate=0.02)
    long = vi.simulate(growing.system, vi.gauss(3), **growing.start | {"duration": 150.0})
    length = 1 + 0.02 * long.t
    slow.plot(long.t, long.q[:, 0], lw=0.5)
    slow.plot(long.t, 0.1 * length**-0.75, "k--", lw=1, label="0.1 ℓ^(−3/4)")
    slow.set(xlabel="t in s", ylabel="θ in rad", title="Length growing from 1 m to 4 m")
    slow.legend()
    last = np.abs(long.q[long.t > 145, 0]).max()
    print(
        f"angle at four times the length found {last:.5f}   theory "
        f"{0.1 * (1 + 0.02 * 148) ** -0.75:.5f}"
    )
    out.mkdir(parents=True, exist_ok=True)
    figure.savefig(out / "driven_pendulum.png", dpi=120)


if __name__ == "__main__":
    main(Path(sys.argv[1] if sys.argv[1:] else "out"))

"""Kepler's problem in two coordinate systems: the Lagrangian is a scalar, the motion the same.

Claim: Cartesian and polar coordinates give the same ellipse; a symplectic rule of order 2 keeps
energy and angular momentum but lets the ellipse turn slowly, which the Laplace–Runge–Lenz vector
shows: by an angle ∝ h² per revolution. The pericentre, where q·v passes zero upwards, is reached at
multiples of the period 2π a^{3/2} of Kepler's third law.
Source: Landau & Lifshitz, Mechanics, §15; Hairer, Lubich & Wanner, Geometric Numerical Integration,
I.2.3.
Run: python examples/kepler.py [folder of the picture]
"""

import sys
from pathlib import Path

import casadi as ca
import matplotlib.pyplot as plt
import numpy as np

import varint as vi

plt.style.use("tableau-colorblind10")
E = 0.6


def main(out: Path = Path("out")) -> None:
    model = vi.models.kepler(e=E)
    polar = vi.models.central_force(r0=1 - E, thetadot0=model.v0[1] / (1 - E))
    revolution = 2 * np.pi
    a = vi.simulate(
        model.system, vi.gauss(6), q0=model.q0, v0=model.v0, duration=20 * revolution, steps=8000
    )
    b = vi.simulate(
        polar.system, vi.gauss(6), q0=polar.q0, v0=polar.v0, duration=20 * revolution, steps=8000
    )
    r, theta = b.q.T
    apart = np.abs(a.q - np.stack([r * np.cos(theta), r * np.sin(theta)], -1)).max()
    print(f"polar and Cartesian motion part by {apart:.1e} in 20 revolutions")
    for k in (1, 2, 5):
        q, _ = model.exact(k * 4.0)
        found = a.at(k * 4.0).q
        print(f"x at t = {k * 4:2d}                  found {found[0]:.12f}   exact {q[0, 0]:.12f}")

    passing = vi.simulate(
        model.system,
        vi.gauss(6),
        q0=model.q0,
        v0=model.v0,
        h=0.05,
        duration=20.0,
        events={"apse": model.system.q.T @ model.system.v},
    )
    apses = [event.time for event in passing.events if event.time > 1]
    for k in (1, 2, 3):
        print(
            f"pericentre {k}                found {apses[2 * k - 1]:.10f}   exact "
            f"{k * revolution:.10f}"
        )
    runge, turns = ca.densify(model.invariants["Laplace–Runge–Lenz"]), []
    for steps in (1000, 2000):
        verlet = vi.simulate(
            model.system,
            vi.composition("verlet"),
            q0=model.q0,
            v0=model.v0,
            duration=revolution,
            steps=steps,
        )
        turns.append(np.arctan2(*verlet.value(runge)[-1, ::-1]))
    print(f"turn of Verlet's ellipse, h against h/2   found {turns[0] / turns[1]:.3f}   theory 4")

    figure, (orbit, error, axis) = plt.subplots(1, 3, figsize=(13, 4), layout="constrained")
    for rule, steps in (
        (vi.composition("verlet"), 200),
        (vi.composition("blanes-moan4"), 100),
        (vi.gauss(4), 50),
    ):
        motion = vi.simulate(
            model.system,
            rule,
            q0=model.q0,
            v0=model.v0,
            duration=100 * revolution,
            steps=100 * steps,
        )
        runge = motion.value(model.invariants["Laplace–Runge–Lenz"])
        turned = np.unwrap(np.arctan2(runge[:, 1], runge[:, 0]))
        name = f"{rule}, {steps} steps a revolution"
        if rule == vi.composition("verlet"):
            orbit.plot(*motion.q[: 30 * steps].T, lw=0.3, label=name)
        error.semilogy(
            motion.t / revolution, np.abs(motion.energy + 0.5) + 1e-17, lw=0.4, label=name
        )
        axis.semilogy(motion.t / revolution, np.abs(turned) + 1e-17, lw=0.6, label=name)
    fine = np.linspace(0, revolution, 400)
    orbit.plot(*model.exact(fine)[0].T, "k--", lw=1, label="exact")
    orbit.set(aspect="equal", xlabel="x", ylabel="y", title="30 revolutions")
    orbit.legend(fontsize="small", loc="upper right")
    error.set(
        xlabel="revolutions", ylabel="|H − H₀|", title="Energy error: bounded", ylim=(1e-13, 1e-1)
    )
    error.legend(fontsize="small")
    axis.set(
        xlabel="revolutions",
        ylabel="angle in rad",
        title="Turn of the ellipse: grows",
        ylim=(1e-9, 1e1),
    )
    out.mkdir(parents=True, exist_ok=True)
    figure.savefig(out / "kepler.png", dpi=120)


if __name__ == "__main__":
    main(Path(sys.argv[1] if sys.argv[1:] else "out"))

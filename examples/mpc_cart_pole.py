"""Model predictive control: a cart-pole swung up and held against pushes, by plans renewed at every
step.

Claim: with the cost-to-go as terminal cost the first control of every plan is that of the
linear–quadratic regulator, J(1, 0) = √3 for x'' = u and ∫ x² + v² + u² dt; a pole that is not known
exactly is swung up within bounds, pushed on the way; a plan takes milliseconds, started warm from
the one before.
Source: Rawlings, Mayne, Diehl, Model Predictive Control, 2nd ed., §1.3 and §2.5; cart-pole of Kelly
(2017).
Run: python examples/mpc_cart_pole.py [folder of the picture and the film]
"""

import sys
from pathlib import Path
from time import perf_counter

import casadi as ca
import matplotlib.pyplot as plt
import numpy as np

import varint as vi

plt.style.use("tableau-colorblind10")
RIGHT = np.sqrt(3.0)  # P = [[√3, 1], [1, √3]], K = [1, √3]


def regulator():
    """Predictive control of x'' = u whose terminal cost is the cost of the whole future."""
    q, v = vi.coordinates("x")
    u = ca.SX.sym("u")
    cart = vi.System(q, v, v**2 / 2, force=u, control=u)
    future = RIGHT * q**2 + 2 * q * v + RIGHT * v**2
    return vi.mpc(vi.Phase(cart, vi.gauss(3), 2.0, 20, q**2 + v**2 + u**2, terminal_cost=future))


def swinger():
    """Predictive control of the cart-pole, one second ahead."""
    system = vi.models.cart_pole().system
    (x, angle), (speed, rate), push = ca.vertsplit(system.q), ca.vertsplit(system.v), system.control
    off = 2 * (1 + ca.cos(angle))  # ≈ (θ − π)² near the top
    cost = 5 * x**2 + 20 * off + 0.1 * speed**2 + 0.1 * rate**2 + 0.02 * push**2
    ahead = vi.Phase(
        system,
        vi.gauss(2),
        1.2,
        30,
        cost,
        terminal_cost=10 * x**2 + 60 * off + 2 * speed**2 + rate**2,
        bounds=[(-12, push, 12), (-1.0, x, 1.0)],
    )
    return vi.mpc(ahead)


def main(out: Path = Path("out")) -> None:
    plan = regulator()([1.0], [0.0])
    print(f"cost of the regulator from (1, 0)   found {plan.cost:.9f}   exact {RIGHT:.9f}")
    print(f"its gain at (1, 0)   found {-float(plan.u_at(0.0)[0]):.3f}   theory 1.000")
    began = perf_counter()
    controller = swinger()
    print(f"built in {perf_counter() - began:.2f} s")
    heavier = vi.models.cart_pole(
        m=0.36, length=0.55
    ).system  # the plant: 20 % heavier, 10 % longer
    pushes = np.zeros((150, 2))
    pushes[75] = [0.4, 0.1]  # somebody kicks it after 3 s
    began = perf_counter()
    motion, plans = vi.closed_loop(
        controller, [0.0, 0.2], [0.0, 0.0], 150, plant=heavier, disturbance=pushes
    )
    each = 1e3 * (perf_counter() - began) / len(plans)
    seconds = np.array([1e3 * p.solution.timings["solve"] for p in plans])
    off = np.abs(motion.q[-1] - [0, np.pi * np.round(motion.q[-1, 1] / np.pi)]).max()
    print(
        f"150 plans: {np.median(seconds):.1f} ms each (whole step {each:.1f} ms), at the end off "
        f"by {off:.1e}"
    )
    print(
        f"largest push {np.abs(motion.u).max():.6f} of 12, cart within "
        f"{np.abs(motion.q[:, 0]).max():.3f} of 1"
    )
    figure, (path, push, time) = plt.subplots(1, 3, figsize=(14, 4), layout="constrained")
    for p in plans[::10]:
        path.plot(p.t, p.q[:, 1], color="0.8", lw=0.8)
    path.plot(motion.t, motion.q, label=["cart, m", "pole, rad"])
    path.axhline(np.sign(motion.q[-1, 1]) * np.pi, color="k", lw=0.5)
    inside = motion.t[:-1, None] + motion.h * np.array(plans[0].rule.nodes)
    push.plot(inside.ravel(), motion.u.ravel(), lw=1)
    for axes in (path, push):
        axes.axvline(3.04, color="C1", ls=":", label="kick")
    time.semilogy(motion.t[:-1], seconds, ".", ms=4)
    path.set(xlabel="t in s", title="Motion, and some plans (grey)")
    push.set(xlabel="t in s", ylabel="push in N", title="Controls, limit 12 N")
    time.set(xlabel="t in s", ylabel="ms", title="Time of each plan")
    path.legend(fontsize="small")
    out.mkdir(parents=True, exist_ok=True)
    figure.savefig(out / "mpc_cart_pole.png", dpi=120)
    motion.animate(
        out / "mpc_cart_pole.gif", sketch=vi.models.sketch(vi.models.cart_pole()), fps=12, trace=0.5
    )


if __name__ == "__main__":
    main(Path(sys.argv[1] if sys.argv[1:] else "out"))

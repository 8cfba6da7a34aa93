"""Cart-pole swung up by its cart: cost to ten digits from 40 steps, orders of the rules, replay,
feedback.

Claim: J = ∫ u² dt = 58.80766745816687 from a straight line; the error of J falls with the order 2s
of the rule; the simulation with the optimal controls repeats the path to round-off; LQR gains about
the path forgive a wrong start.
Source: Kelly, SIAM Review 59 (2017) 849, §6; reference value by Pontryagin's conditions in extended
precision.
Run: python examples/control_cart_pole.py [folder of the picture]
"""

import sys
import warnings
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import varint as vi

plt.style.use("tableau-colorblind10")
EXACT = 58.80766745816687


def feedback(plan: vi.Trajectory, start: np.ndarray, gains: np.ndarray | None) -> np.ndarray:
    """Path from a wrong start, with or without feedback about the plan."""
    q, p, path = plan.q[0] + start, plan.p[0], [plan.q[0] + start]
    for k in range(len(plan) - 1):
        off = np.concatenate([q - plan.q[k], p - plan.p[k]])
        u = plan.u[k : k + 1] - (0 if gains is None else gains[k] @ off)
        one = vi.simulate(plan.system, plan.rule, q0=q, p0=p, h=plan.h, steps=1, u=u)
        q, p = one.q[-1], one.p[-1]
        path.append(q)
    return np.array(path)


def main(out: Path = Path("out")) -> None:
    plan = vi.models.swing_up_cart_pole().solve()[0]
    plan.report()
    print(f"cost of the swing-up   found {plan.cost:.9f}   exact {EXACT:.9f}")
    figure, (path, control, order, hold) = plt.subplots(1, 4, figsize=(17, 4), layout="constrained")
    for k in range(0, 41, 2):
        x, angle = plan.q[k]
        shade = plt.get_cmap("viridis")(k / 40)
        path.plot(
            [x, x + 0.5 * np.sin(angle)], [0, -0.5 * np.cos(angle)], "-o", color=shade, ms=4, lw=1
        )
    t = np.linspace(0, 2, 400)
    control.plot(t, plan.u_at(t), label="u(t), N")
    control.plot(plan.t, -plan.costates.p @ [1, 0] / 2, "k.", ms=3, label="−μ_x / 2 at the nodes")
    for stages, steps in (
        (1, (20, 40, 80, 160)),
        (2, (40, 80, 160)),
        (3, (30, 60, 90)),
        (4, (25, 40, 60)),
    ):
        errors = []
        for n in steps:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # few steps on purpose
                found = vi.models.swing_up_cart_pole(n, stages).solve()[0]
            errors.append(abs(found.cost / EXACT - 1))
        order.loglog(steps, errors, "o-", label=f"order {2 * stages}")
        if stages == 1:
            slope = np.log2(errors[-2] / errors[-1])
            print(f"order of the midpoint rule   found {slope:.3f}   theory 2.000")
    gains = vi.lqr(plan, np.diag([10.0, 10, 1, 1]), 0.1 * np.eye(1), 100 * np.eye(4))
    for name, k in (("controls alone", None), ("with feedback", gains)):
        hold.plot(
            plan.t,
            np.abs(feedback(plan, np.array([0.02, 0.02]), k) - plan.q).max(axis=1),
            label=name,
        )
    path.set(aspect="equal", xlabel="x in m", ylabel="y in m", title="Swing-up in 2 s")
    control.set(xlabel="t in s", title="Control and costate")
    order.set_xscale("log", base=2)
    order.set(xlabel="steps", ylabel="relative error of J", title="Error of the cost")
    hold.set(xlabel="t in s", ylabel="distance from the plan", title="Start 0.02 off", yscale="log")
    for axes in (control, order, hold):
        axes.legend(fontsize="small")
    out.mkdir(parents=True, exist_ok=True)
    figure.savefig(out / "control_cart_pole.png", dpi=120)


if __name__ == "__main__":
    main(Path(sys.argv[1] if sys.argv[1:] else "out"))

"""Optimal control solved again: the second solve of a problem with another end, beside
Hermite–Simpson collocation written by hand in CasADi's Opti.

Run: python benchmarks/optimal_control_again.py. Result:
benchmarks/results/optimal_control_again.json.

Kelly's cart-pole, its way growing by 1 cm from solve to solve, and the brachistochrone, its end
moving by 2 cm. Both tools start from their last solution; the collocation also from its
multipliers, with the same settings of Ipopt ("warm"). All take turns in one process; times are CPU
times, medians over the ends. The error is that of the cost, relative, the largest over the ends: of
the cart-pole by gauss(6) on 60 steps, of the brachistochrone by the cycloid.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from statistics import median
from time import process_time

import casadi as ca
import numpy as np
from tools.record import save, table

import varint as vi
from varint.nlp.options import WARM

ENDS = 12
QUIET = {"print_level": 0, "sb": "yes"}
Solve = Iterator[tuple[float, int]]


def hermite_simpson(
    rates: Callable, first: dict[int, np.ndarray], steps: int, running: Callable, time: bool
) -> tuple[ca.Opti, list[ca.MX], ca.MX, ca.MX]:
    """The separated form: states and controls at ends and middles of the steps."""
    n, opti = len(first), ca.Opti()
    x, middle = opti.variable(n, steps + 1), opti.variable(n, steps)
    u, between = opti.variable(1, steps + 1), opti.variable(1, steps)
    duration = opti.variable() if time else ca.MX(2.0)
    end, h, cost = opti.parameter(n), duration / steps, ca.MX(0)
    for k in range(steps):
        f0, f1 = rates(x[:, k], u[k]), rates(x[:, k + 1], u[k + 1])
        half = rates(middle[:, k], between[k])
        opti.subject_to(middle[:, k] == (x[:, k] + x[:, k + 1]) / 2 + h / 8 * (f0 - f1))
        opti.subject_to(x[:, k + 1] == x[:, k] + h / 6 * (f0 + 4 * half + f1))
        cost += h / 6 * (running(u[k]) + 4 * running(between[k]) + running(u[k + 1]))
    opti.subject_to(x[:, 0] == 0)
    opti.minimize(cost)
    if time:
        opti.subject_to(duration >= 0.01)
        opti.set_initial(duration, 1.0)
        opti.set_initial(u, 0.8)
        opti.set_initial(between, 0.8)
    s = np.linspace(0, 1, steps + 1)
    for i, far in first.items():
        opti.set_initial(x[i, :], far * s)
        opti.set_initial(middle[i, :], far * (s[:-1] + 0.5 / steps))
    return opti, [x, middle, u, between], end, cost


def solved_again(opti: ca.Opti, end: ca.MX, cost: ca.MX, ends: list, warm: bool) -> Solve:
    """The costs of the collocation for all ends, one after the other."""
    settings = {"expand": True, "print_time": False}
    opti.solver("ipopt", settings, QUIET)
    opti.set_value(end, ends[0])
    found = opti.solve()
    if warm:
        opti.solver("ipopt", settings, QUIET | WARM | {"tol": 1e-8, "mu_init": 1e-9})
    for value in ends:
        opti.set_initial(found.value_variables())
        if warm:
            opti.set_initial(opti.lam_g, found.value(opti.lam_g))
        opti.set_value(end, value)
        found = opti.solve()
        yield float(found.value(cost)), int(found.stats()["iter_count"])


def cart_pole_collocation(steps: int, ends: list, warm: bool) -> Solve:
    def rates(x: ca.MX, u: ca.MX) -> ca.MX:
        sin, cos, turn = ca.sin(x[1]), ca.cos(x[1]), x[3]
        push = 0.15 * sin * turn**2 + u
        a = (push + 2.943 * cos * sin) / (1 + 0.3 * (1 - cos**2))
        b = -(push * cos + 1.3 * 9.81 * sin) / (0.5 * (1 + 0.3 * (1 - cos**2)))
        return ca.vertcat(x[2], x[3], a, b)

    first = {0: 1.0, 1: np.pi, 2: 0.0, 3: 0.0}
    opti, (x, _, u, between), end, cost = hermite_simpson(
        rates, first, steps, lambda u: u**2, False
    )
    opti.subject_to(x[:, -1] == end)
    for control in (u, between):
        opti.subject_to(opti.bounded(-20, ca.vec(control), 20))
    opti.subject_to(opti.bounded(-2, ca.vec(x[0, :]), 2))
    return solved_again(opti, end, cost, [[far, np.pi, 0, 0] for far in ends], warm)


def brachistochrone_collocation(steps: int, ends: list, warm: bool) -> Solve:
    def rates(x: ca.MX, u: ca.MX) -> ca.MX:
        return ca.vertcat(x[2] * ca.sin(u), x[2] * ca.cos(u), 9.81 * ca.cos(u))

    first = {0: 1.0, 1: 1.0, 2: 4.0}
    opti, (x, *_), end, cost = hermite_simpson(rates, first, steps, lambda _: 1.0, True)
    opti.subject_to(x[:2, -1] == end[:2])
    return solved_again(opti, end, cost, [[far, 1, 0] for far in ends], warm)


def cart_pole(rule: vi.Rule, steps: int, ends: list) -> Solve:
    q, v = vi.coordinates("x", "theta")
    push = ca.SX.sym("push")
    kinetic = 1.3 * v[0] ** 2 / 2 + 0.15 * ca.cos(q[1]) * v[0] * v[1] + 0.075 * v[1] ** 2 / 2
    cart = vi.System(
        q, v, kinetic + 0.3 * 9.81 * 0.5 * ca.cos(q[1]), force=ca.vertcat(push, 0), control=push
    )
    rest = dict(start=dict(q=[0, 0], v=[0, 0]), end=dict(q=[1, np.pi], v=[0, 0]))
    bounds = [(-20, push, 20), (-2, q[0], 2)]
    return answers(
        vi.Phase(cart, rule, 2.0, steps, push**2, bounds=bounds, **rest),
        [[far, np.pi] for far in ends],
    )


def brachistochrone(rule: vi.Rule, steps: int, ends: list) -> Solve:
    """The wire pushes across the velocity; on the cycloid its factor is constant."""
    q, v = vi.coordinates("x", "depth")
    turn = ca.SX.sym("turn")
    bead = vi.System(
        q, v, ca.sumsqr(v) / 2 + 9.81 * q[1], force=turn * ca.vertcat(v[1], -v[0]), control=turn
    )
    guess = dict(q=[[0, 0], [0.1, 0.4], [0.5, 0.8], [1, 1]], u=[[2.0]])
    fall = dict(start=dict(q=[0, 0], v=[0, 0]), end=dict(q=[1, 1]), guess=guess)
    return answers(
        vi.Phase(bead, rule, vi.free(0.6, 0.1, 2.0), steps, 1, **fall), [[far, 1] for far in ends]
    )


def answers(phase: vi.Phase, ends: list) -> Solve:
    motion = vi.prepare(phase)()
    for end in ends:
        motion = motion.again(end=dict(q=end))
        yield motion.cost, motion.solution.iterations


def main() -> None:
    rows = []
    for problem, step, exact, by_hand, own, sizes, rules in (
        (
            "cart-pole",
            0.01,
            None,
            cart_pole_collocation,
            cart_pole,
            (20, 40, 80),
            ((4, 20), (5, 16), (5, 20), (4, 40), (5, 30)),
        ),
        (
            "brachistochrone",
            0.02,
            cycloid_time,
            brachistochrone_collocation,
            brachistochrone,
            (40, 80),
            ((3, 5), (4, 4), (4, 6), (5, 4)),
        ),
    ):
        ends = [1 + step * i for i in range(ENDS)]
        methods: dict[tuple[str, int], Solve] = {}
        for steps in sizes:
            for warm, name in ((False, "Hermite–Simpson"), (True, "Hermite–Simpson, warm")):
                methods[name, steps] = by_hand(steps, ends, warm)
        for stages, steps in rules:
            methods[f"varint gauss({stages})", steps] = own(vi.gauss(stages), steps, ends)
        times: dict = {key: [] for key in methods}
        costs: dict = {key: [] for key in methods}
        for _ in ends:
            for key, solve in methods.items():
                began = process_time()
                costs[key].append(next(solve))
                times[key].append(process_time() - began)
        if exact is None:
            truth = np.array([cost for cost, _ in own(vi.gauss(6), 60, ends)])
        else:
            truth = np.array([exact(far) for far in ends])
        for (name, steps), found in costs.items():
            values, iterations = np.array(found).T
            rows.append(
                {
                    "problem": problem,
                    "method": name,
                    "steps": steps,
                    "error": float(np.abs(values / truth - 1).max()),
                    "second solve ms": 1e3 * median(times[name, steps][1:]),
                    "iterations": int(np.median(iterations[1:])),
                }
            )
    table(rows)
    save("optimal_control_again", rows)


def cycloid_time(far: float) -> float:
    radius, turn = vi.models.cycloid(far, 1.0)
    return float(turn * np.sqrt(radius / 9.81))


if __name__ == "__main__":
    main()

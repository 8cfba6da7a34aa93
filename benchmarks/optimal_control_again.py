"""Optimal control solved again: the second solve of a problem with another end, beside
Hermite–Simpson collocation written by hand in CasADi's Opti.

Run: python benchmarks/optimal_control_again.py [problem …]. Result:
benchmarks/results/optimal_control_again.json.

Kelly's cart-pole and the six problems of benchmarks/tools/start_problems.py, an end or a start a
little further off from solve to solve. All begin at the same motion, found by varint on a fine
mesh, and start from their last solution; the collocation also from its multipliers, with the same
settings of Ipopt ("warm"). All take turns in one process; times are CPU times, medians over the
ends. The error is that of the cost, relative to varint's on a much finer mesh (of the
brachistochrone to the cycloid's), the largest over the ends. "Refined" are meshes made by `refine`
before the first solve, which stay as they are.
"""

from __future__ import annotations

import sys
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from statistics import median
from time import process_time

import casadi as ca
import numpy as np
from tools.record import kept, save, table
from tools.start_problems import PROBLEMS

import varint as vi
from varint.nlp.options import WARM

ENDS = 12
QUIET = {"print_level": 0, "sb": "yes", "max_iter": 500}
Solve = Iterator[tuple[float, int]]
Rules = Sequence[tuple[int, int]]  # stages, steps


@dataclass(frozen=True)
class Again:
    """A problem, what is given anew (an entry of q at an end, and by how much it changes), steps of
    the collocation, rules and steps of varint, those of the reference and of the motion to begin
    with; stages, steps and tolerance of meshes that `refine` makes before the first solve, and the
    stages on them; what the reference costs, and how the collocation is written, where that is
    known better.
    """

    phase: Callable[[], vi.Phase]
    where: str
    entry: int
    change: float
    steps: Sequence[int]
    rules: Rules
    fine: tuple[int, int]
    refined: Sequence[tuple[int, int, float, int]] = ()
    exact: Callable[[float], float] | None = None
    written: Callable[..., Solve] | None = None

    def ends(self, phase: vi.Phase) -> list[dict[str, list[float]]]:
        """What is given of q there, solve by solve."""
        first = list(getattr(phase, self.where)["q"])
        found = []
        for k in range(1, ENDS + 1):
            q = list(first)
            q[self.entry] += k * self.change
            found.append(dict(q=q))
        return found


def kellys_cart_pole() -> vi.Phase:
    """Kelly, An introduction to trajectory optimization, SIAM Review 59 (2017), §6."""
    q, v = vi.coordinates("x", "theta")
    push = ca.SX.sym("push")
    kinetic = 1.3 * v[0] ** 2 / 2 + 0.15 * ca.cos(q[1]) * v[0] * v[1] + 0.075 * v[1] ** 2 / 2
    cart = vi.System(
        q, v, kinetic + 0.3 * 9.81 * 0.5 * ca.cos(q[1]), force=ca.vertcat(push, 0), control=push
    )
    rest = dict(start=dict(q=[0, 0], v=[0, 0]), end=dict(q=[1, np.pi], v=[0, 0]))
    bounds = [(-20, push, 20), (-2, q[0], 2)]
    return vi.Phase(cart, vi.gauss(4), 2.0, 20, push**2, bounds=bounds, **rest)


def cycloid_time(far: float) -> float:
    """Down by 5 and so far."""
    radius, turn = vi.models.cycloid(far, 5.0)
    return float(turn * np.sqrt(radius / 9.80665))


def by_varint(phase: vi.Phase, begin: vi.Trajectory, where: str, ends: list) -> Solve:
    """Costs and iterations of varint, end by end; `phase` with the rule and steps wanted."""
    motion = vi.prepare(phase)(guess=begin)
    for end in ends:
        motion = motion.again(**{where: end})
        yield motion.cost, motion.solution.iterations


def by_hand(
    phase: vi.Phase, steps: int, begin: vi.Trajectory, where: str, ends: list, warm: bool
) -> Solve:
    """The separated form of Hermite–Simpson: states and controls at ends and middles of steps, all
    of them unknowns.
    """
    s, n, opti = phase.system, phase.system.structure.n, ca.Opti()
    x = ca.vertcat(s.q, s.v)
    rate = ca.gradient(s.lagrangian, s.q) + s.force - ca.jtimes(s.momentum, s.q, s.v)
    rates = ca.vertcat(s.v, ca.solve(s.mass_matrix, rate - ca.jacobian(s.momentum, s.t)))
    f = ca.Function("f", [x, s.control, s.t], [ca.substitute(rates, s.c, s.default_vector)])
    run = ca.Function("run", [x, s.control, s.t], [ca.SX(phase.cost)])
    free = not isinstance(phase.duration, (int, float))
    duration = opti.variable() if free else ca.MX(phase.duration)
    h, total, points = duration / steps, ca.MX(0), 2 * steps + 1
    states, controls = opti.variable(2 * n, points), opti.variable(s.control.numel(), points)
    X, U = ca.horzsplit(states), ca.horzsplit(controls)
    for k in range(steps):
        at = [(X[2 * k + j], U[2 * k + j], (k + j / 2) * h) for j in range(3)]
        (x0, *_), (middle, *_), (x1, *_) = at
        a, b, c = (f(*y) for y in at)
        opti.subject_to(middle == (x0 + x1) / 2 + h / 8 * (a - c))
        opti.subject_to(x1 == x0 + h / 6 * (a + 4 * b + c))
        costs = [run(*y) for y in at]
        total += h / 6 * (costs[0] + 4 * costs[1] + costs[2])
    final = ca.Function("final", [x, s.t], [ca.SX(phase.terminal_cost)])
    cost = total + final(X[-1], duration)
    opti.minimize(cost)
    given: Mapping[str, ca.MX] = {}
    for name, here, t in (("start", X[0], 0), ("end", X[-1], duration)):
        known = getattr(phase, name) or {}
        for part, key in ((here[:n], "q"), (here[n:], "v")):
            if key in known:
                value = opti.parameter(n)
                opti.set_value(value, known[key])
                opti.subject_to(part == value)
                given = {**given, f"{name} {key}": value}
        for low, row, high in known.get("bounds", ()):
            opti.subject_to(opti.bounded(low, ca.Function("end", [x, s.t], [row])(here, t), high))
    for low, row, high in phase.bounds:
        along = ca.Function("along", [x, s.control, s.t], [row])
        sides = (-np.inf if low is None else low), (np.inf if high is None else high)
        for i in range(points):
            opti.subject_to(opti.bounded(sides[0], along(X[i], U[i], i * h / 2), sides[1]))
    if free:
        opti.subject_to(opti.bounded(phase.duration.lower, duration, phase.duration.upper))
        opti.set_initial(duration, begin.duration)
    fractions = np.linspace(0, 1, points)
    path = begin.at(begin.t[0] + begin.duration * fractions)
    opti.set_initial(states, np.hstack([path.q, path.v]).T)
    opti.set_initial(controls, begin.solution.u(fractions).T)
    return _solved_again(opti, given[f"{where} q"], cost, ends, warm)


def wire_by_hand(
    phase: vi.Phase, steps: int, begin: vi.Trajectory, where: str, ends: list, warm: bool
) -> Solve:
    """The brachistochrone as it is written by hand: place and speed, the angle of the wire."""
    opti = ca.Opti()
    states, angles = opti.variable(3, 2 * steps + 1), opti.variable(2 * steps + 1)
    duration = opti.variable()
    h, end, X = duration / steps, opti.parameter(2), ca.horzsplit(states)

    def f(i: int) -> ca.MX:
        sin, cos, speed = ca.sin(angles[i]), ca.cos(angles[i]), X[i][2]
        return ca.vertcat(speed * sin, -speed * cos, 9.80665 * cos)

    for k in range(0, 2 * steps, 2):
        a, b, c = (f(k + j) for j in range(3))
        opti.subject_to(X[k + 1] == (X[k] + X[k + 2]) / 2 + h / 8 * (a - c))
        opti.subject_to(X[k + 2] == X[k] + h / 6 * (a + 4 * b + c))
    opti.subject_to(X[0] == 0)
    opti.subject_to(X[-1][:2] == end)
    opti.subject_to(opti.bounded(phase.duration.lower, duration, phase.duration.upper))
    opti.minimize(duration)
    opti.set_value(end, (phase.end or {})["q"])
    path = begin.at(begin.t[0] + begin.duration * np.linspace(0, 1, 2 * steps + 1))
    v = path.v.copy()
    v[0] = 0.0, -1.0  # straight down to begin with
    opti.set_initial(states, np.vstack([path.q.T, np.linalg.norm(path.v, axis=1)]))
    opti.set_initial(angles, np.arctan2(v[:, 0], -v[:, 1]))
    opti.set_initial(duration, begin.duration)
    return _solved_again(opti, end, duration, ends, warm)


def _solved_again(opti: ca.Opti, value: ca.MX, cost: ca.MX, ends: list, warm: bool) -> Solve:
    settings = {"expand": True, "print_time": False}
    opti.solver("ipopt", settings, QUIET)
    found = opti.solve()
    if warm:
        opti.solver("ipopt", settings, QUIET | WARM | {"tol": 1e-8, "mu_init": 1e-9})
    for end in ends:
        opti.set_initial(found.value_variables())
        if warm:
            opti.set_initial(opti.lam_g, found.value(opti.lam_g))
        opti.set_value(value, end["q"])
        found = opti.solve()
        yield float(found.value(cost)), int(found.stats()["iter_count"])


CASES = {
    "Kelly's cart-pole": Again(
        kellys_cart_pole,
        "end",
        0,
        0.01,
        (20, 40, 80),
        ((4, 18), (5, 16), (5, 20), (4, 40), (5, 30), (5, 40)),
        (6, 60),
    ),
    "cart-pole, weak motor": Again(
        PROBLEMS["cart-pole, weak motor"],
        "end",
        0,
        0.01,
        (60, 120),
        ((3, 60), (4, 60), (4, 80), (4, 90)),
        (4, 480),
        refined=((3, 60, 1e-4, 4),),
    ),
    "acrobot": Again(
        PROBLEMS["acrobot"],
        "end",
        0,
        0.005,
        (60, 120, 240),
        ((4, 40), (4, 60), (5, 40), (5, 60), (5, 80), (5, 100), (6, 80)),
        (6, 200),
    ),
    "cart with three links": Again(
        PROBLEMS["cart with three links"],
        "end",
        0,
        0.005,
        (120, 240),
        ((4, 100), (5, 80), (5, 100)),
        (6, 200),
    ),
    "quadrotor flip": Again(
        PROBLEMS["quadrotor flip"],
        "end",
        0,
        0.01,
        (50, 100),
        ((3, 50), (4, 50)),
        (4, 400),
        refined=(
            (3, 25, 1e-6, 4),
            (4, 25, 1e-6, 4),
            (4, 25, 1e-7, 4),
            (3, 25, 1e-7, 4),
            (3, 50, 1e-7, 4),
        ),
    ),
    "orbit raising": Again(
        PROBLEMS["orbit raising"],
        "start",
        0,
        0.002,
        (40, 80),
        ((3, 40), (5, 26), (6, 20), (4, 40), (5, 37), (5, 40), (4, 60)),
        (5, 200),
        refined=((4, 10, 1e-7, 4), (4, 10, 1e-7, 5)),
    ),
    "brachistochrone": Again(
        PROBLEMS["brachistochrone"],
        "end",
        0,
        0.05,
        (30, 60),
        ((3, 5), (4, 4), (4, 6), (5, 4), (6, 3), (7, 2), (8, 2)),
        (6, 40),
        exact=cycloid_time,
        written=wire_by_hand,
    ),
}


def measured(name: str) -> list[dict]:
    """One problem by all methods, which take turns."""
    case = CASES[name]
    phase = case.phase()
    ends = case.ends(phase)

    def by(rule: tuple[int, int], begin: vi.Trajectory) -> Solve:
        sized = replace(phase, rule=vi.gauss(rule[0]), steps=rule[1])
        return by_varint(sized, begin, case.where, ends)

    coarse = vi.prepare(phase)()
    stages, steps = case.fine
    begin = vi.prepare(replace(phase, rule=vi.gauss(stages), steps=steps))(guess=coarse)
    truth = np.array([cost for cost, _ in by(case.fine, begin)])
    if case.exact is not None:
        truth = np.array([case.exact(end["q"][case.entry]) for end in ends])
    methods: dict[tuple[str, int], Solve] = {}
    for n in case.steps:
        for warm, method in ((False, "Hermite–Simpson"), (True, "Hermite–Simpson, warm")):
            write = case.written or by_hand
            methods[method, n] = write(phase, n, begin, case.where, ends, warm)
    for rule in case.rules:
        methods[f"varint gauss({rule[0]})", rule[1]] = by(rule, begin)
    for stages, steps, tol, then in case.refined:
        rough = replace(phase, rule=vi.gauss(stages), steps=steps)
        fair = vi.refine(vi.prepare(rough)(guess=begin), tol)
        mesh = fair.solution.mesh
        sized = replace(phase, rule=vi.gauss(then), steps=0, mesh=mesh)
        key = f"varint gauss({then}), refined", len(mesh) - 1
        methods[key] = by_varint(sized, fair, case.where, ends)
    times: dict = {key: [] for key in methods}
    costs: dict = {key: [] for key in methods}
    for _ in ends:
        for key, solve in methods.items():
            began = process_time()
            try:
                costs[key].append(next(solve))
            except (RuntimeError, vi.SolverError, StopIteration):
                costs[key].append((np.nan, 0))
            times[key].append(process_time() - began)
    rows = []
    for (method, n), found in costs.items():
        values, iterations = np.array(found).T
        rows.append(
            {
                "problem": name,
                "method": method,
                "steps": n,
                "error": float(np.abs(values / truth - 1).max()),
                "second solve ms": 1e3 * median(times[method, n][1:]),
                "iterations": int(np.median(iterations[1:])),
            }
        )
    return rows


def main(names: list[str]) -> None:
    """These problems, written as they come; others keep their rows."""
    for name in names:
        found = measured(name)
        table(found)
        rows = [row for row in kept("optimal_control_again") if row["problem"] != name] + found
        known = [row for row in rows if row["problem"] in CASES]
        known.sort(key=lambda row: list(CASES).index(row["problem"]))
        save("optimal_control_again", known)


if __name__ == "__main__":
    warnings.simplefilter("ignore")  # coarse meshes are meant here
    main(sys.argv[1:] or list(CASES))

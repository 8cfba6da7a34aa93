"""Six problems that nobody gave a guess for, as phases and as hand-written Hermite–Simpson
collocation, and random paths to start both from.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from time import perf_counter

import casadi as ca
import numpy as np

import varint as vi

WAVES = 4
LONGEST = 500  # iterations of either
FEASIBLE = 1e-6

Path = Callable[[float], np.ndarray]


def cart_with_weak_motor() -> vi.Phase:
    """A cart of 1 kg with a pole of 0.1 kg and 2 N: it must swing several times."""
    q, v = vi.coordinates("x", "theta")
    u = ca.SX.sym("push")
    m1, m2, length, g = 1.0, 0.1, 0.5, 9.81
    lagrangian = (
        (m1 + m2) * v[0] ** 2 / 2
        + m2 * length * ca.cos(q[1]) * v[0] * v[1]
        + m2 * length**2 * v[1] ** 2 / 2
        + m2 * g * length * ca.cos(q[1])
    )
    system = vi.System(q, v, lagrangian, force=ca.vertcat(u, 0), control=u)
    return _swing(system, 6.0, 60, u**2, [0, np.pi], [(-2, u, 2), (-2, q[0], 2)])


def acrobot() -> vi.Phase:
    """Two links swung up by the elbow alone."""
    phase = vi.models.swing_up_acrobot().phases[0]
    u = phase.system.control
    return _swing(phase.system, 3.0, 60, u**2, [np.pi, 0], [(-40, u, 40)])


def cart_with_three_links() -> vi.Phase:
    """A triple pendulum on a cart, from hanging to standing."""
    q, v = vi.coordinates("x", "a", "b", "c")
    u, place = ca.SX.sym("push"), ca.vertcat(q[0], 0)
    lagrangian = v[0] ** 2 / 2
    for i in range(3):
        place = place + 0.4 * ca.vertcat(ca.sin(q[1 + i]), -ca.cos(q[1 + i]))
        lagrangian += 0.2 * (ca.sumsqr(ca.jtimes(place, q, v)) / 2 - 9.81 * place[1])
    system = vi.System(q, v, lagrangian, force=ca.vertcat(u, 0, 0, 0), control=u)
    return _swing(system, 3.0, 60, u**2, [0, np.pi, np.pi, np.pi], [(-60, u, 60), (-2, q[0], 2)])


def quadrotor_flip() -> vi.Phase:
    """A planar quadrotor turns over once and hovers where it began."""
    q, v = vi.coordinates("x", "z", "theta")
    u = ca.SX.sym("u", 2)
    mass, inertia, arm, g = 0.5, 0.005, 0.2, 9.81
    lagrangian = mass * ca.sumsqr(v[:2]) / 2 + inertia * v[2] ** 2 / 2 - mass * g * q[1]
    lift = u[0] + u[1]
    force = ca.vertcat(-lift * ca.sin(q[2]), lift * ca.cos(q[2]), arm * (u[1] - u[0]))
    system = vi.System(q, v, lagrangian, force=force, control=u)
    bounds = [(0, u[0], 6), (0, u[1], 6)]
    return _swing(system, 1.5, 50, ca.sumsqr(u), [0, 0, 2 * np.pi], bounds)


def orbit_raising() -> vi.Phase:
    """The highest circular orbit in a given time (Bryson & Ho, Applied Optimal Control, §2.5)."""
    q, v = vi.coordinates("r", "phi")
    u, t = ca.SX.sym("u", 2), vi.time()
    push = 0.1405 / (1 - 0.0749 * t)
    lagrangian = (v[0] ** 2 + q[0] ** 2 * v[1] ** 2) / 2 + 1 / q[0]
    force = push * ca.vertcat(u[0], q[0] * u[1])
    system = vi.System(q, v, lagrangian, force=force, control=u, t=t)
    return vi.Phase(
        system,
        vi.gauss(3),
        3.3207,
        40,
        terminal_cost=-q[0],
        start=dict(q=[1, 0], v=[0, 1]),
        end=dict(bounds=[(0, v[0], 0), (1, v[1] ** 2 * q[0] ** 3, 1)]),
        bounds=[(None, ca.sumsqr(u), 1)],
    )


def brachistochrone() -> vi.Phase:
    """The fastest wire; it pushes across the velocity."""
    q, v = vi.coordinates("x", "y")
    u = ca.SX.sym("u")
    push = u * ca.vertcat(v[1], -v[0])
    system = vi.System(q, v, ca.sumsqr(v) / 2 - 9.80665 * q[1], force=push, control=u)
    return vi.Phase(
        system,
        vi.gauss(3),
        vi.free(1, 0.1, 20),
        30,
        1,
        start=dict(q=[0, 0], v=[0, 0]),
        end=dict(q=[10, -5]),
        bounds=[(-50, u, 50)],
    )


PROBLEMS = {
    "cart-pole, weak motor": cart_with_weak_motor,
    "acrobot": acrobot,
    "cart with three links": cart_with_three_links,
    "quadrotor flip": quadrotor_flip,
    "orbit raising": orbit_raising,
    "brachistochrone": brachistochrone,
}


def _swing(system, duration, steps, cost, to, bounds) -> vi.Phase:
    still = [0] * len(to)
    ends = dict(start=dict(q=still, v=still), end=dict(q=to, v=still))
    return vi.Phase(system, vi.gauss(3), duration, steps, cost, bounds=bounds, **ends)


def random_path(phase: vi.Phase, random: np.random.Generator, duration: float) -> Path:
    """The straight line between the ends with sine waves of random heights."""
    first = np.array(phase.start["q"], dtype=float)
    last = np.array((phase.end or {}).get("q", first), dtype=float)
    reach = np.where(np.abs(last - first) > 0, np.abs(last - first), 1.0)
    waves = np.arange(1, WAVES + 1)
    heights = reach * random.normal(size=(WAVES, len(first))) / waves[:, None]

    def path(t: float) -> np.ndarray:
        s = t / duration
        return first + s * (last - first) + np.sin(np.pi * s * waves) @ heights

    return path


@dataclass(frozen=True)
class Outcome:
    """How a solve ended: by which attempt, all its iterations, and how far its controls, replayed
    finely, lead away from its path (of the range of a coordinate).
    """

    solved: bool
    cost: float
    iterations: int
    seconds: float
    attempt: str = ""
    error: float = np.nan


def by_varint(phase: vi.Phase, path: Path | None) -> Outcome:
    """From a path, or from the default start; its iterations are those of all attempts, rough
    solutions by the trapezoidal rule among them.
    """
    began = perf_counter()
    given = {
        name: getattr(phase, name)
        for name in ("steps", "duration", "cost", "terminal_cost", "start", "end", "bounds")
    }
    try:
        motion = vi.optimal_control(
            phase.system,
            phase.rule,
            **given,
            guess=None if path is None else dict(q=path),
            options={"ipopt": {"max_iter": LONGEST}},
            progress=False,
        )
    except vi.SolverError:
        return Outcome(False, np.nan, 0, perf_counter() - began)
    seconds = perf_counter() - began
    attempts = motion.stats.get("attempts", (("", motion.solution.iterations),))
    count = sum(iterations for _, iterations in attempts)
    error = motion.stats["error_estimate"]
    return Outcome(True, motion.cost, count, seconds, attempts[-1][0], error)


def by_hermite_simpson(phase: vi.Phase, path: Path) -> Outcome:
    """Compressed Hermite–Simpson as one writes it with `Opti`: states and controls at nodes and
    middles, controls at rest to begin with.
    """
    began, s, n = perf_counter(), phase.system, phase.system.structure.n
    x, free = ca.vertcat(s.q, s.v), isinstance(phase.duration, type(vi.free(1, 0.5, 2)))
    rate = ca.gradient(s.lagrangian, s.q) + s.force - ca.jtimes(s.momentum, s.q, s.v)
    rate -= ca.jacobian(s.momentum, s.t)
    rates = ca.vertcat(s.v, ca.solve(s.mass_matrix, rate))
    f = ca.Function("f", [x, s.control, s.t], [ca.substitute(rates, s.c, s.default_vector)])
    run = ca.Function("run", [x, s.control, s.t], [ca.SX(phase.cost)])
    opti, count = ca.Opti(), phase.steps
    X, U = opti.variable(2 * n, 2 * count + 1), opti.variable(s.control.numel(), 2 * count + 1)
    T = opti.variable() if free else phase.duration
    guess = float(phase.duration.guess) if free else phase.duration
    h, total = T / count, 0
    for k in range(count):
        i, t = 2 * k, k * h
        slopes = [f(X[:, i + j], U[:, i + j], t + j * h / 2) for j in range(3)]
        middle = (X[:, i] + X[:, i + 2]) / 2 + h / 8 * (slopes[0] - slopes[2])
        opti.subject_to(X[:, i + 1] == middle)
        opti.subject_to(X[:, i + 2] == X[:, i] + h / 6 * (slopes[0] + 4 * slopes[1] + slopes[2]))
        costs = [run(X[:, i + j], U[:, i + j], t + j * h / 2) for j in range(3)]
        total += h / 6 * (costs[0] + 4 * costs[1] + costs[2])
    final = ca.Function("final", [x, s.t], [ca.SX(phase.terminal_cost)])
    opti.minimize(total + final(X[:, -1], T))
    for at, end in ((0, phase.start), (-1, phase.end or {})):
        for part, key in ((X[:n, at], "q"), (X[n:, at], "v")):
            if key in end:
                opti.subject_to(part == end[key])
        for low, expression, high in end.get("bounds", ()):
            value = ca.Function("end", [x, s.t], [expression])(X[:, at], T)
            opti.subject_to(value == low if low == high else opti.bounded(low, value, high))
    for low, expression, high in phase.bounds:
        along = ca.Function("along", [x, s.control, s.t], [expression])
        for i in range(2 * count + 1):
            value = along(X[:, i], U[:, i], i * h / 2)
            low_, high_ = (-np.inf if low is None else low), (np.inf if high is None else high)
            opti.subject_to(opti.bounded(low_, value, high_))
    if free:
        opti.subject_to(opti.bounded(float(phase.duration.lower), T, float(phase.duration.upper)))
        opti.set_initial(T, guess)
    times = np.linspace(0, guess, 2 * count + 1)
    points = np.array([path(t) for t in times])
    opti.set_initial(X, np.hstack([points, np.gradient(points, times, axis=0)]).T)
    opti.solver(
        "ipopt",
        {"print_time": False},
        {"print_level": 0, "sb": "yes", "max_iter": LONGEST},
    )
    try:
        solution = opti.solve()
    except RuntimeError:
        iterations = opti.stats()["iter_count"]
        return Outcome(False, np.nan, iterations, perf_counter() - began)
    iterations, seconds = solution.stats()["iter_count"], perf_counter() - began
    x, u = solution.value(X).reshape(2 * n, -1), solution.value(U).reshape(-1, 2 * count + 1)
    error = _replay_error(f, x, u, float(solution.value(h)), n)
    cost = float(solution.value(opti.f))
    return Outcome(True, cost, iterations, seconds, "from the guess", error)


PARTS = 8  # of half a step


def _replay_error(f: ca.Function, x: np.ndarray, u: np.ndarray, h: float, n: int) -> float:
    """How far the controls, parabolas in each step, lead away from the path: a replay by the
    classical Runge–Kutta rule in sixteenths of a step, of the range of each coordinate.
    """
    state, worst = x[:, 0], np.zeros(n)
    extent = np.ptp(x[:n], axis=1)
    extent = np.maximum(extent, 1e-3 * extent.max())

    def control(k: int, s: float) -> np.ndarray:
        first, middle, last = u[:, 2 * k], u[:, 2 * k + 1], u[:, 2 * k + 2]
        return (1 - s) * (1 - 2 * s) * first + 4 * s * (1 - s) * middle + s * (2 * s - 1) * last

    for k in range(u.shape[1] // 2):
        for j in range(2 * PARTS):
            s, d = j / (2 * PARTS), 1 / (2 * PARTS)
            inputs = [(control(k, s + c * d), (k + s + c * d) * h) for c in (0, 0.5, 1)]
            step = d * h
            a = f(state, *inputs[0]).full().ravel()
            b = f(state + step / 2 * a, *inputs[1]).full().ravel()
            c = f(state + step / 2 * b, *inputs[1]).full().ravel()
            e = f(state + step * c, *inputs[2]).full().ravel()
            state = state + step / 6 * (a + 2 * b + 2 * c + e)
            if not np.isfinite(state).all():
                return float("inf")
        worst = np.maximum(worst, np.abs(state[:n] - x[:n, 2 * k + 2]))
    return float((worst / extent).max())

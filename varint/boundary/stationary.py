"""The equations ∂S_d = 0 of a whole path, from the mechanics of one interval.

Unknowns are small changes of an iterate, control point after control point (coordinates, multipliers), then the
momenta p_start and p_end, then the duration T where it is free. The rows are e⁺ + e⁻ = 0 at every control point,
h b_j g(Q_j) = 0 where there are constraints, p_start = p⁻_0 and p_end = p⁺_{N−1} at the ends, two conditions on the
ends, and ∂S_d/∂T + E = 0 for the duration. An iterate keeps the increments Q_j − q_k of every interval next to the
nodes: differences of positions would lose the digits of the velocities.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from varint.assembly import Element, equations
from varint.discrete import Interval, interval
from varint.rules import Rule
from varint.system import System, per_system


@dataclass(frozen=True, eq=False)
class Problem:
    """A path to be found: N steps from t0, with its parameters, controls and end conditions.

    Attributes
    ----------
    u : ndarray (N, r·k)
        Controls at the rule's nodes.
    ends : ndarray (2, n) or None
        Fixed end points; None for a closed path.
    closure : ndarray (n, n + 1) or None
        [S | b] of the condition q(T) = S q(0) + b, p(0) = Sᵀ p(T); None for fixed ends.
    energy : float or None
        Energy of a path of free duration; None: the duration is fixed.
    """

    system: System
    rule: Rule
    steps: int
    t0: float
    u: np.ndarray
    c: np.ndarray
    ends: np.ndarray | None = None
    closure: np.ndarray | None = None
    energy: float | None = None

    @property
    def equations(self) -> Equations:
        """Rows and their derivatives, built once for all problems of this kind."""
        return path_equations(self.system, self.rule, self.steps, self.closure is not None, self.energy is not None)


@dataclass(frozen=True, eq=False)
class Iterate:
    """A trial path: starts (N, n) of the steps, increments (N, d, n), multipliers (N d + 1, m), end momenta (2, n)."""

    starts: np.ndarray
    increments: np.ndarray
    multipliers: np.ndarray
    momenta: np.ndarray
    duration: float

    @property
    def end(self) -> np.ndarray:
        """q_N."""
        return self.starts[-1] + self.increments[-1, -1]

    @property
    def points(self) -> np.ndarray:
        """All control points, (N d + 1, n)."""
        steps, _, n = self.increments.shape
        inside = self.starts[:, None] + np.concatenate([np.zeros((steps, 1, n)), self.increments[:, :-1]], axis=1)
        return np.concatenate([inside.reshape(-1, n), self.end[None]])

    def moved(self, change: np.ndarray) -> Iterate:
        """The iterate after a change of all unknowns."""
        steps, d, n = self.increments.shape
        m, count = self.multipliers.shape[1], steps * d + 1
        blocks = change[: count * (n + m)].reshape(count, n + m)
        q = blocks[:, :n]
        rest = change[count * (n + m) :]
        return Iterate(
            starts=self.starts + q[:-1:d],
            increments=self.increments + (q[1:].reshape(steps, d, n) - q[:-1:d, None]),
            multipliers=self.multipliers + blocks[:, n:],
            momenta=self.momenta + rest[: 2 * n].reshape(2, n),
            duration=self.duration + float(rest[2 * n :].sum()),
        )


def iterate_through(points: np.ndarray, degree: int, multipliers: int, duration: float) -> Iterate:
    """Iterate through the control points (N d + 1, n), with multipliers and end momenta zero."""
    count, n = points.shape
    starts = points[:-1:degree]
    increments = points[1:].reshape(len(starts), degree, n) - starts[:, None]
    return Iterate(starts.copy(), increments, np.zeros((count, multipliers)), np.zeros((2, n)), duration)


def point_times(rule: Rule) -> np.ndarray:
    """Control points of a step in units of h, (d + 1,), of Galerkin rules and compositions alike."""
    return np.array(rule.points or rule.nodes)


@dataclass(frozen=True, eq=False)
class Equations:
    """Rows of a kind of path as functions of (change, constants); `constants` lays out the latter."""

    rows: ca.Function
    linearised: ca.Function

    def __call__(self, problem: Problem, iterate: Iterate) -> np.ndarray:
        """Values of all rows at the iterate."""
        return np.array(self.rows(np.zeros(self.rows.numel_in(0)), constants(problem, iterate))).ravel()

    def derivatives(self, problem: Problem, iterate: Iterate) -> tuple[np.ndarray, ca.DM]:
        """Values of all rows and their sparse Jacobian."""
        values, slope = self.linearised(np.zeros(self.rows.numel_in(0)), constants(problem, iterate))
        return np.array(values).ravel(), slope


def constants(problem: Problem, iterate: Iterate) -> np.ndarray:
    """The data of the rows, in the order of `_places`."""
    n = iterate.starts.shape[1]
    closure = np.zeros((n, n + 1))
    if problem.closure is not None:
        closure[:] = problem.closure
    elif problem.ends is not None:
        closure[:, 0], closure[:, -1] = problem.ends
    clock = np.array([iterate.duration, 1 / problem.steps, problem.t0, problem.energy or 0.0])
    parts = [iterate.starts, iterate.increments, iterate.multipliers, problem.u, problem.c, np.arange(problem.steps)]
    parts += [clock, iterate.end, iterate.momenta, closure.T]
    return np.concatenate([x.ravel() for x in parts])


@per_system
def interval_rows(system: System, rule: Rule) -> ca.Function:
    """(Q_0, increments, λ, u, c, t, h) → (rows, action): e_j and h b_j g(Q_j) of every control point in turn."""
    one = interval(system, rule)
    rows = ca.horzcat(-one.p_minus, one.rows)
    if one.lam.numel():
        rows = ca.vertcat(rows, ca.reshape(ca.gradient(one.action, ca.vec(one.lam)), *one.lam.shape))
    return ca.Function("interval_rows", _inputs(one), [ca.densify(ca.vec(rows)), one.action], {"cse": True})


def _inputs(one: Interval) -> list[ca.SX]:
    return [one.q0, ca.vec(one.dq), ca.vec(one.lam), ca.vec(one.u), one.c, one.t, one.h]


@per_system
def path_equations(system: System, rule: Rule, steps: int, closed: bool, free: bool) -> Equations:
    """Equations of a path of `steps` steps between fixed ends or closed, of fixed or free duration."""
    one = interval(system, rule)
    (n, d), m = one.dq.shape, one.lam.shape[0]
    block, points = n + m, steps * d + 1
    unknowns = points * block + 2 * n + free
    place, size = _places(n, m, d, one.u.numel(), one.c.numel(), steps)
    ends = _ends(n, m, closed)
    first, last = np.arange(block), (points - 1) * block + np.arange(block)
    momenta, stretch = points * block + np.arange(2 * n), np.full(int(free), unknowns - 1)

    window = np.arange(steps)[:, None] * d * block + np.arange((d + 1) * block)
    rows = window.copy()
    if not closed:
        rows[0, n:block] = -1
    rows[-1, d * block + n :] = -1
    shared = np.broadcast_to(stretch, (steps, len(stretch)))
    change, data, values = _interval_of_path(system, rule, free)
    piece = Element(
        change, data, ca.SX(0), values,
        np.hstack([window, shared]),
        np.hstack([place[name] for name in ("starts", "increments", "multipliers", "u")]
                  + [np.broadcast_to(place["c"], (steps, one.c.numel())), place["k"]]
                  + [np.broadcast_to(place["clock"], (steps, 4))]),
        np.hstack([rows, shared]),
    )  # fmt: skip
    held_multipliers = last[n:] if closed else np.concatenate([first[n:], last[n:]])
    border = Element(
        ends[0], ends[1], ca.SX(0), ends[2],
        np.concatenate([first, last, momenta])[None],
        np.concatenate([place["starts"][0], place["end"], place["momenta"], place["closure"]])[None],
        np.concatenate([first[:n], last[:n], momenta, held_multipliers])[None],
    )  # fmt: skip
    return Equations(*equations([piece, border], unknowns, size))


def _places(n: int, m: int, d: int, controls: int, parameters: int, steps: int) -> tuple[dict[str, np.ndarray], int]:
    """Where the data of each interval sit among the constants, and how many those are."""
    shapes = {
        "starts": (steps, n), "increments": (steps, d * n), "points": (steps * d + 1, m), "u": (steps, controls),
        "c": (parameters,), "k": (steps, 1), "clock": (4,), "end": (n,), "momenta": (2 * n,), "closure": (n * n + n,),
    }  # fmt: skip
    place, begin = {}, 0
    for name, shape in shapes.items():
        size = int(np.prod(shape))
        place[name] = begin + np.arange(size).reshape(shape)
        begin += size
    window = np.arange(steps)[:, None] * d + np.arange(d + 1)
    place["multipliers"] = place["points"][window].reshape(steps, (d + 1) * m)
    return place, begin


def _interval_of_path(system: System, rule: Rule, free: bool) -> tuple[ca.SX, ca.SX, ca.SX]:
    """(changes, data, rows) of one interval; with free duration the last row is its share of ∂S_d/∂T + E."""
    one = interval(system, rule)
    (n, d), m = one.dq.shape, one.lam.shape[0]
    change, stretch = ca.SX.sym("change", n + m, d + 1), ca.SX.sym("stretch", int(free))
    k, duration, share, t0, energy = (ca.SX.sym(name) for name in ("k", "T", "share", "t0", "E"))
    data = ca.vertcat(*_inputs(one)[:5], k, duration, share, t0, energy)
    h = (duration + ca.sum1(stretch)) * share
    ahead = ca.vec(one.dq) + ca.vec(change[:n, 1:] - ca.repmat(change[:n, 0], 1, d))
    rows, action = interval_rows(system, rule)(
        one.q0 + change[:n, 0], ahead, ca.vec(one.lam) + ca.vec(change[n:, :]), ca.vec(one.u), one.c, t0 + k * h, h
    )
    if free:
        rows = ca.vertcat(rows, ca.gradient(action, stretch) + energy * share)
    return ca.vertcat(ca.vec(change), stretch), data, rows


def _ends(n: int, m: int, closed: bool) -> tuple[ca.SX, ca.SX, ca.SX]:
    """(changes, data, rows) of the two ends; the rows add p_start and −p_end to the ends' momentum balance."""
    changes = [ca.SX.sym("change", size) for size in (n, m, n, m, n, n)]
    start, _, end, last_lam, p_start, p_end = changes
    q0, q1, p0, p1 = (ca.SX.sym(name, n) for name in ("q0", "q1", "p0", "p1"))
    turn, shift = ca.SX.sym("S", n, n), ca.SX.sym("b", n)
    if closed:
        conditions = [q1 + end - ca.mtimes(turn, q0 + start) - shift, p0 + p_start - ca.mtimes(turn.T, p1 + p_end)]
        fixed = [last_lam]
    else:
        conditions, fixed = [q0 + start - turn[:, 0], q1 + end - shift], [changes[1], last_lam]
    rows = ca.vertcat(p0 + p_start, -(p1 + p_end), *conditions, *fixed)
    return ca.vertcat(*changes), ca.vertcat(q0, q1, p0, p1, ca.vec(turn), shift), rows


def with_duration(iterate: Iterate, duration: float) -> Iterate:
    """The same path, run through in another time; multipliers are forces and scale with its square."""
    ratio = iterate.duration / duration
    return replace(
        iterate, duration=duration, momenta=ratio * iterate.momenta, multipliers=ratio**2 * iterate.multipliers
    )

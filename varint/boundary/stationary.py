"""The equations ∂S_d = 0 of a whole path, from the mechanics of one interval.

Unknowns are small changes of an iterate, control point after control point (coordinates,
multipliers), then the momenta p_start and p_end, then the duration T where it is free. The rows are
e⁺ + e⁻ = 0 at every control point, h b_j g(Q_j) = 0 where there are constraints, p_start = p⁻_0 and
p_end = p⁺_{N−1} at the ends, two conditions on the ends, and ∂S_d/∂T + E = 0 for the duration. An
iterate keeps the increments Q_j − q_k of every interval next to the nodes: differences of positions
would lose the digits of the velocities.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from varint.boundary.iterate import Iterate, point_times
from varint.discrete.lagrangian import Interval, interval
from varint.nlp.assembly import Element, assemble_equations
from varint.numerics.arrays import over_columns
from varint.rules.rule import Rule
from varint.scene.memory import per_system
from varint.scene.system import System


@dataclass(frozen=True, eq=False)
class BoundaryValueProblem:
    """A path to be found: N steps from t0, with its parameters, controls and end conditions.

    Attributes
    ----------
    grid : ndarray (N + 1,)
        Where the nodes lie, in units of the mean step: 0, 1, …, N where all steps are equal.
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
    grid: np.ndarray
    t0: float
    u: np.ndarray
    c: np.ndarray
    ends: np.ndarray | None = None
    closure: np.ndarray | None = None
    energy: float | None = None

    @property
    def steps(self) -> int:
        """Number of steps N."""
        return len(self.grid) - 1

    @property
    def sizes(self) -> np.ndarray:
        """Every step in units of the mean one, (N,)."""
        return np.diff(self.grid)

    @property
    def equal_steps(self) -> bool:
        """Whether all steps are equal."""
        return bool((self.sizes == 1).all())

    @property
    def point_shares(self) -> np.ndarray:
        """Times of all control points as shares of the duration, (N d + 1,)."""
        tau = point_times(self.rule)[:-1]
        inner = (self.grid[:-1, None] + self.sizes[:, None] * tau) / self.steps
        return np.append(inner.ravel(), 1.0)

    @property
    def equations(self) -> PathEquations:
        """Rows and their derivatives, built once for all problems of this kind."""
        return path_equations(
            self.system, self.rule, self.steps, self.closure is not None, self.energy is not None
        )


@dataclass(frozen=True, eq=False)
class PathEquations:
    """Rows of a kind of path as functions of (change, constants); `constants` lays out the
    latter.
    """

    rows: ca.Function
    linearised: ca.Function

    def __call__(self, problem: BoundaryValueProblem, iterate: Iterate) -> np.ndarray:
        """Values of all rows at the iterate."""
        return np.array(
            self.rows(np.zeros(self.rows.numel_in(0)), constants(problem, iterate))
        ).ravel()

    def derivatives(
        self, problem: BoundaryValueProblem, iterate: Iterate
    ) -> tuple[np.ndarray, ca.DM]:
        """Values of all rows and their sparse Jacobian."""
        values, slope = self.linearised(
            np.zeros(self.rows.numel_in(0)), constants(problem, iterate)
        )
        return np.array(values).ravel(), slope


def constants(problem: BoundaryValueProblem, iterate: Iterate) -> np.ndarray:
    """The data of the rows, in the order of `_places`."""
    n = iterate.starts.shape[1]
    closure = np.zeros((n, n + 1))
    if problem.closure is not None:
        closure[:] = problem.closure
    elif problem.ends is not None:
        closure[:, 0], closure[:, -1] = problem.ends
    clock = np.array([iterate.duration, 1 / problem.steps, problem.t0, problem.energy or 0.0])
    parts = [
        iterate.starts,
        iterate.increments,
        iterate.multipliers,
        problem.u,
        problem.c,
        problem.grid[:-1],
        problem.sizes,
    ]
    parts += [clock, iterate.end, iterate.momenta, closure.T]
    return np.concatenate([x.ravel() for x in parts])


def momenta_and_action(problem: BoundaryValueProblem, iterate: Iterate) -> tuple[np.ndarray, float]:
    """p_k = p⁻ of the step that begins there, at the end p⁺ of the last one, (N + 1, n); Σ L_d."""
    p_minus, p_plus, actions = over_columns(
        ends_function(problem.system, problem.rule), *interval_data(problem, iterate)
    )
    return np.concatenate([p_minus, p_plus[-1:]]), float(actions.sum())


def interval_data(problem: BoundaryValueProblem, iterate: Iterate) -> list[np.ndarray]:
    """Arguments of `interval_rows`, one row a step."""
    steps, d, _ = iterate.increments.shape
    mean = iterate.duration / steps
    window = np.arange(steps)[:, None] * d + np.arange(d + 1)
    return [
        iterate.starts,
        iterate.increments.reshape(steps, -1),
        iterate.multipliers[window].reshape(steps, -1),
        problem.u,
        problem.c,
        (problem.t0 + mean * problem.grid[:-1])[:, None],
        (mean * problem.sizes)[:, None],
    ]


@per_system
def interval_rows(system: System, rule: Rule) -> ca.Function:
    """(Q_0, increments, λ, u, c, t, h) → (rows, action): e_j and h b_j g(Q_j) of every control
    point in turn.
    """
    one = interval(system, rule)
    rows = ca.horzcat(-one.p_minus, one.rows)
    if one.lam.numel():
        rows = ca.vertcat(
            rows, ca.reshape(ca.gradient(one.action, ca.vec(one.lam)), *one.lam.shape)
        )
    return ca.Function(
        "interval_rows", _inputs(one), [ca.densify(ca.vec(rows)), one.action], {"cse": True}
    )


@per_system
def ends_function(system: System, rule: Rule) -> ca.Function:
    """Arguments of `interval_rows` → (p⁻, p⁺, action)."""
    n = system.structure.n
    kernel = interval_rows(system, rule)
    inputs = [ca.SX.sym("a", kernel.numel_in(i)) for i in range(kernel.n_in())]
    rows, action = kernel(*inputs)
    last = rows.numel() - n - system.structure.constraints
    return ca.Function("ends", inputs, [-rows[:n], rows[last : last + n], action], {"cse": True})


def _inputs(one: Interval) -> list[ca.SX]:
    return [one.q0, ca.vec(one.dq), ca.vec(one.lam), ca.vec(one.u), one.c, one.t, one.h]


@per_system
def path_equations(
    system: System, rule: Rule, steps: int, closed: bool, free: bool
) -> PathEquations:
    """Equations of a path of `steps` steps between fixed ends or closed, of fixed or free
    duration.
    """
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
        change,
        data,
        ca.SX(0),
        values,
        np.hstack([window, shared]),
        np.hstack(
            [place[name] for name in ("starts", "increments", "multipliers", "u")]
            + [np.broadcast_to(place["c"], (steps, one.c.numel())), place["begin"], place["size"]]
            + [np.broadcast_to(place["clock"], (steps, 4))]
        ),
        np.hstack([rows, shared]),
    )
    held_multipliers = last[n:] if closed else np.concatenate([first[n:], last[n:]])
    border = Element(
        ends[0],
        ends[1],
        ca.SX(0),
        ends[2],
        np.concatenate([first, last, momenta])[None],
        np.concatenate([place["starts"][0], place["end"], place["momenta"], place["closure"]])[
            None
        ],
        np.concatenate([first[:n], last[:n], momenta, held_multipliers])[None],
    )
    return PathEquations(*assemble_equations([piece, border], unknowns, size))


def _places(
    n: int, m: int, d: int, controls: int, parameters: int, steps: int
) -> tuple[dict[str, np.ndarray], int]:
    """Where the data of each interval sit among the constants, and how many those are."""
    place, size = number_unknowns(
        starts=(steps, n),
        increments=(steps, d * n),
        points=(steps * d + 1, m),
        u=(steps, controls),
        c=(parameters,),
        begin=(steps, 1),
        size=(steps, 1),
        clock=(4,),
        end=(n,),
        momenta=(2 * n,),
        closure=(n * n + n,),
    )
    window = np.arange(steps)[:, None] * d + np.arange(d + 1)
    place["multipliers"] = place["points"][window].reshape(steps, (d + 1) * m)
    return place, size


def number_unknowns(**shapes: tuple[int, ...]) -> tuple[dict[str, np.ndarray], int]:
    """Indices of arrays of these shapes that stand one after the other, and how many there are."""
    place, begin = {}, 0
    for name, shape in shapes.items():
        size = int(np.prod(shape))
        place[name] = begin + np.arange(size).reshape(shape)
        begin += size
    return place, begin


def _interval_of_path(system: System, rule: Rule, free: bool) -> tuple[ca.SX, ca.SX, ca.SX]:
    """(changes, data, rows) of one interval; with free duration the last row is its share of
    ∂S_d/∂T + E.
    """
    one = interval(system, rule)
    (n, d), m = one.dq.shape, one.lam.shape[0]
    change, stretch = ca.SX.sym("change", n + m, d + 1), ca.SX.sym("stretch", int(free))
    names = "begin", "size", "T", "share", "t0", "E"
    begin, size, duration, share, t0, energy = (ca.SX.sym(name) for name in names)
    data = ca.vertcat(*_inputs(one)[:5], begin, size, duration, share, t0, energy)
    mean = (duration + ca.sum1(stretch)) * share
    ahead = ca.vec(one.dq) + ca.vec(change[:n, 1:] - ca.repmat(change[:n, 0], 1, d))
    rows, action = interval_rows(system, rule)(
        one.q0 + change[:n, 0],
        ahead,
        ca.vec(one.lam) + ca.vec(change[n:, :]),
        ca.vec(one.u),
        one.c,
        t0 + begin * mean,
        size * mean,
    )
    if free:
        rows = ca.vertcat(rows, ca.gradient(action, stretch) + energy * size * share)
    return ca.vertcat(ca.vec(change), stretch), data, rows


def _ends(n: int, m: int, closed: bool) -> tuple[ca.SX, ca.SX, ca.SX]:
    """(changes, data, rows) of the two ends; the rows add p_start and −p_end to the ends'
    momentum balance.
    """
    changes = [ca.SX.sym("change", size) for size in (n, m, n, m, n, n)]
    start, _, end, last_lam, p_start, p_end = changes
    q0, q1, p0, p1 = (ca.SX.sym(name, n) for name in ("q0", "q1", "p0", "p1"))
    turn, shift = ca.SX.sym("S", n, n), ca.SX.sym("b", n)
    if closed:
        conditions = [
            q1 + end - ca.mtimes(turn, q0 + start) - shift,
            p0 + p_start - ca.mtimes(turn.T, p1 + p_end),
        ]
        fixed = [last_lam]
    else:
        conditions, fixed = [q0 + start - turn[:, 0], q1 + end - shift], [changes[1], last_lam]
    rows = ca.vertcat(p0 + p_start, -(p1 + p_end), *conditions, *fixed)
    return ca.vertcat(*changes), ca.vertcat(q0, q1, p0, p1, ca.vec(turn), shift), rows

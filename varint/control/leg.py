"""One phase as part of a large sparse program: where its unknowns, data and rows sit, their bounds, its elements.

Unknowns by stage: q_k, λ_k, u_k, inner points, inner λ, …, q_N, λ_N, then the end velocities and what is shared (start
time, duration, parameters, as far as they are free). Rows by stage: momentum matching p⁺_{k−1} − p⁻_k = 0 at node k,
inner rows, constraints, path bounds. Ends: ∂L/∂v(q_0, v_0) − p⁻_0 = 0 and p⁺_{N−1} − ∂L/∂v(q_N, v_N) = 0.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np

from varint.assembly import Element
from varint.control.kernels import EndTerm, IntervalTerm, Shared, end_term, interval_term, shared_symbols
from varint.control.phase import Checked
from varint.control.rank import independent_rows
from varint.errors import InputError


@dataclass(frozen=True, eq=False)
class Slots:
    """Indices of a phase's quantities among the unknowns; a shared quantity that is fixed has index −1."""

    q: np.ndarray  # (N + 1, n)
    lam: np.ndarray  # (N + 1, m)
    u: np.ndarray  # (N, samples, k)
    inner: np.ndarray  # (N, d − 1, n)
    lam_inner: np.ndarray  # (N, d − 1, m)
    v: np.ndarray  # (2, n)
    shared: np.ndarray  # (2 + number of parameters,): t0, T, c
    end: int


@dataclass(frozen=True, eq=False)
class Rows:
    """Indices of a phase's rows; −1: left out."""

    momentum: np.ndarray  # (N + 1, n)
    inner: np.ndarray  # (N, n (d − 1))
    gaps: np.ndarray  # (N, m d)
    nodes: np.ndarray  # (N, r b)
    points: np.ndarray  # (N, d a)
    start: np.ndarray  # gap, hidden, conditions, points at node 0
    last: np.ndarray  # hidden, conditions
    end: int


@dataclass(frozen=True, eq=False)
class Leg:
    """A phase in the program."""

    phase: Checked
    slots: Slots
    rows: Rows
    interval: IntervalTerm
    shared: Shared
    data: np.ndarray  # s_k, w_k, then t0, T, c: the program's constants of this phase
    first_datum: int
    x_low: np.ndarray
    x_high: np.ndarray
    g_low: np.ndarray
    g_high: np.ndarray
    elements: list[Element]

    @cached_property
    def values_function(self) -> ca.Function:
        """(stage, q1, mesh, shared, μ) → (p⁻, p⁺, cost, ∂/∂q0 and ∂/∂q1 of cost + Σ μ·rows) of one interval."""
        term = self.interval
        shares = ca.vertcat(-term.p_minus, term.inner, term.gaps, term.nodes, term.points, term.p_plus)
        mu = ca.SX.sym("mu", shares.numel())
        total = ca.densify(term.cost) + ca.dot(mu, shares)
        slopes = [ca.densify(ca.gradient(total, x)) for x in (term.stage[: term.q1.numel()], term.q1)]
        inputs = [term.stage, term.q1, term.mesh, self.shared.column, mu]
        return ca.Function("values", inputs, [term.p_minus, term.p_plus, ca.densify(term.cost), *slopes], {"cse": True})

    @cached_property
    def terminal_function(self) -> ca.Function:
        """(q, v, t, c) → (terminal cost, momentum) at the end."""
        s = self.phase.system
        return ca.Function("terminal", [s.q, s.v, s.t, s.c], [self.phase.terminal, s.momentum])


def leg(phase: Checked, t0: float, free_start: bool, tied: bool, q_ends: np.ndarray, x: int, p: int, g: int) -> Leg:
    """Place a phase behind x unknowns, p data and g rows.

    `free_start`: the start time is an unknown; `tied`: a link gives all of the start;
    `q_ends` (2, n): where constraint ranks at the ends are judged.
    """
    shared, term = shared_symbols(phase), None
    term = interval_term(phase, shared)
    ends = [end_term(phase, shared, last) for last in (False, True)]
    slots = _slots(phase, free_start, x)
    kept = [_kept(phase, t0, tied, q_ends[0], False), _kept(phase, t0, False, q_ends[1], True)]
    rows, low, high = _rows(phase, term, ends, kept, g)
    steps = np.diff(phase.mesh)
    data = np.concatenate([phase.mesh[:-1], steps, [t0, phase.duration[0]], phase.c])
    x_low, x_high = _bounds(phase, slots, x)
    elements = _elements(phase, term, ends, slots, rows, shared, p)
    return Leg(phase, slots, rows, term, shared, data, p, x_low, x_high, low, high, elements)


def _slots(phase: Checked, free_start: bool, x: int) -> Slots:
    s, count, degree = phase.system.structure, phase.steps, phase.rule.degree
    n, m, k, samples = s.n, s.constraints, s.controls, phase.samples
    sizes = [n, m, k * samples, n * (degree - 1), m * (degree - 1)]
    stride = sum(sizes)
    at = x + stride * np.arange(count + 1)[:, None]
    stage = [at + np.arange(b - a, b) for a, b in zip(sizes, np.cumsum(sizes), strict=True)]
    v = x + stride * count + n + m + np.arange(2 * n).reshape(2, n)
    is_free = np.concatenate([[free_start, phase.free_duration], phase.c_low < phase.c_high]).astype(bool)
    first = v[-1, -1] + 1
    shared = np.where(is_free, first + np.cumsum(is_free) - 1, -1)
    return Slots(
        q=stage[0],
        lam=stage[1],
        u=stage[2][:-1].reshape(count, samples, k),
        inner=stage[3][:-1].reshape(count, degree - 1, n),
        lam_inner=stage[4][:-1].reshape(count, degree - 1, m),
        v=v,
        shared=shared,
        end=int(first + is_free.sum()),
    )


def _kept(phase: Checked, t0: float, tied: bool, q: np.ndarray, last: bool) -> tuple[np.ndarray, np.ndarray]:
    """Which rows of g(q) = 0 and of G v + ∂g/∂t = 0 are independent of the given coordinates and velocities."""
    m = phase.system.structure.constraints
    if not m or tied:
        return np.zeros(m, dtype=bool), np.zeros(m, dtype=bool)
    s, end = phase.system, phase.end if last else phase.start
    slope = ca.Function("G", [s.q, s.t, s.c], [ca.densify(ca.jacobian(s.constraint, s.q))])
    G = np.array(slope(q, t0 + (phase.duration[0] if last else 0.0), phase.c))
    given = [bounds[1] == bounds[2] for bounds in (end.q, end.v)]
    kept = [independent_rows(np.eye(s.structure.n)[fixed], G) for fixed in given]
    if not given[0].all() and not kept[0].all():
        names = [name for name, y in zip(s.names, given[0], strict=True) if y]
        raise InputError(
            f"at the {'end' if last else 'start'} the coordinates {names} and constraint "
            f"{int(np.flatnonzero(~kept[0])[0])} say the same at q = {q.tolist()}: give all coordinates, or others"
        )
    return kept[0], kept[1]


def _rows(phase: Checked, term: IntervalTerm, ends: list[EndTerm], kept, g: int):
    """Indices and bounds of the rows: all are numbered, then those that would be imposed twice are left out."""
    count, bounds, degree, r = phase.steps, phase.bounds, phase.rule.degree, len(phase.rule.nodes)
    zero = [np.zeros(x.numel()) for x in (term.p_minus, term.inner, term.gaps)]
    stage_low = np.concatenate([*zero, np.tile(bounds.nodes_low, r), np.tile(bounds.points_low, degree)])
    stage_high = np.concatenate([*zero, np.tile(bounds.nodes_high, r), np.tile(bounds.points_high, degree)])
    sizes = [x.numel() for x in (term.p_minus, term.inner, term.gaps, term.nodes, term.points)]
    at = sum(sizes) * np.arange(count + 1)[:, None]
    momentum, *stage = (at + np.arange(b - a, b) for a, b in zip(sizes, np.cumsum(sizes), strict=True))
    inner, gaps, nodes, points = (x[:-1] for x in stage)
    first, last = ends
    start_sizes = [x.numel() for x in (first.gap, first.hidden, first.rows, first.points)]
    start = momentum[-1, -1] + 1 + np.arange(sum(start_sizes))
    final = momentum[-1, -1] + 1 + len(start) + np.arange(last.hidden.numel() + last.rows.numel())
    still = [np.zeros(x.numel()) for x in (first.gap, first.hidden, last.hidden)]
    low = [np.tile(stage_low, count), zero[0], *still[:2], phase.start.low, bounds.points_low, still[2], phase.end.low]
    high = [np.tile(stage_high, count), zero[0], *still[:2], phase.start.high, bounds.points_high]
    high += [still[2], phase.end.high]
    keep = np.ones(sum(map(len, low)), dtype=bool)
    m, held = first.gap.numel(), first.points.numel()
    keep[start[: 2 * m]] = np.concatenate(kept[0])
    keep[gaps[-1, gaps.shape[1] - m :]], keep[final[:m]] = kept[1]
    for end, rows in ((phase.start, start[len(start) - held :]), (phase.end, points[-1, points.shape[1] - held :])):
        keep[rows] = (end.q[1] < end.q[2]).any()  # expressions of a fixed end hold or do not; nothing can be chosen
    number = np.where(keep, g + np.cumsum(keep) - 1, -1)
    momentum, inner, gaps, nodes, points = (number[x] for x in (momentum, inner, gaps, nodes, points))
    rows = Rows(momentum, inner, gaps, nodes, points, number[start], number[final], g + int(keep.sum()))
    return rows, np.concatenate(low)[keep], np.concatenate(high)[keep]


def _bounds(phase: Checked, slots: Slots, x: int) -> tuple[np.ndarray, np.ndarray]:
    """Bounds on the unknowns of the phase."""
    low, high = np.full(slots.end - x, -np.inf), np.full(slots.end - x, np.inf)
    bounds, last_q = phase.bounds, slots.q[-1] - x
    for side, array in ((0, low), (1, high)):
        array[slots.q - x] = bounds.q[side]
        array[slots.inner - x] = bounds.q[side]
        array[slots.u - x] = bounds.u[side]
        array[slots.v - x] = bounds.v[side]
        for end, q, v in ((phase.start, slots.q[0] - x, slots.v[0] - x), (phase.end, last_q, slots.v[1] - x)):
            tighter = np.maximum if side == 0 else np.minimum
            array[q] = tighter(array[q], end.q[1 + side])
            array[v] = tighter(array[v], end.v[1 + side])
        free = slots.shared >= 0
        values = np.concatenate(
            [[(-np.inf, np.inf)[side], phase.duration[1 + side]], (phase.c_low, phase.c_high)[side]]
        )
        array[slots.shared[free] - x] = values[free]
    return low, high


def picked(column: ca.SX, places: np.ndarray) -> ca.SX:
    """Entries of a column as a column, also where there are none (an empty index has a shape of its own)."""
    return ca.vertcat(ca.SX(0, 1), *(column[int(i)] for i in places))


def _elements(phase, term: IntervalTerm, ends, slots: Slots, rows: Rows, shared: Shared, p: int) -> list[Element]:
    """The interval, the two ends and, where asked for, the periodic link."""
    count, free = phase.steps, slots.shared >= 0
    symbols = shared.column
    unknown, known = (picked(symbols, np.flatnonzero(is_one)) for is_one in (free, ~free))
    fixed_data = p + 2 * count + np.flatnonzero(~free)

    def element(variables, x, mesh, step, cost, shares, g) -> Element:
        copies = len(x)
        return Element(
            variables=ca.vertcat(*variables, unknown),
            constants=ca.vertcat(mesh, known),
            cost=cost,
            rows=ca.vertcat(*shares),
            x=np.hstack([x, np.tile(slots.shared[free], (copies, 1))]),
            p=np.hstack([p + step[:, None], p + count + step[:, None], np.tile(fixed_data, (copies, 1))]),
            g=np.hstack(g),
        )

    stride = term.stage.numel()
    stages = slots.q[:-1, :1] + np.arange(stride)
    shares = [-term.p_minus, term.inner, term.gaps, term.nodes, term.points, term.p_plus]
    places = [rows.momentum[:-1], rows.inner, rows.gaps, rows.nodes, rows.points, rows.momentum[1:]]
    found = [
        element(
            [term.stage, term.q1],
            np.hstack([stages, slots.q[1:]]),
            term.mesh,
            np.arange(count),
            term.cost,
            shares,
            places,
        )
    ]
    first, last = ends
    x_first, x_last = np.hstack([slots.q[0], slots.v[0]]), np.hstack([slots.q[-1], slots.v[1], slots.lam[-1]])
    found.append(
        element(
            [first.q, first.v], x_first[None], first.mesh, np.array([0]), first.cost,
            [first.momentum, first.gap, first.hidden, first.rows, first.points],
            [rows.momentum[:1], rows.start[None]],
        )
    )  # fmt: skip
    found.append(
        element(
            [last.q, last.v, last.lam], x_last[None], last.mesh, np.array([count - 1]), last.cost,
            [-last.momentum, last.hidden, last.rows], [rows.momentum[-1:], rows.last[None]],
        )
    )  # fmt: skip
    return found

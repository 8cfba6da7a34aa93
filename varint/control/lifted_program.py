"""The program of a rough solution whose velocities are unknowns of their own: where its unknowns
sit, its bounds, its elements, its start values; see lifted.py.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from varint.control.guess import Guess
from varint.control.inverse_dynamics import rest_controls
from varint.control.phase import CheckedPhase
from varint.discrete.legendre import mass_solve
from varint.nlp.assembly import Element, assemble
from varint.nlp.program import NonlinearProgram


@dataclass(frozen=True, eq=False)
class Prices:
    """What a program pays beside its cost: for bends and for aid, in the units of the cost, of a
    path that reaches so far in each coordinate (n,). Without a price on aid there is none.
    """

    bends: float
    aid: float
    extent: np.ndarray


@dataclass(frozen=True, eq=False)
class Places:
    """Where the unknowns sit: (q, v) at the nodes (N + 1, 2n), controls (N, k), aid (N, n) or
    (N, 0), and duration and parameters, −1 where they are fixed.
    """

    x: np.ndarray
    u: np.ndarray
    aid: np.ndarray
    shared: np.ndarray

    @property
    def end(self) -> int:
        """Number of unknowns."""
        return max(int(y.max(initial=-1)) for y in (self.x, self.u, self.aid, self.shared)) + 1


def build_places(phase: CheckedPhase, steps: int, prices: Prices | None = None) -> Places:
    s = phase.system.structure
    aided = s.n if prices is not None and prices.aid else 0
    ends = np.cumsum([0, 2 * s.n, s.controls, aided])
    first = ends[-1] * np.arange(steps + 1)[:, None]
    x, u, aid = (first + np.arange(*ends[i : i + 2]) for i in range(3))
    free = np.append(phase.free_duration, phase.c_low < phase.c_high)
    shared = np.where(free, x.max() + np.cumsum(free), -1)
    return Places(x, u[:-1], aid[:-1], shared)


def rows_of_motion(phase: CheckedPhase, steps: int) -> np.ndarray:
    """Which rows of the program are the equations of motion of each step, (N, 2n): those of the
    coordinates and those of the velocities.
    """
    return _rows_of_steps(phase, steps)[:, : 2 * phase.system.structure.n]


def _rows_of_steps(phase: CheckedPhase, steps: int) -> np.ndarray:
    bounds = phase.bounds
    count = 2 * phase.system.structure.n + bounds.at_nodes.numel() + bounds.at_points.numel()
    return np.arange(steps * count).reshape(steps, count)


def build_program(
    phase: CheckedPhase,
    t0: float,
    mesh: np.ndarray,
    places: Places,
    prices: Prices | None,
) -> NonlinearProgram:
    s, bounds, steps = phase.system, phase.bounds, len(mesh) - 1
    n, of_steps = s.structure.n, _rows_of_steps(phase, steps)
    first, last = phase.start.rows.numel(), phase.end.rows.numel()
    end = of_steps.size
    of_ends = end + np.arange(first)[None], end + first + np.arange(last)[None]
    elements = [
        _interval(phase, t0, mesh, places, prices, of_steps),
        _end(phase, t0, places, of_ends[0], False),
        _end(phase, t0, places, of_ends[1], True),
    ]
    wide = np.full(places.end, np.inf)
    x_low, x_high = -wide, wide
    sides = ((x_low, 0, phase.c_low, 1), (x_high, 1, phase.c_high, 2))
    for bound, side, c, place in sides:
        bound[places.x[:, :n]] = bounds.q[side]
        bound[places.u] = bounds.u[side]
        free = places.shared >= 0
        bound[places.shared[free]] = np.append(phase.duration[place], c)[free]
    for end_of, at in ((phase.start, places.x[0]), (phase.end, places.x[-1])):
        given = np.concatenate([end_of.q, end_of.v], axis=1)
        x_low[at] = np.maximum(x_low[at], given[1])
        x_high[at] = np.minimum(x_high[at], given[2])
    still = np.zeros(2 * n)
    low, high = (
        np.concatenate([np.tile(np.concatenate([still, *along]), steps), *ends])
        for along, ends in (
            ((bounds.nodes_low, bounds.points_low), (phase.start.low, phase.end.low)),
            ((bounds.nodes_high, bounds.points_high), (phase.start.high, phase.end.high)),
        )
    )
    program = assemble(elements, places.end, 2 * steps, len(low))
    data = np.concatenate([mesh[:-1], np.diff(mesh)])
    return NonlinearProgram(program, data, x_low, x_high, low, high)


def _shared(phase: CheckedPhase, places: Places) -> tuple[ca.SX, ca.SX, ca.SX]:
    """Duration and parameters, numbers where they are fixed; and the symbols of those that are
    not.
    """
    free = np.flatnonzero(places.shared >= 0)
    symbols, known = ca.SX.sym("shared", len(free)), np.append(phase.duration[0], phase.c)
    values = ca.SX(ca.DM(known))
    values[free.tolist()] = symbols
    return values[0], values[1:], symbols


def _interval(
    phase: CheckedPhase,
    t0: float,
    mesh: np.ndarray,
    places: Places,
    prices: Prices | None,
    rows: np.ndarray,
) -> Element:
    s, n, steps = phase.system, phase.system.structure.n, len(mesh) - 1
    duration, c, free = _shared(phase, places)
    x0, x1 = ca.SX.sym("x0", 2 * n), ca.SX.sym("x1", 2 * n)
    u, w = ca.SX.sym("u", s.structure.controls), ca.SX.sym("w", 2)
    aid = ca.SX.sym("aid", places.aid.shape[1])
    carried = ca.jtimes(s.momentum, s.q, s.v) + ca.jacobian(s.momentum, s.t)
    push = s.generalised_force - carried
    rates = phase.rates.symbols
    along = ca.Function(
        "along",
        [s.q, s.v, s.control, s.t, s.c, rates],
        [
            mass_solve(s.mass_matrix, push),
            phase.cost,
            phase.bounds.at_nodes,
            phase.bounds.at_points,
        ],
    )
    h, middle = duration * w[1], (x0 + x1) / 2
    t = t0 + duration * (w[0] + w[1] / 2)
    a, cost, nodes, points = along(middle[:n], middle[n:], u, t, c, ca.SX.zeros(rates.shape))
    total = h * cost
    if prices is not None:
        extent = ca.DM(prices.extent)
        total += prices.bends * ca.sumsqr(duration * (x1 - x0)[n:] / extent) / w[1]
        total += prices.aid * ca.sumsqr(aid) * w[1]
        a += extent * aid / duration**2 if places.aid.size else 0
    motion = x1 - x0 - h * ca.vertcat(middle[n:], a)
    k = np.arange(steps)
    return Element(
        ca.vertcat(x0, u, aid, x1, free),
        w,
        total,
        ca.vertcat(motion, nodes, points),
        np.hstack([places.x[:-1], places.u, places.aid, places.x[1:], _many(places, steps)]),
        np.stack([k, steps + k], axis=1),
        rows,
    )


def _end(phase: CheckedPhase, t0: float, places: Places, rows: np.ndarray, last: bool) -> Element:
    s, end = phase.system, phase.end if last else phase.start
    duration, c, free = _shared(phase, places)
    x, n = ca.SX.sym("x", 2 * s.structure.n), s.structure.n
    terminal = phase.terminal if last else ca.SX(0)
    at = ca.Function("at", [s.q, s.v, s.t, s.c], [terminal, ca.densify(end.rows)])
    cost, held = at(x[:n], x[n:], t0 + duration * last, c)
    where = np.hstack([places.x[-1 if last else 0][None], _many(places, 1)])
    return Element(
        ca.vertcat(x, free), ca.SX(0, 1), cost, held, where, np.zeros((1, 0), dtype=int), rows
    )


def _many(places: Places, copies: int) -> np.ndarray:
    return np.tile(places.shared[places.shared >= 0], (copies, 1))


def build_lifted_start(
    phase: CheckedPhase, mesh: np.ndarray, places: Places, guess: Guess
) -> np.ndarray:
    """The path, its velocities, and the guess's controls or none: those of inverse dynamics follow
    every kink of a path.
    """
    x = np.zeros(places.end)
    fine = np.sort(np.concatenate([mesh, (mesh[:-1] + mesh[1:]) / 2]))
    q = guess.q(fine)
    v = np.gradient(q, guess.duration * fine, axis=0)
    x[places.x] = np.hstack([q, v])[::2]
    middles = (mesh[:-1] + mesh[1:]) / 2
    x[places.u] = rest_controls(phase) if guess.u is None else guess.u(middles)
    free = places.shared >= 0
    x[places.shared[free]] = np.append(guess.duration, guess.c)[free]
    return x


def give_aid(
    phase: CheckedPhase,
    mesh: np.ndarray,
    places: Places,
    prices: Prices,
    nlp: NonlinearProgram,
    x: np.ndarray,
) -> np.ndarray:
    """Start values that keep the equations of motion by what aid makes up for; the controls take
    over from it.
    """
    n, x = phase.system.structure.n, x.copy()
    rows = rows_of_motion(phase, len(places.aid))[:, n:]
    duration = x[places.shared[0]] if places.shared[0] >= 0 else phase.duration[0]
    off = np.array(nlp.program.value(x, nlp.p)[1]).ravel()[rows]
    x[places.aid] += duration * off / np.diff(mesh)[:, None] / prices.extent
    return x


def without_curvature(nlp: NonlinearProgram, rows: np.ndarray) -> NonlinearProgram:
    """The same program to a solver that takes some rows for straight, those of aid's least squares:
    the Gauss–Newton method, whose Hessian is that of a minimum wherever the cost is convex.
    """
    exact, kept = nlp.program.hessian, np.ones(nlp.rows)
    kept[rows] = 0
    symbols = [ca.MX.sym(name, *exact.size_in(name)) for name in exact.name_in()]
    curved = exact(*symbols[:3], symbols[3] * ca.DM(kept))
    names = exact.name_in(), exact.name_out()
    hessian = ca.Function(exact.name(), symbols, [curved], *names)
    return replace(nlp, program=replace(nlp.program, hessian=hessian))

"""The action of a path as a nonlinear program: min S_d (+ E T) over all control points, and the
duration where it is free, subject to constraints, bounds and the way in which the path closes.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import casadi as ca
import numpy as np

from varint.boundary.iterate import Iterate
from varint.boundary.stationary import BoundaryValueProblem, number_unknowns
from varint.discrete.lagrangian import interval
from varint.nlp.assembly import Element, assemble
from varint.nlp.bounds import PathBounds
from varint.nlp.program import NonlinearProgram


@dataclass(frozen=True, eq=False)
class Layout:
    """Where unknowns, rows and constants of the program stand.

    Attributes
    ----------
    points, duration : ndarray of int (K, n), (0 or 1,)
        The unknowns: control points, and the duration where it is free.
    constraints, bounded, closure : ndarray of int (K, m), (len(inner), b), (n or 0,)
        The rows: constraints and bounds at control points, q(T) = S q(0) + b.
    inner : ndarray of int
        The control points that are not given.
    constants : dict of ndarray of int
        Where the constants of each name stand.
    unknowns, rows : int
        How many there are.
    """

    points: np.ndarray
    duration: np.ndarray
    constraints: np.ndarray
    bounded: np.ndarray
    closure: np.ndarray
    inner: np.ndarray
    constants: dict[str, np.ndarray]
    unknowns: int
    rows: int


class RowBlock(NamedTuple):
    """An element of the program, and the bounds of the rows that it begins."""

    element: Element
    low: np.ndarray
    high: np.ndarray


def least_action_program(
    problem: BoundaryValueProblem,
    layout: Layout,
    iterate: Iterate,
    window: tuple[float, float],
    bounded: PathBounds,
) -> NonlinearProgram:
    """min S_d (+ E T) over the control points, and the duration where it is free, within bounds."""
    constants = _constants(problem, iterate)
    blocks = [_steps(problem, layout), _bounded_points(problem, layout, bounded)]
    x_low, x_high = (np.tile(side, (len(layout.points), 1)) for side in bounded.q)
    if problem.closure is None:
        x_low[[0, -1]] = x_high[[0, -1]] = iterate.points[[0, -1]]
    else:
        blocks.append(_closed_ends(problem, layout))
    free = len(layout.duration)
    return NonlinearProgram(
        program=assemble(
            [block.element for block in blocks if len(block.element.x)],
            layout.unknowns,
            len(constants),
            layout.rows,
        ),
        p=constants,
        x_low=np.append(x_low.ravel(), [window[0]] * free),
        x_high=np.append(x_high.ravel(), [window[1]] * free),
        g_low=np.concatenate([block.low for block in blocks]),
        g_high=np.concatenate([block.high for block in blocks]),
    )


def program_layout(problem: BoundaryValueProblem, degree: int, bounds: int) -> Layout:
    """Layout of the program of a path with so many bounded expressions."""
    system, steps = problem.system.structure, problem.steps
    count, n, fixed = steps * degree + 1, system.n, problem.closure is None
    inner = np.arange(fixed, count - fixed)
    x, unknowns = number_unknowns(points=(count, n), duration=(int(problem.energy is not None),))
    g, rows = number_unknowns(
        constraints=(count, system.constraints),
        bounded=(len(inner), bounds),
        closure=(0 if fixed else n,),
    )
    constants, _ = number_unknowns(
        part=(count, 1),
        u=problem.u.shape,
        begin=(steps, 1),
        size=(steps, 1),
        c=problem.c.shape,
        clock=(4,),
    )
    return Layout(**x, **g, inner=inner, constants=constants, unknowns=unknowns, rows=rows)


def _constants(problem: BoundaryValueProblem, iterate: Iterate) -> np.ndarray:
    """Values of the constants, in the order of `program_layout`."""
    clock = [1 / problem.steps, problem.t0, problem.energy or 0.0, iterate.duration]
    parts = problem.point_shares, problem.u, problem.grid[:-1], problem.sizes, problem.c, clock
    return np.concatenate([np.ravel(x) for x in parts])


class Clock(NamedTuple):
    """Symbols of what all elements know of time: `unknown` is the duration where it is free."""

    unknown: ca.SX
    constants: ca.SX
    duration: ca.SX
    share: ca.SX
    t0: ca.SX
    energy: ca.SX


def _clock(problem: BoundaryValueProblem) -> Clock:
    share, t0, energy, guessed = constants = [ca.SX.sym(x) for x in ("share", "t0", "E", "T")]
    unknown = ca.SX.sym("T") if problem.energy is not None else ca.SX(0, 1)
    duration = unknown if problem.energy is not None else guessed
    return Clock(unknown, ca.vertcat(*constants), duration, share, t0, energy)


def _steps(problem: BoundaryValueProblem, layout: Layout) -> RowBlock:
    """Every step's share of S_d + E T, and its constraints by their weights in the action."""
    one, clock = interval(problem.system, problem.rule), _clock(problem)
    (n, d), m = one.dq.shape, one.lam.shape[0]
    points = ca.SX.sym("Q", n, d + 1)
    begin, size = ca.SX.sym("begin"), ca.SX.sym("size")
    mean = clock.duration * clock.share
    own = [one.q0, one.dq, one.lam, one.u, one.t, one.h, one.c]
    wanted = [one.action, ca.gradient(one.action, ca.vec(one.lam))]
    ahead = points[:, 1:] - ca.repmat(points[:, 0], 1, d)
    time = clock.t0 + begin * mean, size * mean
    action, constraints = ca.Function("interval", own, wanted, {"cse": True})(
        points[:, 0], ahead, ca.SX.zeros(m, d + 1), one.u, *time, one.c
    )
    window = np.arange(problem.steps)[:, None] * d + np.arange(d + 1)
    # those of given ends, and of the end of a closed path, are not asked for again
    kept = np.full(layout.constraints.shape, -1)
    asked = slice(1, -1) if problem.closure is None else slice(0, -1)
    kept[asked] = layout.constraints[asked]
    place, count = layout.constants, problem.steps
    element = Element(
        ca.vertcat(ca.vec(points), clock.unknown),
        ca.vertcat(ca.vec(one.u), one.c, begin, size, clock.constants),
        action + clock.energy * time[1],
        ca.densify(ca.vec(constraints)),
        _side_by_side(count, layout.points[window].reshape(count, -1), layout.duration),
        _side_by_side(count, *(place[x] for x in ("u", "c", "begin", "size", "clock"))),
        kept[window].reshape(count, -1),
    )
    zero = np.zeros(layout.constraints.size)
    return RowBlock(element, zero, zero)


def _bounded_points(problem: BoundaryValueProblem, layout: Layout, bounded: PathBounds) -> RowBlock:
    """The bounded expressions at every control point that is not given."""
    s, clock, part = problem.system, _clock(problem), ca.SX.sym("part")
    rows = ca.substitute(bounded.at_points, s.t, clock.t0 + part * clock.duration)
    count, place = len(layout.inner) if rows.numel() else 0, layout.constants
    inner = layout.inner[:count]
    element = Element(
        ca.vertcat(s.q, clock.unknown),
        ca.vertcat(s.c, part, clock.constants),
        ca.SX(0),
        rows,
        _side_by_side(count, layout.points[inner], layout.duration),
        _side_by_side(count, place["c"], place["part"][inner], place["clock"]),
        layout.bounded[:count],
    )
    low, high = (np.tile(side, count) for side in (bounded.points_low, bounded.points_high))
    return RowBlock(element, low, high)


def _closed_ends(problem: BoundaryValueProblem, layout: Layout) -> RowBlock:
    """q(T) − S q(0) − b = 0."""
    n, turn = problem.system.structure.n, ca.DM(problem.closure)
    start, end = ca.SX.sym("q0", n), ca.SX.sym("q1", n)
    element = Element(
        ca.vertcat(start, end),
        ca.SX(0, 1),
        ca.SX(0),
        end - ca.mtimes(turn[:, :n], start) - turn[:, n],
        layout.points[[0, -1]].reshape(1, -1),
        np.empty((1, 0), dtype=int),
        layout.closure[None],
    )
    return RowBlock(element, np.zeros(n), np.zeros(n))


def _side_by_side(copies: int, *indices: np.ndarray) -> np.ndarray:
    """Index arrays side by side; one that is the same for all copies is repeated."""
    return np.hstack([np.broadcast_to(x, (copies, x.shape[-1])) for x in indices])

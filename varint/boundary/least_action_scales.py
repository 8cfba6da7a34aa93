"""Units of a path's program that belong to the path: lengths of its coordinates, its action, sizes
of its rows. In these, Ipopt sees the same numbers whatever units the scene is written in.
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from varint.boundary.iterate import Iterate
from varint.boundary.least_action_program import Layout
from varint.boundary.newton import path_solver
from varint.boundary.stationary import BoundaryValueProblem, momenta_and_action
from varint.nlp.arrangement import Scales
from varint.nlp.program import NonlinearProgram


def path_scales(
    problem: BoundaryValueProblem,
    layout: Layout,
    iterate: Iterate,
    program: NonlinearProgram,
    start: np.ndarray,
) -> Scales:
    """Units of the unknowns, of the action and of the rows, from a first path and its program at
    `start`.

    A coordinate's is its range, or √(S / ∂²S/∂q²) where it hardly moves; the action's is the
    largest p_i times range of q_i; a row's is what changes of the unknowns by theirs make of it.
    """
    ranges, momenta, action = _extent(problem, iterate)
    size = float((momenta * ranges).max()) or abs(action) or 1.0
    hessian = program.program.hessian(start, program.p, 1.0, np.zeros(program.rows))
    curvature = _largest(np.abs(np.array(ca.diag(hessian))).ravel(), layout.points[layout.inner])
    with np.errstate(divide="ignore"):
        bent = np.where(curvature > 0, np.sqrt(size / curvature), 0.0)
    lengths = np.maximum(ranges, bent)
    lengths[lengths == 0] = lengths.max() or 1.0
    x = np.ones(program.unknowns)
    x[layout.points] = lengths
    x[layout.duration] = iterate.duration
    return Scales(x, 1 / size, 1 / _row_sizes(layout, program, start, x))


def _extent(
    problem: BoundaryValueProblem, iterate: Iterate
) -> tuple[np.ndarray, np.ndarray, float]:
    """Range and largest momentum of every coordinate of a path, and its action. A path that stays
    where it is has none yet: those of what Newton's method makes of it are taken.
    """
    if not np.ptp(iterate.points, axis=0).any():
        values, slope = problem.equations.derivatives(problem, iterate)
        change = -path_solver(problem, slope)(values)
        moved = iterate.moved(change) if np.isfinite(change).all() else iterate
        iterate = moved if moved.duration > 0 else iterate
    momenta, action = momenta_and_action(problem, iterate)
    finite = np.where(np.isfinite(momenta), np.abs(momenta), 0.0)
    return np.ptp(iterate.points, axis=0), finite.max(axis=0), action


def _row_sizes(
    layout: Layout, program: NonlinearProgram, start: np.ndarray, x: np.ndarray
) -> np.ndarray:
    """Sizes of the rows, the same at all points; of one that does not change, its bounds."""
    _, jacobian = program.program.jacobian(start, program.p)
    slopes = np.array(ca.mtimes(ca.fabs(jacobian), ca.DM(x))).ravel()
    sides = program.g_low, program.g_high
    limits = np.maximum(*(np.where(np.isfinite(g), np.abs(g), 0.0) for g in sides))
    sizes = np.ones(program.rows)
    for rows in (layout.constraints, layout.bounded, layout.closure[None]):
        if rows.size:
            found = _largest(slopes, rows)
            found = np.where(found > 0, found, _largest(limits, rows))
            sizes[rows] = np.where(found > 0, found, 1.0)
    return sizes


def _largest(values: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Largest finite value of each column of places."""
    found = values[places]
    return np.where(np.isfinite(found), found, 0.0).max(axis=0, initial=0.0)

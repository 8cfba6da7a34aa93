"""Newton's method for paths whose nodes move: of a given duration, and of any.

A first path that is far from every motion between the wanted ends in the wanted time may be near
a motion between other ends in another time. Of the equations of motion alone there are fewer than
there are unknowns, and every right-hand side of them has a solution, the motion from the same
start under these impulses: F(x) = (1 − s) F(x₀) is followed from the first path, s = 0, to a
motion, s = 1, by the shortest steps (Deuflhard, Newton Methods for Nonlinear Problems, §4.4, 5.1).
Then the ends are moved to where they belong, along motions; the duration is left free, for
there may be no path of the wanted one near by. So a path keeps the way round of the first one.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from varint.boundary.moving_nodes import (
    MovingPath,
    constants,
    moving_equations,
    remeshed,
    scaled,
)
from varint.boundary.newton import equilibrated_solver
from varint.boundary.stationary import BoundaryValueProblem

LAST_CORRECTION = 1e-9  # mean square, relative to the path
ROUGH = 1e-4  # of the way: corrections of a path that is left again at once
SMALLEST_DAMPING = 1e-3
SHRINK = 0.3  # of a step: what an iteration leaves of it at least
CORRECTIONS = 10
CONTRACTION = 0.7  # corrections that shrink less after the second do not converge
FIRST_SHARE, LEAST_SHARE = 0.1, 1e-4  # of the way from the first path to a motion
LARGEST_MOVE = 0.25  # of the path, in one part of the way
FARTHEST = 8.0  # times the first duration, and its inverse
STALE = 1.2  # ratio of a scale to that of the nodes, from which on these are spread anew
MOST_STAGES = 80


@dataclass(frozen=True, eq=False)
class Linearised:
    """The rows of a moving path, and what solves them together with one condition more.

    Attributes
    ----------
    values : ndarray
        The rows; the last is zero, for that condition.
    slope : DM
        Their derivatives.
    """

    values: np.ndarray
    slope: ca.DM

    def changes(self, condition: np.ndarray, wanted: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The change that gives the rows `wanted`, `condition` · change = 0, and the direction that
        leaves the rows as they are.
        """
        bordered = ca.vertcat(self.slope[:-1, :], ca.DM(condition).T)
        right = np.zeros((len(wanted), 2))
        right[:, 0], right[-1, 1] = wanted, 1.0
        right[-1, 0] = 0.0
        both = equilibrated_solver(bordered)(right)
        return both[:, 0], both[:, 1]


class Rows:
    """The rows of moving paths of so many steps."""

    def __init__(self, problem: BoundaryValueProblem, steps: int):
        self.problem = problem
        self.values, self.linearised = moving_equations(problem.system, problem.rule, steps)
        self.zero = np.zeros(self.values.numel_in(0))

    def __call__(self, path: MovingPath) -> np.ndarray:
        """All rows of the path."""
        return np.array(self.values(self.zero, constants(self.problem, path))).ravel()

    def at(self, path: MovingPath) -> Linearised:
        """The rows and their derivatives, free for one condition."""
        values, slope = self.linearised(self.zero, constants(self.problem, path))
        values = np.array(values).ravel()
        values[-1] = 0.0
        return Linearised(values, slope)

    def some(self, path: MovingPath, kept: np.ndarray) -> tuple[np.ndarray, ca.DM]:
        """Some of the rows, and their derivatives."""
        values, slope = self.linearised(self.zero, constants(self.problem, path))
        return np.array(values).ravel()[kept], slope[kept.tolist(), :]


def of_its_duration(
    problem: BoundaryValueProblem, path: MovingPath, most: int = 40
) -> MovingPath | None:
    """The stationary path of the same duration near a moving path, by damped Newton's method."""
    rows, damping, polish = Rows(problem, len(path.sizes)), 1.0, False
    hold = np.zeros(len(rows.zero))
    hold[-1] = 1.0
    for _ in range(most):
        values, slope = rows.linearised(rows.zero, constants(problem, path))
        values = np.array(values).ravel()
        if not np.isfinite(values).all():
            return None
        solve, weights = equilibrated_solver(slope), path.weights
        change = -solve(values)
        size = np.linalg.norm(weights * change)
        if not np.isfinite(size):
            return None
        if size <= LAST_CORRECTION:
            path = path.moved(change)
            if polish:
                return path
            polish = True
            continue
        shrink = float((np.diff(change[-len(path.sizes) - 2 : -1]) / path.sizes).min())
        damping = min(1.0, 4 * damping, 0.5 / size)
        damping = min(damping, (1 - SHRINK) / max(-shrink, np.finfo(float).tiny))
        while True:
            trial = path.moved(damping * change)
            left = rows(trial)
            closer = np.linalg.norm(weights * solve(left)) <= (1 - damping / 4) * size
            if np.isfinite(left).all() and closer:
                break
            damping /= 2
            if damping < SMALLEST_DAMPING:
                return None
        path = trial
    return None


def of_any_duration(problem: BoundaryValueProblem, path: MovingPath) -> MovingPath | None:
    """A stationary path near a moving path, of whatever duration.

    First a motion near it between any ends, then the ends are moved to where they belong.
    """
    first_duration = path.iterate.duration
    n, count = path.iterate.starts.shape[1], len(path.weights)
    of_ends = path.iterate.points.size + np.arange(2 * n)
    for given_up in ([*of_ends, count - 1], [count - 1]):
        kept = np.setdiff1d(np.arange(count), given_up)
        moved = _relaxed(problem, path, kept, first_duration)
        if moved is None:
            return None
        path = fresh(problem, moved, kept) or moved
    return path


def _relaxed(
    problem: BoundaryValueProblem, path: MovingPath, kept: np.ndarray, first_duration: float
) -> MovingPath | None:
    """The path that satisfies the rows `kept`, reached by the shortest steps."""
    rows = Rows(problem, len(path.sizes))
    values, slope = rows.some(path, kept)
    first, s, share = values, 0.0, FIRST_SHARE
    for _ in range(MOST_STAGES):
        weights = path.weights
        way = shortest(slope, weights, -first)
        size = np.linalg.norm(weights * way)
        if not np.isfinite(size):
            return None
        share = min(share, LARGEST_MOVE / max(size, np.finfo(float).tiny), 1 - s)
        while True:
            wanted = (1 - s - share) * first
            limit = LAST_CORRECTION if s + share >= 1 else ROUGH
            found = _corrected(rows, path.moved(share * way), kept, wanted, share * size, limit)
            if found is not None:
                break
            share /= 2
            if share < LEAST_SHARE:
                return None
        path, values, slope, corrections = found
        s += share
        if s >= 1:
            return path
        if not 1 / FARTHEST < path.iterate.duration / first_duration < FARTHEST:
            return None
        share *= 2.0 if corrections <= 4 else 1.0 if corrections <= 6 else 0.7
    return None


def shortest(slope: ca.DM, weights: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """The least change in the weighted mean square with slope · change = wanted, fewer rows than
    columns: its multipliers are unknown too.
    """
    rows, columns = slope.shape
    whole = ca.blockcat([[ca.diag(ca.DM(weights**2)), slope.T], [slope, ca.DM(rows, rows)]])
    return equilibrated_solver(whole)(np.concatenate([np.zeros(columns), wanted]))[:columns]


def _corrected(
    rows: Rows,
    path: MovingPath,
    kept: np.ndarray,
    wanted: np.ndarray,
    farthest: float,
    limit: float,
) -> tuple[MovingPath, np.ndarray, ca.DM, int] | None:
    """The path near `path` with the rows `wanted`, these rows, and the corrections taken."""
    last = np.inf
    for correction in range(CORRECTIONS):
        if not path.runs_forwards:
            return None
        values, slope = rows.some(path, kept)
        if not np.isfinite(values).all():
            return None
        if last <= limit:
            return path, values, slope, correction
        change = shortest(slope, path.weights, wanted - values)
        size = float(np.linalg.norm(path.weights * change))
        if not size <= farthest or (correction > 1 and size > CONTRACTION * last):
            return None
        path, last = path.moved(change), size
    return None


def fresh(
    problem: BoundaryValueProblem, path: MovingPath, kept: np.ndarray | None = None
) -> MovingPath | None:
    """The path with the rows `kept` (default: stationary, of its duration) on nodes spread by its
    own scales; None where those are not stale, or where it is lost.
    """
    scales = scaled(problem, path.iterate, path.sizes).scales
    if np.abs(np.log(scales / path.scales)).max() < np.log(STALE):
        return None
    spread = remeshed(problem, path, scales)
    if kept is None:
        return of_its_duration(problem, spread, CORRECTIONS + 5)
    rows, none = Rows(problem, len(path.sizes)), np.zeros(len(kept))
    found = _corrected(rows, spread, kept, none, LARGEST_MOVE, LAST_CORRECTION)
    return None if found is None else found[0]

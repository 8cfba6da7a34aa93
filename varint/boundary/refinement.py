"""The error of a path, measured by the same path with every step halved, and steps that meet a
wanted error.

The halved path differs from the given one by the error of the given one, but for a part that the
order of the rule makes small; nothing is assumed of that order. One linear solve finds the
difference where the path is smooth on its steps; where it is not, Newton's method goes on.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from varint.boundary.continuation import solve_with_continuation
from varint.boundary.divided_steps import split_steps
from varint.boundary.iterate import Iterate
from varint.boundary.newton import Measure, NewtonResult, coordinate_ranges, newton, path_solver
from varint.boundary.result import along_path
from varint.boundary.stationary import BoundaryValueProblem

LARGE = 1e-2  # an error that is worth a warning: the path may not even be near a true one
LINEAR = 1e-2  # of the error: what the linear solve may leave of it
MOST_PARTS = 16  # of a step in one round: finer steps wait until the next round has looked
MOST_ROUNDS = 12
MOST_STEPS = 20_000
MOST_HALVINGS = 7  # of a first path whose steps are too few for any
MOST_LOST = 2  # meshes in turn on which there is no path: it is not for want of steps then
MARGIN = 0.5  # of the wanted error is aimed at
TURN = 0.3  # radians by which a first path may turn in a step
FLOOR = 1e-14  # relative; differences of paths this small are round-off


class PathError(NamedTuple):
    """Error of a path at its nodes, and what every step adds to it.

    Attributes
    ----------
    nodes : float
        Largest error of a coordinate relative to its range, of a momentum (times that range)
        relative to the largest, or of a free duration; infinite where the halved path is none.
    steps : ndarray (N,)
        How far the middle of every step lies from the halved path's, by the steps themselves.
    """

    nodes: float
    steps: np.ndarray


def path_error(problem: BoundaryValueProblem, iterate: Iterate) -> PathError:
    """How far a stationary path lies from the one with every step halved."""
    halved, start = split_steps(problem, iterate, np.full(problem.steps, 2))
    finer = _correct(halved, start)
    unknown = PathError(np.inf, np.full(problem.steps, np.inf))
    if finer is None:
        return unknown
    ranges = coordinate_ranges(iterate.points)
    q, p, _ = along_path(problem, iterate)
    q_fine, p_fine, _ = along_path(halved, finer)
    size = np.abs(p * ranges).max()
    nodes = max(
        float((np.abs(q_fine[::2] - q) / ranges).max()),
        float((np.abs(p_fine[::2] - p) * ranges).max() / size) if size else 0.0,
        abs(finer.duration / iterate.duration - 1),
    )
    moved = np.concatenate([finer.starts - start.starts, (finer.end - start.end)[None]])
    local = moved[1::2] - (moved[:-1:2] + moved[2::2]) / 2
    return PathError(nodes, (np.abs(local) / ranges).max(axis=1)) if np.isfinite(nodes) else unknown


def _correct(problem: BoundaryValueProblem, start: Iterate) -> Iterate | None:
    """The stationary path next to `start`, by one linear solve where that is enough."""
    values, slope = problem.equations.derivatives(problem, start)
    if not np.isfinite(values).all():
        return None
    change = -path_solver(problem, slope)(values)
    size = Measure(problem, start)(change)
    n, degree = start.starts.shape[1], start.increments.shape[1]
    block = n + start.multipliers.shape[1]
    at_nodes = change[: (problem.steps * degree + 1) * block].reshape(-1, block)[:: 2 * degree, :n]
    nodes = float((np.abs(at_nodes) / coordinate_ranges(start.points)).max())
    if problem.rule.points and size**2 <= max(LINEAR * nodes, FLOOR):
        return start.moved(change)
    outcome = newton(problem, start)
    return outcome.iterate if outcome.solved else None


def refine(
    first: Callable[[int], tuple[BoundaryValueProblem, Iterate]], tol: float
) -> tuple[BoundaryValueProblem, NewtonResult, float]:
    """The path near a first one on steps so short, where it needs them, that its error is below
    `tol`.

    `first(k)` is the first path on its own steps, each halved k times. Returned with the path's
    error; where `tol` is out of reach, the last path tried with its error. Steps are divided, never
    joined, so that controls keep their meaning. A mesh on which no path is found, or one whose
    error is large, says nothing: the next one starts from the first path again.
    """
    (mesh, near), halvings = first(0), 0
    best, everywhere, lost = np.inf, False, 0
    for _ in range(MOST_ROUNDS):
        outcome = solve_with_continuation(mesh, near)
        error = path_error(mesh, outcome.iterate) if outcome.solved else None
        apart = np.inf if error is None else error.nodes
        stalled = apart > best / 2
        lost = 0 if outcome.solved else lost + 1
        if apart <= tol or (stalled and everywhere) or lost == MOST_LOST:
            break
        if error is not None and apart <= LARGE:
            # what steps add by themselves may mislead: then all of them are halved
            best, everywhere = min(apart, best), stalled
            twice = np.full(mesh.steps, 2)
            parts = twice if everywhere else _parts_by_error(mesh, error, tol)
            finer = split_steps(mesh, outcome.iterate, parts)
        else:
            halvings += 1
            finer = first(halvings)
        if finer[0].steps > MOST_STEPS or halvings > MOST_HALVINGS:
            break
        mesh, near = finer
    return mesh, outcome, apart


def parts_by_turning(problem: BoundaryValueProblem, nodes: np.ndarray) -> np.ndarray:
    """Parts of each step that a first path needs so as to turn little in each."""
    ahead = np.diff(nodes / coordinate_ranges(nodes), axis=0)
    moving = np.flatnonzero(np.abs(ahead).max(axis=1) > 0)
    if len(moving) < 2:
        return np.ones(problem.steps, dtype=int)
    direction = ahead[moving] / np.linalg.norm(ahead[moving], axis=1)[:, None]
    turn = np.arccos(np.clip((direction[1:] * direction[:-1]).sum(axis=1), -1, 1))
    middle = (moving + 0.5) * (problem.steps / len(ahead))
    turned = np.interp(problem.grid, middle, np.append(0.0, np.cumsum(turn)))
    return _grade(np.clip(np.diff(turned) / TURN, 1, MOST_PARTS))


def _grade(parts: np.ndarray) -> np.ndarray:
    """Whole numbers of parts, none less than half of its neighbours'."""
    parts = np.ceil(parts)
    for _ in range(int(np.log2(parts.max())) + 1):
        parts[1:] = np.maximum(parts[1:], np.ceil(parts[:-1] / 2))
        parts[:-1] = np.maximum(parts[:-1], np.ceil(parts[1:] / 2))
    return parts.astype(int)


def _parts_by_error(problem: BoundaryValueProblem, error: PathError, tol: float) -> np.ndarray:
    """Parts of each step that spread the error evenly and bring it below `tol`."""
    wanted, rule = MARGIN * tol / error.nodes, problem.rule
    most = int(np.clip(np.ceil(wanted ** (-1 / rule.order)), 2, MOST_PARTS))
    largest = error.steps.max()
    if not rule.points or not largest > 0:
        return np.full(problem.steps, most)
    degree = rule.degree + 1  # of the step's size in the error between its nodes
    share = (error.steps / largest) ** (1 / degree)
    return np.clip(np.ceil(most * share), 1, most).astype(int)

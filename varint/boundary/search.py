"""How a stationary path is looked for: on its steps from a first path, or along its way.

A first path that somebody drew says how the path goes: how often round a centre, and on which side
of it. Where Newton's method on the steps does not converge at once, it may jump to a path of
another way, so nodes that move along find it (`varint.boundary.moving_newton`) and a family of
durations leads to the wanted one (`varint.boundary.by_duration`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from varint.boundary.by_duration import of_duration
from varint.boundary.continuation import solve_with_continuation
from varint.boundary.divided_steps import split_steps, with_steps
from varint.boundary.iterate import Iterate
from varint.boundary.moving_newton import of_any_duration, of_its_duration
from varint.boundary.moving_nodes import MovingPath, moving_path, through_times
from varint.boundary.newton import Measure, NewtonResult, coordinate_ranges, newton, path_solver
from varint.boundary.problem import first_path
from varint.boundary.refinement import parts_by_turning, path_error, refine
from varint.boundary.stationary import BoundaryValueProblem
from varint.boundary.winding import goes_as
from varint.rules.rule import gauss

CLOSE, CONTRACTION = 0.2, 0.25  # of the path; of the first correction, what the second may be
# times the wanted duration: what a first path is taken to last when it is made a motion
DURATIONS = (1.0, 2.0, 0.5, 1.4, 0.7, 4.0, 0.25, 2.8, 0.35)
STEPS, STEPS_A_RADIAN, MOST_STEPS = 20, 4, 300  # of the nodes that move along
MOST_UNKNOWNS = 6000  # of a path whose nodes move along: the search takes seconds then
SETTLED = 0.02  # of the path: what another rule on the same nodes may change
MOST_DOUBLINGS = 4
ROUND_OFF = 1e-12  # of the duration, in times of nodes that are the same
SEARCH = gauss(4)  # on steps by the path's own length its error is 1e-4 or less


class Found(NamedTuple):
    """What was found: the problem on its last mesh, Newton's method there, the path's error."""

    problem: BoundaryValueProblem
    outcome: NewtonResult
    error: float


Search = Callable[[BoundaryValueProblem, np.ndarray, float, float | None], Iterator[Found]]


def on_its_steps(
    problem: BoundaryValueProblem, nodes: np.ndarray, duration: float, tol: float | None
) -> Iterator[Found]:
    """One path, by Newton's method and continuation on the steps themselves."""
    if tol is None:
        yield _at_once(problem, first_path(problem, nodes, duration), solve_with_continuation)
    else:
        yield Found(*refine(_first_paths(problem, nodes, duration), tol))


def along_its_way(
    problem: BoundaryValueProblem, nodes: np.ndarray, duration: float, tol: float | None
) -> Iterator[Found]:
    """Paths that go the way of the first one, the nearest first; where there are none, the path on
    its steps.
    """
    if not _can_move(problem, nodes):
        yield from on_its_steps(problem, nodes, duration, tol)
        return
    found = False
    if is_close(*_first_paths(problem, nodes, duration)(0)):
        for one in on_its_steps(problem, nodes, duration, tol):
            found = _is_near(one, nodes, duration)
            if found:
                yield one
    for ways in _ways(problem, nodes, duration):
        for path in ways:
            one, kept = _resolved(problem, path, duration, tol)
            if kept and (tol is None or one.error <= tol):
                found = True
                yield one
        if found:
            return
    if not found:
        yield from on_its_steps(problem, nodes, duration, tol)


def is_close(problem: BoundaryValueProblem, iterate: Iterate) -> bool:
    """Whether Newton's method converges from here at once: its first correction is short and the
    second much shorter (Deuflhard, Newton Methods for Nonlinear Problems, §2.1).
    """
    values, slope = problem.equations.derivatives(problem, iterate)
    solve, size = path_solver(problem, slope), Measure(problem, iterate)
    change = -solve(values)
    first = size(change)
    if not first <= CLOSE:
        return False
    left = problem.equations(problem, iterate.moved(change))
    return bool(np.isfinite(left).all() and size(solve(left)) <= CONTRACTION * first)


def _is_near(one: Found, nodes: np.ndarray, duration: float) -> bool:
    """Whether a path has stayed where Newton's method saw it from the first one."""
    return _has_stayed(one, one.problem, first_path(one.problem, nodes, duration))


def _has_stayed(one: Found, problem: BoundaryValueProblem, near: Iterate) -> bool:
    """Whether a path has stayed where Newton's method saw it: near another one on steps of which
    its own are parts.
    """
    if not one.outcome.solved:
        return False
    own, wanted = (x.grid / x.steps for x in (one.problem, problem))
    points = np.vstack([one.outcome.iterate.starts, one.outcome.iterate.end])
    first = np.vstack([near.starts, near.end])
    same = np.searchsorted(own, wanted - ROUND_OFF)
    apart = np.abs(points[same] - first) / coordinate_ranges(near.points)
    return float(apart.max()) <= CLOSE / (1 - CONTRACTION)


def _can_move(problem: BoundaryValueProblem, nodes: np.ndarray) -> bool:
    """Whether nodes can move along: fixed ends and duration, several coordinates, nothing that is
    given step by step.
    """
    s = problem.system.structure
    fixed = problem.ends is not None and problem.energy is None
    plain = not (s.constraints or s.controls or s.linear)
    few = _search_steps(nodes) * SEARCH.degree * s.n <= MOST_UNKNOWNS
    return fixed and plain and s.n > 1 and few


def _first_paths(
    problem: BoundaryValueProblem, nodes: np.ndarray, duration: float
) -> Callable[[int], tuple[BoundaryValueProblem, Iterate]]:
    """The first path on steps that follow its turning, each of them halved so often."""
    mesh = with_steps(problem, parts_by_turning(problem, nodes))

    def halved(times: int) -> tuple[BoundaryValueProblem, Iterate]:
        finer = with_steps(mesh, np.full(mesh.steps, 2**times))
        return finer, first_path(finer, nodes, duration)

    return halved


def _at_once(
    problem: BoundaryValueProblem,
    iterate: Iterate,
    solve: Callable[[BoundaryValueProblem, Iterate], NewtonResult],
) -> Found:
    outcome = solve(problem, iterate)
    error = path_error(problem, outcome.iterate).nodes if outcome.solved else np.inf
    return Found(problem, outcome, error)


def _ways(
    problem: BoundaryValueProblem, nodes: np.ndarray, duration: float
) -> Iterator[Iterator[MovingPath]]:
    """Motions of the wanted duration whose nodes moved along from the first path, for each duration
    that this one may be taken to last; last those that go another way round.
    """
    search, steps, others = replace(problem, rule=SEARCH), _search_steps(nodes), []
    for share in DURATIONS:
        motion = of_any_duration(search, moving_path(search, nodes, share * duration, steps))
        if motion is None:
            continue
        if goes_as(problem.system, motion.iterate.points, nodes):
            yield of_duration(search, motion, duration)
        else:
            others.append(motion)
    for motion in others:
        yield of_duration(search, motion, duration)


def _search_steps(nodes: np.ndarray) -> int:
    """Steps by what a first path turns."""
    ahead = np.diff(nodes / coordinate_ranges(nodes), axis=0)
    ahead = ahead[np.abs(ahead).max(axis=1) > 0]
    direction = ahead / np.linalg.norm(ahead, axis=1)[:, None]
    cosines = (direction[1:] * direction[:-1]).sum(axis=1)
    turn = float(np.arccos(np.clip(cosines, -1, 1)).sum())
    return min(STEPS + int(STEPS_A_RADIAN * turn), MOST_STEPS)


def _resolved(
    problem: BoundaryValueProblem, path: MovingPath, duration: float, tol: float | None
) -> tuple[Found, bool]:
    """A path that was found by nodes that move, on the problem's own steps or to its tolerance, and
    whether it is still that one: from nodes too coarse for it Newton's method leaps to another.
    """
    if tol is None:
        t = duration / problem.steps * problem.grid
        near = replace(through_times(SEARCH, path, t, problem.rule), duration=duration)
        one = _at_once(problem, near, newton)
        return one, _has_stayed(one, problem, near)
    mesh, near = _settled(problem, path, duration)

    def halved(times: int) -> tuple[BoundaryValueProblem, Iterate]:
        return split_steps(mesh, near, np.full(mesh.steps, 2**times))

    one = Found(*refine(halved, tol))
    return one, _has_stayed(one, mesh, near)


def _settled(
    problem: BoundaryValueProblem, path: MovingPath, duration: float
) -> tuple[BoundaryValueProblem, Iterate]:
    """The path by the problem's rule on nodes that stay, where Newton's method keeps it: on twice
    as many as often as it does not.
    """
    search = replace(problem, rule=SEARCH)
    for _ in range(MOST_DOUBLINGS):
        t = np.append(0.0, np.cumsum(path.sizes)) * (duration / path.sizes.sum())
        steps = len(path.sizes)
        mesh = replace(problem, grid=t * (steps / duration), u=np.zeros((steps, 0)))
        near = replace(through_times(SEARCH, path, t, problem.rule), duration=duration)
        outcome = newton(mesh, near)
        apart = np.abs(outcome.iterate.points - near.points) / coordinate_ranges(near.points)
        if outcome.solved and apart.max() <= SETTLED:
            return mesh, outcome.iterate
        twice = np.append((t[:-1, None] + np.outer(path.sizes, [0.0, 0.5])).ravel(), t[-1])
        finer = MovingPath(through_times(SEARCH, path, twice, SEARCH), np.diff(twice), path.scales)
        sharper = of_its_duration(search, finer)
        if sharper is None:
            break
        path = sharper
    return mesh, near

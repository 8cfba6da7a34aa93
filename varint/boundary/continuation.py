"""From a first path to a stationary one: Newton's method, and what takes over where it fails."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from varint.boundary.iterate import Iterate, extrapolate, with_duration
from varint.boundary.least_action_program import program_layout
from varint.boundary.minimise import bounds_of_path, has_succeeded, least_action_near
from varint.boundary.newton import (
    RESIDUAL_LIMIT,
    Measure,
    NewtonResult,
    coordinate_ranges,
    newton,
    path_solver,
)
from varint.boundary.stationary import BoundaryValueProblem

FAR = 1.0  # range of a coordinate: a path this far from the first one may be of another kind
ASTRAY = 3.0  # times the extent of the first path: where Newton's method has jumped elsewhere
SHORTEST = 1024  # continuation begins at this part of the duration at the latest
FIRST_GROWTH, SMALLEST_GROWTH = np.sqrt(2.0), 1.0005
MOST_STAGES = 100
MOST_MINIMISING = (
    100  # iterations of Ipopt; where the action has no minimum it would go on for ever
)
CONTINUATION_ITERATIONS = 12  # a path that needs more is too far from the last one
# of the duration: times in which a first path is looked at for one that it nearly takes by itself
OWN_DURATIONS = 2.0 ** np.linspace(-3, 3, 25)
GOLDEN = (np.sqrt(5) - 1) / 2
CLOSE = 1e-3  # relative: durations this close are one to Newton's method


def solve_with_continuation(problem: BoundaryValueProblem, iterate: Iterate) -> NewtonResult:
    """Newton's method; where it fails between fixed ends or lands far away, continuation from the
    duration that the first path nearly takes by itself, then from a short one; where that ends far
    from the first path, the minimum of the action too, and the nearest of them is taken.
    """
    outcome = newton(problem, iterate)
    only = problem.closure is not None or problem.energy is not None
    stationary = outcome.residual <= RESIDUAL_LIMIT  # but for a family of paths
    if only or problem.system.structure.linear or (stationary and not outcome.solved):
        return outcome
    if outcome.solved and not _is_astray(iterate, outcome):
        return outcome
    iterations, best = outcome.iterations, outcome
    nearest = _apart(iterate, outcome) if outcome.solved else np.inf
    for attempt in _attempts(problem, iterate):
        iterations += attempt.iterations
        if attempt.solved and _apart(iterate, attempt) < nearest:
            best, nearest = attempt, _apart(iterate, attempt)
        if nearest <= FAR:
            break
    return replace(best, iterations=iterations)


def _apart(first: Iterate, outcome: NewtonResult) -> float:
    """How far a path is from the first one, in ranges of each coordinate."""
    change = np.abs(outcome.iterate.points - first.points)
    return float((change / coordinate_ranges(first.points)).max())


def _is_astray(first: Iterate, outcome: NewtonResult) -> bool:
    """Has Newton's method left the first path by several times all of its extent?"""
    extent = float(np.ptp(first.points, axis=0).max())
    away = float(np.abs(outcome.iterate.points - first.points).max())
    return extent > 0 and away > ASTRAY * extent


def _attempts(problem: BoundaryValueProblem, iterate: Iterate) -> Iterator[NewtonResult]:
    own = own_duration(problem, iterate)
    first = newton(problem, with_duration(iterate, own))
    if first.solved:
        yield _continue_in_duration(problem, first, iterate.duration)
    ratio = 2
    while ratio <= SHORTEST:
        first = newton(problem, with_duration(iterate, iterate.duration / ratio))
        if first.solved:
            yield _continue_in_duration(problem, first, iterate.duration)
            break
        ratio *= 2
    if problem.rule.points and not problem.system.structure.forced:
        minimum = _minimum(problem, iterate)
        if minimum is not None:
            yield newton(problem, minimum)


def _minimum(problem: BoundaryValueProblem, iterate: Iterate) -> Iterate | None:
    """The path of least action near a first path."""
    bounded = bounds_of_path(problem, [])
    layout = program_layout(problem, iterate.increments.shape[1], 0)
    window = (iterate.duration, iterate.duration)
    minimum, outcome = least_action_near(
        problem, layout, iterate, window, bounded, {"ipopt": {"max_iter": MOST_MINIMISING}}
    )
    return minimum if has_succeeded(outcome) else None


def own_duration(problem: BoundaryValueProblem, iterate: Iterate) -> float:
    """The duration near the problem's in which Newton's first correction of a path is least."""

    def correction(duration: float) -> float:
        trial = with_duration(iterate, duration)
        values, slope = problem.equations.derivatives(problem, trial)
        size = Measure(problem, trial)(path_solver(problem, slope)(values))
        return size if np.isfinite(size) else np.inf

    durations = iterate.duration * OWN_DURATIONS
    best = int(np.argmin([correction(x) for x in durations]))
    low, high = durations[max(best - 1, 0)], durations[min(best + 1, len(durations) - 1)]
    return golden_section(correction, float(low), float(high), CLOSE * iterate.duration)


def golden_section(function: Callable[[float], float], low: float, high: float, size: float):
    """Where a function with one minimum between two places is least, to within `size`."""
    inner = [high - GOLDEN * (high - low), low + GOLDEN * (high - low)]
    values = [function(x) for x in inner]
    while high - low > size:
        if values[0] < values[1]:
            high, inner, values = inner[1], [0.0, inner[0]], [0.0, values[0]]
            inner[0] = high - GOLDEN * (high - low)
            values[0] = function(inner[0])
        else:
            low, inner, values = inner[0], [inner[1], 0.0], [values[1], 0.0]
            inner[1] = low + GOLDEN * (high - low)
            values[1] = function(inner[1])
    return inner[int(np.argmin(values))]


def _continue_in_duration(
    problem: BoundaryValueProblem, outcome: NewtonResult, duration: float
) -> NewtonResult:
    """Paths of longer and longer (or shorter and shorter) durations, each starting from the last,
    up to `duration`; the last trial where they end before.
    """
    before, growth, iterations = None, FIRST_GROWTH, outcome.iterations
    for _ in range(MOST_STAGES):
        last = outcome.iterate
        if last.duration == duration:
            return replace(outcome, iterations=iterations)
        ahead = float(np.clip(duration, last.duration / growth, last.duration * growth))
        near = extrapolate(before, last, ahead) if before else with_duration(last, ahead)
        trial = newton(problem, near, CONTINUATION_ITERATIONS)
        iterations += trial.iterations
        if trial.solved:
            before, outcome, growth = last, trial, growth**1.5
        else:
            growth = np.sqrt(growth)
        if growth < SMALLEST_GROWTH:
            break
    return replace(outcome, status="a duration that was not reached", iterations=iterations)

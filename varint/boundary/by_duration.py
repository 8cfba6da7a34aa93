"""Families of paths between the same ends: from one duration to another, round their folds.

With the duration as one more unknown the stationary paths form curves. They are followed by their
length (Keller's pseudo-arclength), so that a duration below which there is no path of the kind is
passed as a fold: behind it lies the other path of the same duration and the same way round.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from varint.boundary.iterate import Iterate
from varint.boundary.moving_newton import (
    CONTRACTION,
    CORRECTIONS,
    LAST_CORRECTION,
    Rows,
    fresh,
    of_its_duration,
)
from varint.boundary.moving_nodes import MovingPath
from varint.boundary.stationary import BoundaryValueProblem

FIRST_STEP, LONGEST_STEP, SHORTEST_STEP = 0.05, 0.3, 1e-5  # mean squares of the path
BENT = 0.7  # cosine of an angle: directions of the family that differ more are too far apart
FARTHEST = 6.0  # times the wanted duration
MOST_STAGES = 100
MOST_TRIALS = 12  # at the wanted duration


def of_duration(
    problem: BoundaryValueProblem, path: MovingPath, duration: float
) -> Iterator[MovingPath]:
    """Stationary paths of the wanted duration in the family of a stationary path, the nearest in
    its direction first.
    """
    towards = 1.0 if duration >= path.iterate.duration else -1.0
    for direction in (towards, -towards):
        yield from _follow(problem, path, direction, duration)


def _follow(
    problem: BoundaryValueProblem, path: MovingPath, direction: float, duration: float
) -> Iterator[MovingPath]:
    rows = Rows(problem, len(path.sizes))
    along = np.zeros(len(rows.zero))
    along[-1] = direction * path.iterate.duration
    along = _direction(rows, path, along)
    step = FIRST_STEP
    for _ in range(MOST_STAGES):
        found = _step(rows, path, along, step)
        if found is None:
            step /= 2
            if step < SHORTEST_STEP:
                return
            continue
        ahead, new, corrections = found
        before, after = path.iterate.duration, ahead.iterate.duration
        if before != after and (before - duration) * (after - duration) <= 0:
            share = (duration - before) / (after - before)
            there = of_its_duration(problem, _between(path, ahead, share, duration), MOST_TRIALS)
            if there is not None:
                yield there
            elif step > SHORTEST_STEP * 10:
                step /= 3
                continue
        elif (turn := _passes_at_fold(before, along[-1], new[-1], step, duration)) is not None:
            step = turn
            continue
        if not 1 / FARTHEST < after / duration < FARTHEST:
            return
        path, along = ahead, new
        spread = fresh(problem, path)
        if spread is not None:
            path, sign = spread, np.sign(along[-1])
            along = _direction(rows, path, along)
            along = along if np.sign(along[-1]) == sign else -along
        factor = 1.6 if corrections <= 4 else 1.0 if corrections <= 6 else 0.7
        step = min(LONGEST_STEP, step * factor)


def _passes_at_fold(
    before: float, slope: float, ahead: float, step: float, duration: float
) -> float | None:
    """How far the family turns back within a step, if it passes the duration before that: where
    the parabola with these slopes of the duration is level.
    """
    if slope * ahead >= 0 or step < 10 * SHORTEST_STEP:
        return None
    turn = step * slope / (slope - ahead)
    level = before + slope * turn / 2
    return turn if (level - duration) * (before - duration) <= 0 else None


def _direction(rows: Rows, path: MovingPath, near: np.ndarray) -> np.ndarray:
    """The family's direction, of length one, on the side of `near`."""
    weights = path.weights
    _, along = rows.at(path).changes(weights**2 * near, np.zeros(len(near)))
    along = along / np.linalg.norm(weights * along)
    return along * np.sign((weights * along) @ (weights * near))


def _step(
    rows: Rows, path: MovingPath, along: np.ndarray, step: float
) -> tuple[MovingPath, np.ndarray, int] | None:
    """The family's path so far ahead, its direction there, and the corrections that it took."""
    weights, trial, last = path.weights, path.moved(step * along), np.inf
    condition = weights**2 * along
    for correction in range(CORRECTIONS):
        if not trial.runs_forwards:
            return None
        here = rows.at(trial)
        if not np.isfinite(here.values).all():
            return None
        change, free = here.changes(condition, -here.values)
        size = float(np.linalg.norm(weights * change))
        if not size <= step or (correction > 1 and size > CONTRACTION * last):
            return None
        trial, last = trial.moved(change), size
        if size <= 100 * LAST_CORRECTION:
            break
    else:
        return None
    new = trial.weights
    free = free / np.linalg.norm(new * free)
    cosine = (new * free) @ (new * along) / np.linalg.norm(new * along)
    if abs(cosine) < BENT or not trial.runs_forwards:
        return None
    return trial, free * np.sign(cosine), correction


def _between(a: MovingPath, b: MovingPath, share: float, duration: float) -> MovingPath:
    """A path between two of a family, of the given duration."""

    def mixed(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        return x + share * (y - x)

    x, y = a.iterate, b.iterate
    sizes = mixed(a.sizes, b.sizes)
    iterate = Iterate(
        mixed(x.starts, y.starts),
        mixed(x.increments, y.increments),
        mixed(x.multipliers, y.multipliers),
        mixed(x.momenta, y.momenta),
        duration,
    )
    return replace(a, iterate=iterate, sizes=sizes * (duration / sizes.sum()))

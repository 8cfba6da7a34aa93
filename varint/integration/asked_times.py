"""Runs whose nodes are the times that were asked for: how long they must last, and what is kept."""

from __future__ import annotations

import math
from functools import cache
from math import isfinite
from operator import ge, le
from types import ModuleType
from typing import Any

import numpy as np

from varint.errors import InputError
from varint.integration.problem import WHOLE, Grid
from varint.results.dense_output import ROUNDING
from varint.results.records import changed
from varint.results.trajectory import Trajectory
from varint.scene.inputs import number, positive_integer

FEW = 50  # times that are compared one by one in less time than all at once


def until_last(times: np.ndarray, start: Any, save_every: Any, grid: Grid, rescaled: bool) -> Grid:
    """h, steps and duration of a run from the time `start` that lasts until the last of the times,
    where nothing else says how long; with a time scale, h does not say how many steps that is.

    Raises
    ------
    InputError
        If the times do not go on from the start in one direction, or nodes are left out besides.
    """
    t0 = number("t0", start)
    if positive_integer("save_every", save_every) != 1:
        raise InputError("at gives the nodes that are kept: leave save_every or at out")
    last = float(times[-1] - t0)
    direction = 1.0 if last > 0 else -1.0
    if not (last and (times[0] - t0) * direction >= 0 and _go_on(times, direction)):
        raise InputError(
            f"at must be times that go on from t0 = {t0:g}, later and later (or earlier and "
            f"earlier) ones, got {times}"
        )
    h, steps, duration = grid
    if duration is not None or steps is not None:
        whole = _whole(grid, rescaled)
        if whole is not None and not abs(last) <= abs(whole) * (1 + WHOLE):
            raise InputError(
                f"the times at={times} do not lie within the run, which takes {whole:g}"
            )
        return grid
    if h is None or rescaled:
        return h, steps, last
    h = number("h", h)
    if not h * last > 0:
        raise InputError(f"h={h:g} does not lead from t0 = {t0:g} to the times {times}")
    return grid[0], max(math.ceil(last / h * (1 - WHOLE)), 1), duration


def _go_on(times: np.ndarray, direction: float) -> bool:
    """Whether times go on in this direction."""
    order = le if direction > 0 else ge
    if len(times) <= FEW and isfinite(times[-1]):
        numbers = times.tolist()
        return all(map(order, numbers, numbers[1:]))
    return bool(order(times[:-1], times[1:]).all())


def _whole(grid: Grid, rescaled: bool) -> float | None:
    """How long the run takes, where that is known beforehand."""
    h, steps, duration = grid
    if duration is not None:
        return number("duration", duration)
    if h is None or rescaled:
        return None
    return number("h", h) * number("steps", steps)


def only_at(motion: Trajectory, times: np.ndarray) -> Trajectory:
    """The run with these nodes: those times, later and later, that it reached, its events and what
    is known of it.
    """
    if motion.__dict__.get("t") is times:  # they were looked at with the run
        return motion
    direction = 1.0 if motion.h > 0 else -1.0
    first, end = motion.t.item(0), motion.t.item(-1)
    slack = ROUNDING * max(abs(first), abs(end))
    reached = times
    if not direction * (times[-1] - end) <= slack:
        reached = times[direction * (times - end) <= slack]
    if not len(reached):
        raise InputError(f"the run ended at t = {end:g}, before the first of the times {times}")
    found: Trajectory | None = _at_once().only_at_by_core(motion, reached)
    if found is not None:
        return found
    inner = motion.fictitious
    at_times = motion.at(reached)
    if inner is not None:
        at_times = changed(at_times, fictitious=changed(at_times.fictitious, events=inner.events))
    return changed(at_times, events=motion.events, stats=motion.stats)


@cache
def _at_once() -> ModuleType:
    """Loaded with the first times that are asked for."""
    from varint.integration import times_at_once

    return times_at_once

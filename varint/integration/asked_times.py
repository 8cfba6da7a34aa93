"""Runs whose nodes are the times that were asked for: how long they must last, and what is kept."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from varint.errors import InputError
from varint.integration.problem import WHOLE, RunOptions, Start
from varint.results.dense_output import ROUNDING
from varint.results.trajectory import Trajectory
from varint.scene.inputs import number, times_of


def until_last(start: Start, options: RunOptions, rescaled: bool) -> RunOptions:
    """The options of a run that lasts until the last of the times, where nothing else says how
    long; with a time scale, h does not say how many steps that is.

    Raises
    ------
    InputError
        If the times do not go on from t0 in one direction, or nodes are left out besides.
    """
    times, t0 = times_of(options.at), number("t0", start.t0)
    if options.save_every != 1:
        raise InputError("at gives the nodes that are kept: leave save_every or at out")
    direction = np.sign(times[-1] - t0) if len(times) else 0.0
    if not direction or not (np.diff(np.append(t0, times)) * direction >= 0).all():
        raise InputError(
            f"at must be times that go on from t0 = {t0:g}, later and later (or earlier and "
            f"earlier) ones, got {times}"
        )
    last = float(times[-1] - t0)
    if options.duration is not None or options.steps is not None:
        whole = _whole(options, rescaled)
        if whole is not None and not abs(last) <= abs(whole) * (1 + WHOLE):
            raise InputError(
                f"the times at={times} do not lie within the run, which takes {whole:g}"
            )
        return options
    if options.h is None or rescaled:
        return options._replace(duration=last)
    h = number("h", options.h)
    if not h * last > 0:
        raise InputError(f"h={h:g} does not lead from t0 = {t0:g} to the times {times}")
    return options._replace(steps=max(math.ceil(last / h * (1 - WHOLE)), 1))


def _whole(options: RunOptions, rescaled: bool) -> float | None:
    """How long the run takes, where that is known beforehand."""
    if options.duration is not None:
        return number("duration", options.duration)
    if options.h is None or rescaled:
        return None
    return number("h", options.h) * number("steps", options.steps)


def only_at(motion: Trajectory, times: np.ndarray) -> Trajectory:
    """The run with these nodes: those times that it reached, its events and what is known of it."""
    direction = 1.0 if motion.h > 0 else -1.0
    slack = ROUNDING * np.abs(motion.t).max()
    reached = times[direction * (times - motion.t[-1]) <= slack]
    if not len(reached):
        raise InputError(
            f"the run ended at t = {motion.t[-1]:g}, before the first of the times {times}"
        )
    found = motion.at(reached)
    return replace(found, events=motion.events, stats=motion.stats)

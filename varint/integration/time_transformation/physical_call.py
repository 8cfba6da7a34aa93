"""Runs in fictitious time until a physical one as most are asked for: a start, a step, a duration,
by one call of the core.

What follows from the scene alone is looked up once. `transformed_run` does the same where more is
asked for, or something is not as it should be, and says what.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from time import perf_counter
from typing import Any, NamedTuple

import numpy as np

from varint.codegen.kernel import new_address
from varint.integration.plain_start import (
    Room,
    asks_for_nodes,
    begin_in,
    is_plain,
    is_plain_number,
    room_of,
)
from varint.integration.problem import LEVEL, RunOptions, Start
from varint.integration.time_transformation.fictitious_start import slowest_rate
from varint.integration.time_transformation.inner_run import (
    BACKENDS,
    Asked,
    called_on,
    inner_motion,
    until_end,
)
from varint.integration.time_transformation.local_rate import local_rate
from varint.integration.time_transformation.physical_time import in_physical_time
from varint.integration.time_transformation.rate_pilot import rate_pilot
from varint.integration.time_transformation.time_scale import TransformedScene, transformed_scene
from varint.numerics.arrays import hand_over
from varint.numerics.limits import check_steps
from varint.results.trajectory import Trajectory
from varint.rules.rule import Rule
from varint.scene.system import System


def physical_call(
    system: System, rule: Rule | None, sigma: Any, start: Start, options: RunOptions
) -> tuple[Trajectory, bool] | None:
    """The motion, and whether its energy stays; None where it is no such run, or comes to no good
    end, and another way is to be taken.
    """
    began, h, total, every = perf_counter(), options.h, options.duration, options.save_every
    waits = options.progress is None or options.progress is False
    if not (waits and options.steps is None and is_plain_number(h) and is_plain_number(total)):
        return None
    if not (isinstance(options.backend, str) and options.backend in BACKENDS and h * total > 0):  # type: ignore[operator]
        return None
    own = isinstance(sigma, str)
    scene = transformed_scene(system, sigma)
    if not (asks_for_nodes(rule, start, options) and every > 0 and is_plain(system)):
        return None
    if own and local_rate(system).reason:
        return None
    h, total = float(h), float(total)  # type: ignore[arg-type]
    called = called_on(scene.system, scene, rule)
    begun = called.starts.pop() if called.starts else _start_of(system, scene)
    try:
        room = begun.room
        c = begin_in(room, system, start)
        if c is None:
            return None
        slowest = 0.0
        if own:
            slowest = slowest_rate(rate_pilot(system, room.q, room.v, c, total, h < 0), total)
        pace = _begin(begun, slowest)
        if not 0 < pace < math.inf:
            return None
        check_steps(start.t0, h * pace, 1)
        level = 0.0 if options.iteration_tol is None else LEVEL * options.iteration_tol
        constants = begun.inner.copy()
        asked = Asked(begun.at, begun.inner_at, h, level, float(constants[-2]))
        found = until_end(called, scene, asked, total, total / (h * pace), options.backend)
    finally:
        called.starts.append(begun)
    if found is None:
        return None
    inner = inner_motion(called, scene, h, constants, found, every, perf_counter() - began)
    return in_physical_time(system, start.t0, inner), found.until.quiet


class _Start(NamedTuple):
    """Memory for a start in fictitious time.

    Attributes
    ----------
    room : Room
        Of the original scene.
    x, inner : array
        q and p of the rescaled scene, and all its parameters.
    scale : array (1,)
        σ, by `begin`, as is the energy in `inner`.
    at, inner_at : int
        Addresses of `x` and `inner`.
    """

    room: Room
    x: np.ndarray
    inner: np.ndarray
    scale: np.ndarray
    at: int
    inner_at: int
    begin: Callable[[], object]
    held: tuple


def _start_of(system: System, scene: TransformedScene) -> _Start:
    n, many = system.structure.n, system.c.numel()
    room, x, inner, scale = (
        room_of(system, False),
        np.zeros(2 * n + 2),
        np.zeros(many + 3),
        np.zeros(1),
    )
    buffer, trigger = scene.energy.buffer()
    inputs = room.q, room.v, room.t, inner[:many], inner[many : many + 1]
    outputs = inner[many + 1 : many + 2], scale
    hand_over(buffer, inputs, outputs)
    at, inner_at = new_address(x), new_address(inner)
    return _Start(room, x, inner, scale, at, inner_at, trigger, (buffer, inputs, outputs))


def _begin(start: _Start, slowest: float) -> float:
    """σ at the start that lies in the room; the start in fictitious time is then in `x`."""
    room, x, inner = start.room, start.x, start.inner
    n = len(room.q)
    inner[:-3], inner[-3] = room.c, slowest
    start.begin()
    inner[-1] = x[-1] = scale = start.scale[0]
    x[:n], x[n + 1 : -1] = room.q, room.values[:n]
    return float(scale)

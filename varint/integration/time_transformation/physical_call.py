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

import casadi as ca
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
    Called,
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
from varint.scene.memory import per_system
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
    if not (asks_for_nodes(rule, start, options) and every > 0):
        return None
    ready = _ready(system, rule, sigma if own else transformed_scene(system, sigma))
    if ready is None:
        return None
    moving, called = ready
    h, total = float(h), float(total)  # type: ignore[arg-type]
    begun = called.starts.pop() if called.starts else _start_of(system, sigma)
    try:
        room = begun.room
        c = begin_in(room, system, start)
        if c is None:
            return None
        if own:
            pilot = rate_pilot(system, room.q, room.v, c, total, h < 0)
            begun.slowest[0] = slowest_rate(pilot, total)
        begun.begin()
        constants = begun.inner.copy()
        _, energy, pace = constants[-3:].tolist()
        if not 0 < pace < math.inf:
            return None
        check_steps(start.t0, h * pace, 1)
        found = until_end(
            called,
            moving,
            begun.at,
            h,
            0.0 if options.iteration_tol is None else LEVEL * options.iteration_tol,
            (start.t0, total),
            total / (h * pace),
            energy,
            every,
            options.backend,
        )
    finally:
        called.starts.append(begun)
    if found is None:
        return None
    until, kernel = found
    inner = inner_motion(called, moving, h, constants, until, kernel, perf_counter() - began)
    return in_physical_time(system, start.t0, inner, until.t), until.quiet


@per_system
def _ready(
    system: System, rule: Rule | None, scale: str | TransformedScene
) -> tuple[System, Called] | None:
    """The rescaled scene and what is called of it; None where the scene needs another way."""
    scene = transformed_scene(system, scale) if isinstance(scale, str) else scale
    if not is_plain(system) or (isinstance(scale, str) and local_rate(system).reason):
        return None
    return scene.system, called_on(scene.system, scene, rule)


class _Start(NamedTuple):
    """Memory for a start in fictitious time.

    Attributes
    ----------
    room : Room
        Of the original scene.
    slowest : array (1,)
        The slowest rate that the time scale may have.
    inner : array
        All parameters of the rescaled scene, by `begin`: those of the original one in its room, the
        slowest rate, E0 and σ0.
    at : int, int
        Addresses of q and p of the rescaled scene, by `begin`, too, and of `inner`.
    """

    room: Room
    slowest: np.ndarray
    inner: np.ndarray
    at: tuple[int, int]
    begin: Callable[[], object]
    held: tuple


def _start_of(system: System, sigma: Any) -> _Start:
    n, many = system.structure.n, system.c.numel()
    room, slowest = room_of(system, False), np.zeros(1)
    x, inner = np.zeros(2 * n + 2), np.zeros(many + 3)
    buffer, trigger = _start_function(system, transformed_scene(system, sigma)).buffer()
    inputs = room.q, room.v, room.values[:n], room.t, room.c, slowest
    hand_over(buffer, inputs, (x, inner))
    at = new_address(x), new_address(inner)
    return _Start(room, slowest, inner, at, trigger, (buffer, inputs, x))


@per_system
def _start_function(system: System, scene: TransformedScene) -> ca.Function:
    """(q, v, p, t, c, slowest rate) → (q, 0, p, σ) and (c, slowest rate, E0, σ)."""
    s, p, slowest = system, ca.SX.sym("p", system.structure.n), ca.SX.sym("slowest rate")
    energy, scale = scene.energy(s.q, s.v, s.t, s.c, slowest)
    x, inner = ca.vertcat(s.q, 0, p, scale), ca.vertcat(s.c, slowest, energy, scale)
    inputs = [s.q, s.v, p, s.t, s.c, slowest]
    return ca.Function("fictitious_start", inputs, [ca.densify(x), ca.densify(inner)])

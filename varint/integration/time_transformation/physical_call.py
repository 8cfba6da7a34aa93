"""Runs in fictitious time until a physical one as most are asked for: a start, a step, a duration,
by one call of the core.

What follows from the scene alone is looked up once. `transformed_run` does the same where more is
asked for, or something is not as it should be, and says what.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from time import perf_counter
from typing import Any

import casadi as ca
import numpy as np

from varint.codegen.kernel import address_of, new_address
from varint.codegen.nearness import Places, places_at
from varint.codegen.until import physical_states, physical_times
from varint.discrete.legendre import velocity_function
from varint.integration.energy_leap import energy_alarm
from varint.integration.plain_start import LARGE, Room, begin_at, is_plain, is_plain_number, room_of
from varint.integration.problem import LEVEL
from varint.integration.round_off import with_other_digits
from varint.integration.time_transformation.fictitious_start import slowest_rate
from varint.integration.time_transformation.inner_run import (
    BACKENDS,
    Called,
    How,
    asked_until_end,
    called_on,
    inner_motion,
    until_end,
)
from varint.integration.time_transformation.physical_time import at_times
from varint.integration.time_transformation.rate_pilot import rate_pilot
from varint.integration.time_transformation.time_scale import (
    FLIGHT,
    own_scale,
    rate_of,
    transformed_scene,
)
from varint.integration.time_transformation.transformed_scene import TransformedScene
from varint.integration.trajectories import stats_of
from varint.numerics.arrays import call, hand_over
from varint.numerics.limits import check_steps
from varint.results.trajectory import Trajectory
from varint.rules.rule import Rule
from varint.scene.memory import per_system
from varint.scene.parameters import ParameterValues
from varint.scene.system import System

_new, _set = object.__new__, object.__setattr__
_LAST = "_last_ready"  # of a system: rule and time scale that it was last asked with, and `Ready`
_NONE = None, None, None  # no time scale
# step, duration, start time, accuracy of iterations, every so many nodes, backend
Run = tuple[float, float, float, float | None, int, str]


def physical_call(
    system: System,
    rule: Rule | None,
    sigma: Any,
    q0: Any,
    v0: Any,
    params: ParameterValues | None,
    run: Run,
    began: float,
) -> Trajectory | None:
    """The motion from a start; None where it is no such run, or comes to no good end, and another
    way is to be taken. A warning where the energy does not stay.
    """
    h, total, t0, level, _, _ = run
    if (
        type(h) is not float
        or type(total) is not float
        or type(t0) is not float
        or (type(level) is not float and level is not None)
    ):
        h, total, t0, level = map(_own, run[:4])
        run = h, total, t0, level, *run[4:]
        if type(h) is not float or type(total) is not float or type(t0) is not float:
            return None
        if type(level) is not float and level is not None:
            return None
    last_rule, last_sigma, ready = system.__dict__.get(_LAST, _NONE)
    if last_rule is not rule or last_sigma is not sigma:  # in less time than by a hash
        if not (rule is None or type(rule) is Rule):
            return None
        own = isinstance(sigma, str)
        scale = own_scale(system, sigma) if own else transformed_scene(system, sigma)
        ready = ready_for(system, rule, scale)
        if own:  # expressions may change
            system.__dict__[_LAST] = rule, sigma, ready
    if ready is None:
        return None
    starts = ready.starts
    begun = starts.pop() if starts else start_of(system, ready.scene)
    try:
        room, same = begun.room, run == begun.run  # good then, good now
        if not (same or _is_plain_run(run)):
            return None
        c = begin_at(room, system, q0, v0, t0, params)
        if c is None:
            return None
        if begun.known is not room.known or not same:
            if begun.known is not room.known or begun.total != total:
                word = own_scale(system, sigma) if isinstance(sigma, str) else None
                begin_start(begun, system, c, total, word)
            if not _ask(begun, run):
                return None
        constants = begun.constants
        until = until_end(ready.called, ready.moving, begun.asked, run[5])
    finally:
        starts.append(begun)
    if until is None:
        return None
    how = h, constants, until, perf_counter() - began
    motion = physical_motion(system, ready.called, ready.moving, c, how)
    if not until.quiet:
        assert motion.fictitious is not None
        if alarm := energy_alarm(motion.fictitious):
            warnings.warn(alarm, stacklevel=3)
    return motion


def _own(x: Any) -> Any:
    """A number as Python's own of double precision, if it is one."""
    return float(x) if type(x) is np.float64 or is_plain_number(x) else x


def _is_plain_run(run: Run) -> bool:
    h, total, t0, level, every, backend = run
    if not (0.0 < h * total < math.inf and -LARGE < t0 < LARGE):
        return False
    return (level is None or 0.0 < level < 1.0) and every > 0 and backend in BACKENDS


def _ask(begun: BegunStart, run: Run) -> bool:
    """Write what the core is asked for a run from a start that has begun; False where its time
    scale is none there.
    """
    (h, total, t0, iteration_tol, every, _), pace = run, begun.pace
    begun.run = None
    if not 0 < pace < math.inf:
        return False
    check_steps(t0, h * pace, 1)
    level = 0.0 if iteration_tol is None else LEVEL * iteration_tol
    span, expected = (t0, total), total / (h * pace)
    begun.asked = asked_until_end(begun.at, h, level, span, expected, begun.energy, every)
    begun.run = run
    return True


def physical_motion(
    system: System,
    called: Called,
    moving: System,
    c: np.ndarray,
    how: How,
    more: dict[str, Any] | None = None,
) -> Trajectory:
    """The motion with these parameters, found so in the rescaled scene, and what is told of it
    besides how long that took; the one there, and what this one has besides coordinates and
    momenta, are made when they are asked for.
    """
    q, p = physical_states(how[2], system.structure.n)
    known = {
        "system": system,
        "rule": called.plan.rule,
        "q": q,
        "p": p,
        "h": how[0],
        "c": c,
        "functions": called.functions,
        "dense_output": at_times,
        "origin": 0.0,
        "_make": partial(_made, called, moving, how, more or {}),
    }
    motion = _new(Trajectory)  # in half the time of its constructor
    _set(motion, "__dict__", known)
    return motion


def _made(called: Called, moving: System, how: How, more: dict[str, Any], name: str) -> Any:
    """The field of this name of a motion: one that is not coordinates and momenta."""
    _, _, until, seconds = how
    if name == "fictitious":
        return inner_motion(called, moving, how)
    if name == "u":
        return np.empty((until.steps, 1, 0))
    if name == "events":
        return ()
    if name == "stats":
        work = until.iterations, until.residual
        return stats_of(called.plan, until.kernel, until.steps, work, {"seconds": seconds, **more})
    return physical_times(until)["kt".index(name)]


@dataclass(eq=False)
class Ready:
    """Of a scene, a rule and a time scale: the rescaled scene, what is called of it, and memory for
    starts that nobody uses.
    """

    scene: TransformedScene
    moving: System
    called: Called
    starts: list[BegunStart]


@per_system
def ready_for(system: System, rule: Rule | None, scale: str | TransformedScene) -> Ready | None:
    """None where the scene needs another way."""
    scene = transformed_scene(system, scale) if isinstance(scale, str) else scale
    if not is_plain(system) or (isinstance(scale, str) and rate_of(system, scale).reason):
        return None
    called = called_on(scene.system, scene, rule)
    return Ready(scene, scene.system, called, [])


@dataclass(eq=False, slots=True)
class BegunStart:
    """Memory for a start in fictitious time.

    Attributes
    ----------
    room : Room
        Of the original scene.
    slowest : array (1,)
        The slowest rate that the time scale may have.
    inner : array
        All parameters of the rescaled scene, by `begin`: those of the original one in its room, the
        weight of time, the slowest rate, E0 and σ0.
    at : int, int
        Addresses of q and p of the rescaled scene, by `begin`, too, and of `inner`.
    places : Places
        Its parameters and masses, for runs to be compared.
    constants : array
        `inner` of the start that is there, not to be changed.
    known, total : tuple, float
        The start that is there, as its room has it, or empty, and the duration.
    run, asked : tuple, bytes, optional
        The run that was asked for last from there, and what the core is asked then.
    energy, pace : float
        E0 and σ0.
    """

    room: Room
    slowest: np.ndarray
    inner: np.ndarray
    at: tuple[int, int]
    begin: Callable[[], object]
    held: tuple
    places: Places
    constants: np.ndarray
    known: tuple[bytes, float] | tuple[()] = ()
    total: float = 0.0
    run: Run | None = None
    asked: bytes = b""
    energy: float = 0.0
    pace: float = 0.0


def begin_start(
    begun: BegunStart, system: System, c: np.ndarray, total: float, word: str | None
) -> None:
    """From the start in its room, with one of the scene's own time scales or another one."""
    room, begun.known, begun.run = begun.room, (), None
    if word:
        pilot = rate_pilot(
            system, room.q, room.v, float(room.t[0]), c, total, total < 0, word == FLIGHT
        )
        begun.slowest[0] = slowest_rate(pilot, total)
    begun.begin()
    begun.constants = begun.inner.copy()
    _, begun.energy, begun.pace = begun.constants[-3:].tolist()
    begun.known, begun.total = room.known or (), total


def with_other_digits_of(other: BegunStart, system: System, begun: BegunStart, way: int) -> None:
    """Another start's `with_other_digits`, at an energy and a time scale of its own."""
    here, there = begun.room, other.room
    n = here.n
    q, p = with_other_digits(here.q, here.values[:n], way)
    v = call(velocity_function(system), q, p, here.t, here.c)[0]
    there.known, there.given, other.known, other.run = None, None, (), None
    parts = there.q, there.v, there.t, there.c, there.values[:n], other.slowest
    for place, x in zip(parts, (q, v, here.t, here.c, p, begun.slowest), strict=True):
        place[:] = x
    other.begin()
    other.constants = other.inner.copy()
    _, other.energy, other.pace = other.constants[-3:].tolist()


def start_of(system: System, scene: TransformedScene) -> BegunStart:
    n, moving = system.structure.n, scene.system
    room, slowest = room_of(system, False), np.zeros(1)
    x, inner = np.zeros(2 * moving.structure.n), np.zeros(moving.c.numel())
    buffer, trigger = _start_function(system, scene).buffer()
    inputs = room.q, room.v, room.values[:n], room.t, room.c, slowest
    hand_over(buffer, inputs, (x, inner))
    at = new_address(x), new_address(inner)
    mass = address_of(room.values) + 8 * (2 * n + 1)
    places = places_at(room.c.ctypes.data, mass, n + 1)  # of no parameters, too
    return BegunStart(room, slowest, inner, at, trigger, (buffer, inputs, x), places, inner)


@per_system
def _start_function(system: System, scene: TransformedScene) -> ca.Function:
    """(q, v, p, t, c, slowest rate) → (q, 0, p, w σ) and (c, w, slowest rate, E0, σ); where the
    energy is kept account of, (q, 0, 0, p, σ, −E0) and (c, t, slowest rate, E0, σ).
    """
    s, p, slowest = system, ca.SX.sym("p", system.structure.n), ca.SX.sym("slowest rate")
    energy, scale = scene.energy(s.q, s.v, s.t, s.c, slowest)
    if scene.accounts:
        beside, begin = [scale, -energy], s.t
    else:
        begin = scene.weight(s.q, s.v, s.t, s.c, slowest)
        beside = [begin * scale]
    x = ca.vertcat(s.q, ca.SX.zeros(len(beside)), p, *beside)
    inner = ca.vertcat(s.c, begin, slowest, energy, scale)
    inputs = [s.q, s.v, p, s.t, s.c, slowest]
    return ca.Function("fictitious_start", inputs, [ca.densify(x), ca.densify(inner)])

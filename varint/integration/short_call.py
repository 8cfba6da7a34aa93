"""Runs for a wanted accuracy as most are asked for: a start, a duration, an accuracy, no more.

What follows from the scene alone is looked up once, and numbers go from the user to the core and
back by one block of memory. `to_tolerance` does the same where more is asked for, or something is
not as it should be, and says what.
"""

from __future__ import annotations

from functools import cache
from time import perf_counter
from types import ModuleType
from typing import Any

import numpy as np

from varint.codegen.beside import NO_OPENING, Beside
from varint.codegen.kernel import Kernel
from varint.codegen.two_runs import (
    NO_RATES,
    NOT_PROVED,
    UNASKED,
    VARIES,
    Rates,
    runs_made,
)
from varint.integration.cuts import clear_of_cuts
from varint.integration.damped_motions import are_stiff, damped_turns, has_slopes_without
from varint.integration.even_motion import Made, between_nodes, made_of, proved_motion
from varint.integration.gears import kernel_after, kernel_now
from varint.integration.linear_run import MAPPED, is_one_map
from varint.integration.many_times import NO_GEARS, within_now
from varint.integration.plain_start import (
    LARGE,
    Room,
    Watched,
    begin_at,
    begin_by_momentum,
    is_plain_number,
    opening_in,
    room_of,
    velocities_in,
)
from varint.integration.repeated import remember
from varint.integration.settled_run import settles_within
from varint.integration.short_doubts import looked_at
from varint.integration.short_scenes import Known, chosen_in, fastest_of, known_of, looked_between
from varint.integration.short_trials import course_by
from varint.integration.small_motions import angles_turned
from varint.integration.time_transformation.rate_ahead import (
    NOTHING,
    ask_for_rates,
    seen_ahead,
    seen_along,
)
from varint.integration.time_transformation.rate_pilot import RatePilot
from varint.integration.time_transformation.varying_call import varying_call
from varint.integration.tolerance import DEFAULT_TOL, LEAST_TOL, MOST_TOL
from varint.integration.trajectories import with_stats
from varint.numerics.limits import check_steps
from varint.results.trajectory import Trajectory
from varint.rules.rule import Rule
from varint.scene.parameters import ParameterValues
from varint.scene.system import System


def short_call(
    system: System,
    rule: Rule | None,
    start: tuple[Any, Any, Any, ParameterValues | None],
    p0: Any,
    duration: Any,
    tol: float | None,
    began: float,
    events: Any = None,
    times: np.ndarray | None = None,
) -> Trajectory | int | None:
    """The motion from a start (q0, v0, t0, params), or from momenta in place of v0, with events on
    the way, if two short runs prove its error, or some more of a scene with forces; what
    `by_short_trials` says if not; None where another way is to be taken. Its nodes are the times
    already where that is done in the same call.
    """
    q0, v0, t0, params = start
    tol = DEFAULT_TOL if tol is None else tol
    if not is_plainly_asked(rule, t0, duration, tol):
        return None
    known = known_of(system, rule)
    if known is None or not (p0 is None or known.by_momentum):
        if not system.structure.contacts or events or p0 is not None:
            return None
        from varint.integration.exact_flights import exact_call  # where there are contacts

        return exact_call(system, rule, start, duration, tol, began)
    pool = known.rooms
    room = pool.pop() if pool else room_of(system, True)
    try:
        begin = room.start
        if p0 is None:
            c = begin_at(room, system, q0, v0, t0, params)
        else:
            c = begin_by_momentum(room, system, q0, p0, t0, params)
            if c is not None and known.varies:
                begin = np.concatenate((room.q, velocities_in(room, system, c)))
        if c is None:
            return None
        if type(t0) is not float or type(duration) is not float:
            t0, duration = float(t0), float(duration)
        seen = room.seen
        if seen is None or seen[2] != duration or seen[3] != t0:
            check_steps(t0, duration, 1)
        pilot, turned, plain = seen_in(room, system, known, begin, t0, c, duration, known.damped)
        if turned is not plain and (events or has_slopes_without(system, turned[1])):
            return None
        runs, watched = 0, Watched(None, events, p0 is not None) if events else None
        if pilot is None:
            rates = known.rates
            found = by_the_core(
                system, known, room, c, t0, duration, tol, turned, began, rates, watched, times
            )  # not by a tuple, whose time counts
            if type(found) is not Trajectory and turned is not plain:
                turned = plain  # steps did not grow to what lasts
                how = system, known, room, c, t0, duration, tol, turned, began
                found = by_the_core(*how, rates, watched, times)
            if type(found) is not int or found < VARIES:
                return found
            if watched is not None:
                return None
            runs += runs_made(room.places)
            pilot = seen_along(system, begin, t0, c, duration, found - VARIES)
            if pilot is None:
                how = system, known, room, c, t0, duration, tol, turned, began
                again = by_the_core(*how, [NO_RATES], None)
                if type(again) is not Trajectory:
                    return again
                return with_stats(again, runs=runs + again.stats["runs"])
    finally:
        pool.append(room)
    if p0 is not None or events:
        return None
    found = varying_call(system, rule, start, duration, tol, pilot, began, runs)
    return clear_of_cuts(found) if known.cuts else found


def is_plainly_asked(rule: Any, t0: Any, duration: Any, tol: float) -> bool:
    """Whether rule, times and tolerance need no closer look."""
    if not (rule is None or type(rule) is Rule) or not LEAST_TOL <= tol <= MOST_TOL:
        return False
    if type(duration) is float and type(t0) is float:  # without calls, whose time counts
        return 0 < abs(duration) < LARGE and abs(t0) < LARGE
    return bool(is_plain_number(duration) and duration and is_plain_number(t0))


def seen_in(
    room: Room,
    system: System,
    known: Known,
    begin: np.ndarray,
    t0: float,
    c: np.ndarray,
    duration: float,
    grows: bool = False,
) -> tuple[RatePilot | None, tuple[float, float], tuple[float, float]]:
    """A pilot if steps should vary, and else how far the fastest motions turn: those that last, or
    at the start, and what the first steps are for; and the same without dampers, the same object
    where none are stiff or steps do not grow. What was seen from the start that is there is
    remembered.
    """
    seen, there = room.seen, room.known
    as_before = seen is not None and seen[0] is there and seen[1] is known and seen[6] is grows
    if seen is None or not as_before or seen[2] != duration:
        assert room.look is not None
        room.look()
        ahead = seen_ahead(system, begin, t0, c, duration) if known.varies else NOTHING
        fastest = fastest_of(known.n, known.last, room.local)
        turned = plain = angles_turned(duration, fastest, ahead.frequency)
        if grows and are_stiff(room.local, known.n, duration, turned[0]):
            state = room.q.copy(), room.values[: room.n].copy(), t0, c
            turned = damped_turns(system, *state, duration) or turned
        seen = there, known, duration, t0, ahead.pilot, turned, grows, plain
        room.seen = None if there is None else seen
    return seen[4], seen[5], seen[7]


def by_the_core(
    system: System,
    known: Known,
    room: Room,
    c: np.ndarray,
    t0: float,
    duration: float,
    tol: float,
    turned: tuple[float, float],
    began: float,
    rates: list[Rates],
    watched: Watched | None,
    times: np.ndarray | None = None,
) -> Trajectory | int | None:
    """`short_call` from the start that is there, with what is watched for, over a duration in which
    the motion turns by so much; VARIES and more where steps should follow one of the rates.
    """
    chosen = before = room.chosen
    if chosen is None or chosen[0] is not turned or chosen[1] != tol:
        chosen = room.chosen = turned, tol, *chosen_in(system, known, turned[1], tol)
    _, _, loop, first = chosen
    gears, alone, rule = loop.gears, loop.alone, loop.plan.rule
    over = room.over
    if over is None or over[0] is not c or over[1] != duration:
        over = room.over = c, duration, settles_within(system, c, duration)
    if over[2] and watched is None and rule == MAPPED:
        return None
    if first is None or not (gears or alone):
        return None
    if alone and watched is not None:  # it makes no shorter steps
        return None
    times = None if alone or known.cuts else times
    kernel = kernel_now(gears) if gears else alone[0]
    if kernel is not loop.last[0]:
        course = course_by(system, rule, kernel, True)
        loop.last = kernel, None if course is None else made_of(course, loop.plan)
    made = loop.last[1]
    if made is None:
        return None
    radians, low = turned[0], gears if gears and made.course.kernel is gears.low else None
    beside = None
    if known.held or watched is not None:
        beside = _beside(system, known, made, kernel, room, c, watched)
        if beside is None:
            return None
    asked: tuple[Any, ...] = ()
    steps, looking = NO_GEARS if times is None else within_now(system, rule, len(times))
    if times is not None and (between := looked_between(loop, kernel, steps)):
        asked = times, between
    now, prove = perf_counter() if low or looking else 0.0, proved_motion()
    how = t0, duration, first, radians, tol
    found = prove(made, room.places, system, c, *how, rates[0], began, beside, *asked)
    if type(found) is int and found >= VARIES and rates[0] is UNASKED:
        rates[0] = ask_for_rates(system)
        found = prove(made, room.places, system, c, *how, rates[0], began, beside, *asked)
    for used in filter(None, (low, looking)):
        kernel_after(used, perf_counter() - now, 0.0)
    if known.held and room.opening is not None and room.opening.raised:
        raise room.opening.raised.pop()
    if type(found) is Trajectory:
        if times is not None:
            return between_nodes(found, kernel, times, steps)
        if known.cuts:
            return clear_of_cuts(found)
        if chosen is before and not low and (watched is None or watched.whole):
            there = room, known.rooms, gears.high if gears else alone, made, rates, c, how
            remember(system, known.rule, *there, beside, watched)
        return found
    if isinstance(found, tuple):
        motion, estimate = found
        found = clear_of_cuts(looked_at(motion, estimate, tol, known.held))
        found = found if times is None else between_nodes(found, kernel, times, steps)
    elsewhere = known.held or (found == NOT_PROVED and is_one_map(system, rule))
    # where one map does not do, steps of another rule may
    return None if type(found) is int and elsewhere else found


def _beside(
    system: System,
    known: Known,
    made: Made,
    kernel: Kernel,
    room: Room,
    c: np.ndarray,
    watched: Watched | None,
) -> Beside | None:
    """What is asked beside the runs from the start that is there; None where it is to be looked for
    elsewhere.
    """
    opening = opening_in(room, system).by_core if known.held else NO_OPENING
    if watched is None:
        return Beside(opening)
    mapped = made.course.kernel is not kernel
    found: Beside | None = _watched_runs().watched_in(
        system, kernel, mapped, room, c, watched, opening
    )
    return found


@cache
def _watched_runs() -> ModuleType:
    """Loaded when something is watched for."""
    from varint.integration import watched_runs

    return watched_runs

"""Runs for a wanted accuracy as most are asked for: a start, a duration, an accuracy, no more.

What follows from the scene alone is looked up once, and numbers go from the user to the core and
back by one block of memory. `to_tolerance` does the same where more is asked for, or something is
not as it should be, and says what.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from time import perf_counter
from typing import Any

import numpy as np

from varint.codegen.kernel import Kernel
from varint.codegen.two_runs import NOT_PROVED, VARIES, Course, Rates, runs_made
from varint.integration.backend import runs_by_stages
from varint.integration.compiled_loop import scheme_of
from varint.integration.energy_leap import energy_leap
from varint.integration.even_motion import even_motion_of
from varint.integration.gears import Gears, gears_of, kernel_now
from varint.integration.held_rows import is_held
from varint.integration.linear_run import MAPPED, driven_kernel, is_one_map, runs_driven
from varint.integration.plain_start import (
    Room,
    begin_in,
    has_plain_nodes,
    is_plain,
    is_plain_number,
    opening_in,
    room_of,
    rooms,
    velocities_in,
)
from varint.integration.plan import Plan, plan
from varint.integration.rule_choice import (
    Priced,
    candidates,
    changes,
    cheapest,
    priced,
)
from varint.integration.second_looks import has_switches
from varint.integration.short_refinement import looked_at_closely
from varint.integration.short_trials import (
    Begins,
    balance_known,
    course_by,
    energy_known,
    steps_to_begin,
    two_short_runs,
)
from varint.integration.small_motions import MOST_COORDINATES, angles_turned, frequency_of_columns
from varint.integration.time_transformation.rate_ahead import (
    NOTHING,
    rates_to_follow,
    seen_ahead,
    seen_along,
)
from varint.integration.time_transformation.rate_pilot import RatePilot
from varint.integration.time_transformation.variable_course import may_vary
from varint.integration.time_transformation.varying_call import varying_call
from varint.integration.tolerance import DEFAULT_TOL, LEAST_TOL, MOST_TOL
from varint.integration.trajectories import with_stats
from varint.integration.two_runs import shows_its_error
from varint.integration.work_bound import moves_constraints
from varint.numerics.limits import check_steps
from varint.results.trajectory import Trajectory
from varint.rules.rule import Rule, gauss
from varint.scene.memory import per_scene
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
) -> Trajectory | int | None:
    """The motion from a start (q0, v0, t0, params), or from momenta in place of v0, if two short
    runs prove its error, or some more of a scene with forces; what `by_short_trials` says if not;
    None where another way is to be taken.
    """
    t0, tol = start[2], DEFAULT_TOL if tol is None else tol
    if not is_plainly_asked(rule, t0, duration, tol):
        return None
    known = known_of(system, rule)
    if known is None or not (p0 is None or known.by_momentum):
        return None
    pool = known.rooms
    room = pool.pop() if pool else room_of(system, True)
    try:
        c = begin_in(room, system, start, p0)
        if c is None:
            return None
        t0, duration = float(t0), float(duration)
        begin = room.start
        if p0 is not None and known.varies:
            begin = np.concatenate((room.q, velocities_in(room, system, c)))
        seen = room.seen
        if seen is None or seen[0] is not room.known or seen[1] != duration:
            check_steps(t0, duration, 1)
            seen = room.known, duration, *_looked_ahead(system, known, room, begin, c, duration)
            room.seen = None if room.known is None else seen
        _, _, pilot, turned = seen
        runs = 0
        if pilot is None:
            how = system, known, room, c, t0, duration, tol, turned, began
            found = _by_the_core(*how, known.rates)
            if type(found) is not int or found < VARIES:
                return found
            runs = runs_made(room.places)
            pilot = seen_along(system, begin, c, duration, found - VARIES)
            if pilot is None:
                again = _by_the_core(*how, [None])
                if type(again) is not Trajectory:
                    return again
                return with_stats(again, runs=runs + again.stats["runs"])
    finally:
        pool.append(room)
    if p0 is not None:
        return None
    return varying_call(system, rule, start, duration, tol, pilot, began, runs)


def is_plainly_asked(rule: Any, t0: Any, duration: Any, tol: float) -> bool:
    """Whether rule, times and tolerance need no closer look."""
    if not (rule is None or type(rule) is Rule) or not LEAST_TOL <= tol <= MOST_TOL:
        return False
    return bool(is_plain_number(duration) and duration and is_plain_number(t0))


def _looked_ahead(
    system: System, known: Known, room: Room, begin: np.ndarray, c: np.ndarray, duration: float
) -> tuple[RatePilot | None, tuple[float, float]]:
    """A pilot if steps should vary, and else how far the fastest motions turn: at the start, and
    where the first steps are for.
    """
    assert room.look is not None
    room.look()
    ahead = seen_ahead(system, begin, c, duration) if known.varies else NOTHING
    return ahead.pilot, angles_turned(duration, fastest_of(known, room.local), ahead.frequency)


def _by_the_core(
    system: System,
    known: Known,
    room: Room,
    c: np.ndarray,
    t0: float,
    duration: float,
    tol: float,
    turned: tuple[float, float],
    began: float,
    rates: list[Rates | None],
) -> Trajectory | int | None:
    radians, begin = turned
    which = cheapest(known.changes, begin, tol)
    price, loop = known.rules[which], known.loops[which]
    if loop is None:
        loop = known.loops[which] = loop_of(system, price.rule)
    gears, rule = loop.gears, price.rule
    if gears is None:
        return None
    kernel = kernel_now(gears)
    if kernel is not loop.last[0]:
        loop.last = kernel, course_by(system, rule, kernel)
    course = loop.last[1]
    if course is None:
        return None
    first = loop.begins(price, begin, tol)
    if first is None:
        return None
    asked, low = (t0, duration, first, radians, tol), gears if course.kernel is gears.low else None
    how = system, course, low, room.places, asked, rates
    if known.held:
        opening = opening_in(room, system)
        found = two_short_runs(*how, opening.by_core)
        if opening.raised:
            raise opening.raised.pop()
    else:
        found = two_short_runs(*how)
    if isinstance(found, int):  # where one map does not do, steps of another rule may
        elsewhere = known.held or (found == NOT_PROVED and is_one_map(system, rule))
        return None if elsewhere else found
    steps, runs, estimate, iterations, residual, nodes, doubted = found
    told = {
        "seconds": perf_counter() - began,
        "tol": tol,
        "error_estimate": estimate,
        "rule": rule.name,
        "runs": runs,
    }
    grid, work = (duration / steps, t0, steps, c), (iterations, residual)
    motion = even_motion_of(system, loop.plan, course.kernel, nodes, grid, work, told)
    if not doubted:
        return motion
    if not (known.held and shows_its_error(system)):
        seen = looked_at(rule, motion, estimate, tol)
        return None if known.held and seen == NOT_PROVED else seen
    if (leap := energy_leap(motion, tol)) and (alarm := leap.alarm()):
        warnings.warn(alarm, stacklevel=4)
    return motion


def fastest_of(known: Known, local: np.ndarray) -> float | None:
    """Of the small motions of these masses and derivatives of forces, which a linear scene has
    wherever it begins.
    """
    numbers, last = local.tobytes(), known.last[0]
    if last[0] != numbers:
        columns, half = local.tolist(), known.n * known.n
        last = numbers, frequency_of_columns(columns[:half], columns[half:], known.n)
        known.last[0] = last
    return last[1]


def looked_at(rule: Rule, motion: Trajectory, estimate: float, tol: float) -> Trajectory | int:
    """The motion with what a closer look says of its error; NOT_PROVED where that is too much."""
    estimate = max(estimate, looked_at_closely(rule, motion, None, tol))
    return NOT_PROVED if estimate > tol else with_stats(motion, error_estimate=estimate)


@dataclass(eq=False)
class Loop:
    """Of a scene and a rule: the plan, the gears if there are some, and the loop that ran last,
    with its course; how many steps are begun with.
    """

    plan: Plan
    gears: Gears | None
    begins: Begins
    last: tuple[Kernel | None, Course | None] = (None, None)


@dataclass(frozen=True, eq=False)
class Known:
    """Of a scene: coordinates, rooms that nobody uses, rules, their prices and which is the
    cheapest when, their loops as far as they were asked for, whether steps may vary and the
    rates that they may follow, whether momenta will do for all of that, whether constraint rows
    hold the motion, and the last local numbers of a start as bytes and the fastest frequency of
    these.
    """

    n: int
    rooms: list[Room]
    rules: tuple[Priced, ...]
    changes: tuple[list[float], list[int]]
    loops: list[Loop | None]
    varies: bool
    rates: list[Rates | None]
    by_momentum: bool
    held: bool
    last: list[tuple[bytes, float | None]]


@per_scene
def known_of(system: System, rule: Rule | None) -> Known | None:
    """None where another way is to be taken, whatever the start."""
    n, own, held = system.structure.n, plan(system, rule).rule, _is_plainly_held(system)
    begins = held or _begins_by_symbols(system)
    if not (begins and n <= MOST_COORDINATES) or has_switches(system):
        return None
    if (energy_known(system) if shows_its_error(system) else balance_known(system)) is None:
        return None
    driven = rule is None and driven_kernel(system, MAPPED) is not None
    if rule is None and not (driven or held or runs_by_stages(system, gauss(8), "auto")):
        return None
    rules = candidates(system, False, True) if rule is None else {own: 1.0}
    rules = {MAPPED: 1.0} if driven else rules
    prices = priced(rules)
    varies = may_vary(system, rule)
    by_momentum = system.structure.quadratic_kinetic and not held
    rates: list[Rates | None] = rates_to_follow(system) if varies else [None]
    loops: list[Loop | None] = [None] * len(prices)
    begin = rooms(system, True), prices, changes(prices)
    return Known(n, *begin, loops, varies, rates, by_momentum, held, [(b"", 0.0)])


def _is_plainly_held(system: System) -> bool:
    """Whether constraint rows alone, which stand still, hold the motion."""
    if not is_held(system) or system.structure.controls or moves_constraints(system):
        return False
    solved_once = is_one_map(system, MAPPED) or runs_driven(system)
    return system.structure.quadratic_kinetic and not solved_once


def _begins_by_symbols(system: System) -> bool:
    """Whether a start is functions of symbols: those of velocities alone where these have no
    formula.
    """
    return is_plain(system) or (has_plain_nodes(system) and not system.structure.quadratic_kinetic)


@per_scene
def loop_of(system: System, rule: Rule) -> Loop:
    gears = gears_of(system, rule, scheme_of(system, rule))
    return Loop(plan(system, rule), gears, steps_to_begin(system, rule))

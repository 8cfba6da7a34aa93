"""Runs for a wanted accuracy with steps that follow the scene, as most are asked for: a start, a
duration, an accuracy, no more.

What follows from the scene alone is looked up once. `variable_course` does the same where more is
asked for, or a step cannot be solved, and says what.
"""

from __future__ import annotations

import math
from functools import partial
from time import perf_counter
from typing import Any

import varint.codegen.nearness as nearness
from varint.codegen.cache import CompileError
from varint.codegen.nearness import Nearness, Places
from varint.codegen.two_runs import NOT_SHORT
from varint.codegen.until import physical_times
from varint.codegen.varying_runs import Course as VaryingCourse
from varint.codegen.varying_runs import varying_course, varying_runs
from varint.integration.attempts import Attempt
from varint.integration.gears import kernel_after
from varint.integration.plain_start import begin_at
from varint.integration.proof_limits import proof_limits
from varint.integration.rule_choice import (
    Priced,
    changes,
    cheapest,
    first_steps,
    iteration_level,
)
from varint.integration.time_transformation.inner_run import How, asked_until_end, until_end
from varint.integration.time_transformation.physical_call import (
    BegunStart,
    Ready,
    begin_start,
    physical_motion,
    ready_for,
    start_of,
    with_other_digits_of,
)
from varint.integration.time_transformation.physical_end import FIRST_CHUNK, PATIENCE
from varint.integration.time_transformation.rate_pilot import RatePilot
from varint.integration.time_transformation.run_nearness import run_nearness
from varint.integration.time_transformation.time_scale import AUTO, FLIGHT
from varint.integration.time_transformation.variable_course import (
    ATTEMPTS,
    CLOSER,
    FORESEEN,
    course_that_follows,
    pairs_for,
    prices_for,
    resolves_signals,
)
from varint.integration.two_runs import (
    CHANCE,
    FLOOR,
    HOPELESS,
    Course,
    Proved,
    by_round_off,
    run_twice,
)
from varint.numerics.limits import MOST_STEPS, check_steps
from varint.results.trajectory import Trajectory
from varint.rules.rule import Rule
from varint.scene.memory import per_scene
from varint.scene.parameters import ParameterValues
from varint.scene.system import System

NOT_VARYING = -1  # steps that follow the scene do not prove the error of its motion


class _NotPlain(Exception):
    """A run that one call of the core does not make."""


def varying_call(
    system: System,
    rule: Rule | None,
    start: tuple[Any, Any, Any, ParameterValues | None],
    duration: float,
    tol: float,
    pilot: RatePilot,
    began: float,
    before: int,
) -> Trajectory | int | None:
    """The motion from a start (q0, v0, t0, params) with steps that follow its rate, which the pilot
    saw, after so many other runs; NOT_VARYING where they do not prove its error, None where another
    way is to be taken.
    """
    span = pilot.mean * duration
    prices, when = _prices(system, rule)
    price = prices[cheapest(when, abs(span), tol)]
    word = FLIGHT if pilot.flight else AUTO
    ready = ready_for(system, price.rule, word)
    looks = run_nearness(system)
    if ready is None or looks is None:
        return None
    begun = ready.starts.pop() if ready.starts else start_of(system, ready.scene)
    try:
        c = begin_at(begun.room, system, *start)
        if c is None:
            return None
        known = begun.room.known
        if known is None or begun.known is not known or begun.total != duration:
            begin_start(begun, system, c, duration, word)
        h = span * begun.pace
        if not (0 < begun.pace < math.inf and duration / h <= MOST_STEPS):
            return None
        check_steps(start[2], h, 1)
        asked = looks, begun.places, (float(start[2]), duration), span
        first = first_steps(price, abs(span), tol)
        found = _at_once(system, ready, begun, price.rule, asked, first, tol)
        if found is None:
            found = run_twice(price.rule, _course(system, ready, begun, asked), first, tol, FLOOR)
    except _NotPlain:
        return None
    finally:
        ready.starts.append(begun)
    if found is None:
        return NOT_VARYING
    if found.estimate > tol:  # of which a warning tells
        return None
    told = {
        "seconds": perf_counter() - began,
        "tol": tol,
        "error_estimate": found.estimate,
        "rule": price.rule.name,
        "runs": before + found.runs,
    }
    if not system.structure.autonomous:
        _, times = physical_times(found.run[2])
        if not resolves_signals(system, c, times):
            return NOT_VARYING
    return physical_motion(system, ready.called, ready.moving, c, found.run, told)


@per_scene
def _prices(
    system: System, rule: Rule | None
) -> tuple[tuple[Priced, ...], tuple[list[float], list[int]]]:
    """Of the rules that can follow a rate, and which is the cheapest when."""
    prices = prices_for(system, rule)
    return prices, changes(prices)


# how runs are looked at, places, (t0, duration) and the fictitious time that it is foreseen to take
Asked = tuple[Nearness, Places, tuple[float, float], float]


def _at_once(
    system: System,
    ready: Ready,
    begun: BegunStart,
    rule: Rule,
    asked: Asked,
    first: int,
    tol: float,
) -> Proved | None:
    """`run_twice` by one call of the core; None where it does not prove the error.

    Raises
    ------
    _NotPlain
        If a run comes to no good end.
    """
    _, places, (t0, total), span = asked
    called = ready.called
    entries, course = called.loop(ready.moving, "auto"), _varying_course(system, rule, called.most)
    if entries is None or course is None:
        return None
    began = perf_counter()
    h = span / first
    place = asked_until_end(begun.at, h, 0.0, (t0, total), float(first), begun.energy, 1)
    found = varying_runs(course, places, entries, place, first, abs(span), span, tol)
    seconds = perf_counter() - began
    if entries.kernel.is_native and called.gears:
        kernel_after(called.gears, seconds, 0.0)
    if isinstance(found, int):
        if found == NOT_SHORT:
            raise _NotPlain
        return None
    steps, runs, estimate, until, doubt = found
    proved = Proved(steps, (span / steps, begun.constants, until, seconds), estimate, runs)
    return proved if doubt is None else _looked_at(system, ready, begun, asked, proved, doubt, tol)


def _looked_at(
    system: System,
    ready: Ready,
    begun: BegunStart,
    asked: Asked,
    proved: Proved,
    doubt: tuple[float, bool],
    tol: float,
) -> Proved | None:
    """The same with what round-off of the start makes of it; None where that may be too much."""
    (wanted, unseen), course = doubt, _course(system, ready, begun, asked)
    grown, made = by_round_off(course, proved, wanted, tol)
    grown *= CHANCE if unseen else 1.0
    if grown > tol and unseen:
        return None
    return proved._replace(estimate=max(proved.estimate, grown), runs=proved.runs + made)


def _course(system: System, ready: Ready, begun: BegunStart, asked: Asked) -> Course:
    looks, places, _, span = asked
    trial = partial(_trial, ready, begun, *asked)
    parted = partial(_parted, system, ready, begun, *asked)
    apart = partial(_apart, looks, places)
    return course_that_follows(system, trial, apart, parted, span)


@per_scene
def _varying_course(system: System, rule: Rule, most: float) -> VaryingCourse | None:
    """None where the core cannot make such runs."""
    looks = run_nearness(system)
    limits = proof_limits(ATTEMPTS, 1, CLOSER, FORESEEN, HOPELESS, pairs=pairs_for(system))
    patience = float(PATIENCE), float(FIRST_CHUNK), most
    try:
        return looks and varying_course(looks, rule.order, patience, limits)
    except CompileError:
        return None


def _apart(
    looks: Nearness, places: Places, one: How, few: int, other: How, many: int
) -> tuple[float, float, float]:
    return nearness.apart(looks, places, one[2], few, other[2], many)


def _trial(
    ready: Ready,
    begun: BegunStart,
    looks: Nearness,
    places: Places,
    times: tuple[float, float],
    span: float,
    steps: int,
    wanted: float,
    part: int,
) -> Attempt:
    """A run with so many steps, or the first of so many parts of it."""
    began, h, level = perf_counter(), span / steps, iteration_level(wanted, steps)
    t0, total = times
    ends, expected = (t0, total / part if part > 1 else total), float(max(steps // part, 1))
    asked = asked_until_end(begun.at, h, level, ends, expected, begun.energy, 1)
    found = until_end(ready.called, ready.moving, asked, "auto")
    if found is None:
        raise _NotPlain
    run = h, begun.constants, found, perf_counter() - began
    return Attempt(run, nearness.swing(looks, places, found))


def _parted(
    system: System,
    ready: Ready,
    begun: BegunStart,
    looks: Nearness,
    places: Places,
    times: tuple[float, float],
    span: float,
    steps: int,
    wanted: float,
    way: int,
) -> Attempt:
    """The whole run from a start with other last digits, in one of `WAYS`."""
    other = ready.starts.pop() if ready.starts else start_of(system, ready.scene)
    try:
        with_other_digits_of(other, system, begun, way)
        return _trial(ready, other, looks, places, times, span, steps, wanted, 1)
    finally:
        ready.starts.append(other)

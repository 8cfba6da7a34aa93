"""Runs for a wanted accuracy that end where an expression crosses zero, as most are asked for: a
start, a duration, an accuracy.

Decisions are those of `choose_steps`; each run, the search along it and its end are one call of
the core. What that cannot do is left to `to_tolerance`.
"""

from __future__ import annotations

import warnings
from dataclasses import replace
from time import perf_counter
from typing import Any

import numpy as np

from varint.codegen.few_steps import UNTOLD, few_steps
from varint.integration.choice import Choice
from varint.integration.energy_leap import energy_leap
from varint.integration.events.short_search import key_of, search_for
from varint.integration.few_steps import called_of, few_steps_call, loop_now, opening_told
from varint.integration.gears import kernel_after
from varint.integration.linear_run import MAPPED, is_one_map
from varint.integration.no_farther import in_pieces
from varint.integration.plain_start import (
    Room,
    begin_in,
    room_of,
    velocities_in,
)
from varint.integration.plain_trials import NotPlain
from varint.integration.rule_choice import cheapest, iteration_level
from varint.integration.run import FIRST
from varint.integration.run_distance import apart_from_proved
from varint.integration.short_call import is_plainly_asked
from varint.integration.short_looks import looked_at
from varint.integration.short_scenes import Known, fastest_of, known_of
from varint.integration.small_motions import angles_turned
from varint.integration.time_transformation.rate_ahead import NOTHING, seen_ahead
from varint.integration.to_tolerance import with_estimate
from varint.integration.tolerance import DEFAULT_TOL
from varint.integration.trajectories import Run, plain_motion_of
from varint.integration.two_runs import shows_its_error
from varint.integration.watched_trials import Attempts, by_watched_trials
from varint.numerics.limits import check_steps
from varint.results.trajectory import Trajectory
from varint.rules.rule import Rule
from varint.scene.memory import per_scene
from varint.scene.parameters import ParameterValues
from varint.scene.system import System


def call_until(
    system: System,
    rule: Rule | None,
    start: tuple[Any, Any, Any, ParameterValues | None],
    p0: Any,
    duration: Any,
    tol: float | None,
    began: float,
    watched: tuple[Any, Any],
) -> Trajectory | None:
    """The motion from a start (q0, v0, t0, params), or from momenta in place of v0, until an
    expression crosses zero, with events on the way (until, events); None where another way is to
    be taken.
    """
    (q0, v0, t0, params), tol = start, DEFAULT_TOL if tol is None else tol
    if not is_plainly_asked(rule, t0, duration, tol):
        return None
    known = _known_until(system, rule)
    if known is None or not (p0 is None or known.by_momentum):
        return None
    pool = known.rooms
    room = pool.pop() if pool else room_of(system, True)
    try:
        c = begin_in(room, system, start, p0)
        if c is None:
            return None
        check_steps(float(t0), float(duration), 1)
        found = _choice_in(system, known, room, c, float(duration), tol, began, watched[0])
    finally:
        pool.append(room)
    if found is None:
        return None
    choice, piece, quiet = found
    motion: Trajectory | None = choice.motion
    if not (watched[1] or quiet):
        leap = energy_leap(choice.motion, tol)
        if alarm := leap and leap.alarm():
            warnings.warn(alarm, stacklevel=3)
    if watched[1]:
        grid, level = (None, choice.steps, piece), iteration_level(tol, choice.steps)
        asked = q0, v0, p0, t0, params, None
        motion = few_steps_call(system, choice.rule, asked, grid, 1, level, began, watched)
        if motion is not None:
            off = apart_from_proved(motion, choice.motion)
            choice = replace(choice, estimate=choice.estimate + off)
            if not (choice.reached and choice.estimate <= tol):  # iterations should go on
                return None
    return motion and with_estimate(motion, choice, tol, began)


@per_scene
def _known_until(system: System, rule: Rule | None) -> Known | None:
    """None where another way is to be taken, whatever the start."""
    known = known_of(system, rule)
    if known is None or not (known.held or known.by_momentum):
        return None
    mapped = is_one_map(system, MAPPED) or any(is_one_map(system, x.rule) for x in known.rules)
    return None if mapped or not shows_its_error(system) else known


@np.errstate(all="ignore")  # of steps that are too large
def _choice_in(
    system: System,
    known: Known,
    room: Room,
    c: np.ndarray,
    duration: float,
    tol: float,
    began: float,
    until: Any,
) -> tuple[Choice, float, bool] | None:
    """The choice of steps from the start that is there, for which duration, and whether the
    energies of its run are quiet.
    """
    assert room.look is not None
    room.look()
    fastest, t0 = fastest_of(known, room.local) or 0.0, float(room.t[0])
    v = velocities_in(room, system, c)
    begin = np.concatenate((room.q, v)) if known.varies else None
    loud: list[Trajectory] = []

    def choose(piece: float) -> Choice:
        ahead = NOTHING if begin is None else seen_ahead(system, begin, t0, c, piece)
        if ahead.pilot is not None:
            raise NotPlain
        turned = angles_turned(piece, fastest, ahead.frequency)
        rule = known.rules[cheapest(known.changes, turned[1], tol)].rule
        attempt = _attempts(system, room, c, v, (t0, piece), began, until, loud)
        choice = by_watched_trials(system, rule, tol, turned, attempt, None, True)
        if choice is None:
            raise NotPlain
        return choice

    try:
        choice, piece = in_pieces(fastest, t0, duration, choose)
    except NotPlain:
        return None
    return choice, piece, not any(choice.motion is motion for motion in loud)


def _attempts(
    system: System,
    room: Room,
    c: np.ndarray,
    v: np.ndarray,
    span: tuple[float, float],
    began: float,
    until: Any,
    loud: list[Trajectory],
) -> Attempts:
    """Runs from the start that is there, with velocities v, over (t0, duration), until the
    expression crosses zero; those whose energies are not quiet are written down as `loud`.
    """
    (t0, duration), key = span, key_of(until, None)

    def attempt(
        rule: Rule,
        steps: int,
        part: int = 1,
        wanted: float = 0.0,
        digits: int | None = None,
    ) -> tuple[Trajectory, Run | None]:
        called, count = called_of(system, rule), max(steps // part, 1)
        if called is None or digits is not None or called.controlled:
            raise NotPlain
        kernel, how, longest, pilot = loop_now(system, called)
        what = search_for(system, kernel, key, until, None)
        if how is None or what is None or count > min(longest, FIRST):
            raise NotPlain
        now, h = perf_counter(), duration / steps
        asked = t0, h, count, 1, iteration_level(wanted, steps), pilot
        opening = opening_told(system, room, None, h) if kernel.opening else None
        if kernel.opening and opening is None:
            raise NotPlain
        typical = UNTOLD if opening is None or room.opening is None else room.opening.typical
        sought = what, v, typical
        found = few_steps(how, room.place, asked, looked_at(count), None, opening, True, sought)
        if opening is not None and room.opening is not None and room.opening.raised:
            raise room.opening.raised.pop()
        if kernel.is_native:
            kernel_after(called.gears, perf_counter() - now, 0.0)
        if found is None:
            raise NotPlain
        grid, work = (h, t0, np.empty((steps, 1, 0)), c), (int(found.iterations), found.residual)
        seconds = perf_counter() - began
        motion = plain_motion_of(
            system, called.plan, kernel, found.nodes, grid, work, seconds=seconds
        )
        if not found.quiet:
            loud.append(motion)
        return motion, None

    return attempt

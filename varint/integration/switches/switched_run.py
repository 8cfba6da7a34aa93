"""Runs to a wanted accuracy of scenes whose forces jump or kink: no step is taken across a switch,
so that the rule keeps its order.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from varint.integration.choice import Choice
from varint.integration.error_scale import error_scales
from varint.integration.events.crossings import Watch
from varint.integration.hidden import missed_impulse
from varint.integration.plan import plan
from varint.integration.problem import InitialValueProblem, RunOptions
from varint.integration.refinement import CAUTION, NO_DIGITS
from varint.integration.round_off import GROWS, parted, with_other_digits
from varint.integration.rule_choice import choose_rule, phase_error
from varint.integration.shown_order import LEAST_ORDER
from varint.integration.switches.by_rate import by_rate
from varint.integration.switches.compared import apart_from, least_resolved, untold
from varint.integration.switches.course import Course, Piece, kernel_in
from varint.integration.switches.follow import first_unit
from varint.integration.switches.fractional import left_by_halvings, order_at_switches
from varint.integration.switches.frozen import frozen_scene
from varint.integration.switches.joined import joined
from varint.integration.switches.piece import ANGLE
from varint.integration.switches.runs import possible, rules_for, run_pieces
from varint.integration.switches.timetable import timetable
from varint.integration.switches.watching import with_events
from varint.integration.switches.within_rows import (
    of_users_scene,
    rows_written_out,
    written_out,
)
from varint.integration.tolerance import LEAST_TOL, MOST_TOL
from varint.integration.two_runs import FLOOR
from varint.numerics.progress import notice
from varint.results.trajectory import Trajectory
from varint.rules.rule import Rule, gauss
from varint.scene.system import System

FOLLOWING = "following the motion from switch to switch"
FEWEST, MOST = 4, 2**17  # steps of a unit of time
FAILURES = 3  # numbers of steps that lead no farther, after which it is given up
FARTHER = 0.01  # of the duration
MOST_DOUBLINGS = 4  # of the steps at a time
STALLED, PATIENCE = 0.6, 2  # a difference that shrinks by less, so often, shrinks no more


def choose_switched_steps(
    system: System,
    rule: Rule | None,
    problem: InitialValueProblem,
    options: RunOptions,
    tol: float,
    stop: Watch | None,
    watches: Sequence[Watch],
) -> Choice | None:
    """The run whose steps end where forces or potentials switch; None where the scene has no such
    switches, or the motion cannot be followed over them.
    """
    if not (LEAST_TOL <= tol <= MOST_TOL and possible(system, rule, problem, options)):
        return None
    user, nodes = system, plan(system, rule).rule.nodes
    if problem.u.shape[1] > 1:
        system, problem = written_out(system, nodes), rows_written_out(problem)
    begin, total = problem.t0, problem.h * problem.steps
    table = timetable(system, problem.c, begin, total, problem.u[:, 0])
    problem = problem._replace(h=total, steps=1)
    rules = rules_for(system)
    course = Course(system, rule or list(rules)[-1], problem, table, options.backend, tol=tol)
    with np.errstate(all="ignore"), notice(FOLLOWING, options.progress) as say:
        course.say = say
        found = by_rate(course, options, tol, stop)
        if found is None:
            found = _by_units(course, None if rule else rules, tol, options.scale, stop)
        if found is None:
            return None
        choice, pieces = found
        motion = with_events(course, pieces, choice.motion, watches)
        if system is not user:
            motion = of_users_scene(user, nodes, motion)
        return replace(choice, motion=_every(motion, options.save_every))


def _by_units(
    course: Course, rules: dict[Rule, float] | None, tol: float, scale: Any, stop: Watch | None
) -> tuple[Choice, list[Piece]] | None:
    """By the cheapest of rules, where they are left open, with equal steps on each branch."""
    unit = first_unit(course)
    if unit is None:
        return None
    radians = ANGLE * abs(course.problem.h) / unit
    if rules is not None:
        course.rule = choose_rule(rules, radians, tol)
    return _refined(course, radians, tol, scale, stop)


def _refined(
    course: Course, radians: float, tol: float, scale: Any, stop: Watch | None
) -> tuple[Choice, list[Piece]] | None:
    """Runs of twice as many steps each until they have come together; the best and its pieces."""
    system, rule, p = course.system, course.rule, course.rule.order
    # at the ends of steps, which lie on switches, round-off chooses the side
    looks = rule if rule.nodes[0] > 0 else gauss(max(len(rule.nodes) - 1, 1))
    frozen = frozen_scene(system)
    assert frozen is not None
    needed = ANGLE * (max(radians, 1.0) * phase_error(rule) / tol) ** (1 / p)
    parts = FEWEST
    while parts < min(needed / 2, MOST / 16):
        parts *= 2
    before: tuple[int, list[Piece]] | None = None
    best: tuple[Choice, list[Piece]] | None = None
    order, most = (float(p) if frozen.system.structure.linear else None), float(p)
    last, runs, failures, stalls, reached = math.inf, 0, 0, 0, 0.0
    growth, grown = 1.0, 0.0
    while parts <= MOST:
        pieces = run_pieces(course, parts, stop)
        runs += 1
        if pieces is None:
            farther = course.reached > reached + FARTHER * abs(course.problem.h)
            reached, before, last = max(reached, course.reached), None, math.inf
            failures = 1 if farther else failures + 1
            if failures == FAILURES:
                return None
            parts *= 2
            continue
        if before is None:
            before, parts = (parts, pieces), 2 * parts
            continue
        motion = joined(course, pieces, kernel_in(course, pieces[0].branch))
        scales, ratio = error_scales(system, motion, scale), parts // before[0]
        if any(untold(piece, scales) for piece in pieces):
            before, last, parts = (parts, pieces), math.inf, 2 * parts
            continue
        apart, growth = apart_from(course, before[1], pieces, motion, scales)
        if apart < NO_DIGITS:  # a lost run says nothing of where powers begin
            most = max(min(most, order_at_switches(course, pieces)), LEAST_ORDER)
        if not frozen.system.structure.linear and ratio == 2 and last < NO_DIGITS:
            order = max(math.log2(max(last, FLOOR) / max(apart, FLOOR)), LEAST_ORDER)
        order = None if order is None else min(order, most)
        left = 0.5 if order is None or apart > NO_DIGITS else ratio ** (-CAUTION * order)
        rounded = least_resolved(motion, len(pieces), scales)
        alike = left_by_halvings(course, pieces)
        estimate = max(apart * left / (1 - left), rounded, course.left) + alike
        if estimate <= tol and not frozen.system.structure.autonomous:
            estimate = max(estimate, missed_impulse(system, looks, motion, scales, tol))
        grown, latest = 0.0, (parts, (pieces, motion, scales))
        if estimate <= tol and growth >= GROWS:
            grown = _by_round_off(course, *latest, stop, estimate, tol)
            estimate = max(estimate, grown)
        found = Choice(rule, len(motion) - 1, motion, estimate, runs, estimate <= tol)
        if best is None or estimate < best[0].estimate or grown > tol:
            best = found, pieces
        if found.reached:
            return best
        stalls = stalls + 1 if apart > STALLED * last and apart < NO_DIGITS else 0
        if stalls == PATIENCE or estimate == rounded + alike or grown > tol:
            break  # more steps would not do
        more = 1.0 if order is None else math.log2(estimate / tol) / (CAUTION * order)
        last, before = apart, (parts, pieces)
        parts *= 2 ** min(max(math.ceil(more), 1), MOST_DOUBLINGS)
    if best is None:
        return None
    estimate = best[0].estimate
    if growth >= GROWS and not grown:
        estimate = max(estimate, _by_round_off(course, *latest, stop, estimate, tol))
    return replace(best[0], estimate=estimate, runs=runs), best[1]


def _by_round_off(
    course: Course,
    parts: int,
    run: tuple[list[Piece], Trajectory, np.ndarray],
    stop: Watch | None,
    known: float,
    tol: float,
) -> float:
    """What round-off grows to, the start's included, with which all runs begin alike: by the run's
    pieces, motion and scales, and runs from other last digits.
    """
    pieces, motion, scales = run
    problem, s = course.problem, course.system.structure
    if s.nonholonomic or course.system.rays:
        return 0.0

    def apart(way: int) -> float:
        q0, p0 = with_other_digits(problem.q0, problem.p0, way)
        other = replace(course, problem=problem._replace(q0=q0, p0=p0))
        found = run_pieces(other, parts, stop)
        return 0.0 if found is None else apart_from(course, found, pieces, motion, scales)[0]

    return parted(apart, known, tol)[0]


def _every(motion: Trajectory, every: int) -> Trajectory:
    """Every so many nodes, and the last."""
    if every == 1:
        return motion
    kept = np.arange(len(motion)) % every == 0
    kept[-1] = True
    return motion[np.flatnonzero(kept)]

"""Runs for a wanted accuracy as most are asked for: a start, a duration, an accuracy, no more.

What follows from the scene alone is looked up once, and numbers go from the user to the core and
back by one block of memory. `to_tolerance` does the same where more is asked for, or something is
not as it should be, and says what.
"""

from __future__ import annotations

from time import perf_counter

import numpy as np

from varint.codegen.kernel import Kernel
from varint.codegen.two_runs import Course, Places
from varint.integration.backend import runs_by_stages
from varint.integration.compiled_loop import scheme_of
from varint.integration.energy_check import energy_rows
from varint.integration.gears import Gears, gears_of, kernel_now
from varint.integration.plain_start import (
    Room,
    asks_for_no_more,
    begin_in,
    is_plain,
    is_plain_number,
    room_of,
    rooms,
)
from varint.integration.plan import Plan, plan
from varint.integration.problem import RunOptions, Start
from varint.integration.rule_choice import Priced, candidates, cheapest, priced
from varint.integration.second_looks import has_switches
from varint.integration.short_trials import course_by, two_short_runs
from varint.integration.small_motions import MOST_COORDINATES, angle_turned, frequency_of_columns
from varint.integration.time_transformation.variable_course import may_vary, worthwhile_pilot
from varint.integration.tolerance import LEAST_TOL, MOST_TOL
from varint.integration.trajectories import plain_motion_of
from varint.integration.two_runs import shows_its_error
from varint.numerics.dataclass import dataclass
from varint.numerics.limits import check_steps
from varint.results.trajectory import Trajectory
from varint.rules.rule import Rule, gauss
from varint.scene.memory import per_scene
from varint.scene.system import System


def short_call(
    system: System, rule: Rule | None, start: Start, options: RunOptions, tol: float, began: float
) -> Trajectory | int | None:
    """The motion, if two short runs prove its error; what `by_short_trials` says if not; None where
    another way is to be taken.
    """
    duration = options.duration
    if not (asks_for_no_more(rule, start, options) and is_plain_number(duration)):
        return None
    known = _known(system, rule) if duration and LEAST_TOL <= tol <= MOST_TOL else None
    if known is None:
        return None
    pool = rooms(system, True)
    room = pool.pop() if pool else room_of(system, True)
    try:
        c = begin_in(room, system, start)
        if c is None:
            return None
        return _by_the_core(system, known, room, c, float(start.t0), float(duration), tol, began)
    finally:
        pool.append(room)


def _by_the_core(
    system: System,
    known: _Known,
    room: Room,
    c: np.ndarray,
    t0: float,
    duration: float,
    tol: float,
    began: float,
) -> Trajectory | int | None:
    check_steps(t0, duration, 1)
    if known.varies and worthwhile_pilot(system, room.q, room.v, c, duration):
        return None
    n = known.n
    assert room.look is not None
    room.look()
    room.mass[:] = room.local[: n * n : n + 1]
    numbers = room.local.tolist()
    fastest = frequency_of_columns(numbers[: n * n], numbers[n * n :], n)
    radians = angle_turned(duration, fastest)
    rule = cheapest(known.rules, radians, tol)
    loop = _loop(system, rule)
    if loop is None:
        return None
    kernel = kernel_now(loop.gears)
    if kernel is not loop.last[0]:
        loop.last = kernel, course_by(system, rule, kernel)
    course = loop.last[1]
    if course is None:
        return None
    places = Places(room.at, room.mass_at, room.c_at, room.found_at, room.found)
    found = two_short_runs((system, rule, kernel, course), places, t0, duration, radians, tol)
    if isinstance(found, int):
        return found
    steps = found.steps
    return plain_motion_of(
        system,
        loop.plan,
        kernel,
        (found.k, found.t, found.q, found.p),
        (duration / steps, t0, np.empty((steps, 1, 0)), c),
        (found.iterations, found.residual),
        seconds=perf_counter() - began,
        tol=tol,
        error_estimate=found.estimate,
        rule=rule.name,
        runs=found.runs,
    )


@dataclass(frozen=True, eq=False)
class _Known:
    """Of a scene: coordinates, rules and their prices, and whether steps may vary."""

    n: int
    rules: tuple[Priced, ...]
    varies: bool


@per_scene
def _known(system: System, rule: Rule | None) -> _Known | None:
    """None where another way is to be taken, whatever the start."""
    n, own = system.structure.n, plan(system, rule).rule
    if not (is_plain(system) and shows_its_error(system) and n <= MOST_COORDINATES):
        return None
    if has_switches(system) or energy_rows(system) is None:
        return None
    if rule is None and not runs_by_stages(system, gauss(8), "auto"):
        return None
    rules = candidates(system, False, True) if rule is None else {own: 1.0}
    return _Known(n, priced(rules), may_vary(system, rule))


@dataclass(eq=False)
class _Loop:
    """Of a scene and a rule: the plan, the gears, and the loop that ran last, with its course."""

    plan: Plan
    gears: Gears
    last: tuple[Kernel | None, Course | None] = (None, None)


@per_scene
def _loop(system: System, rule: Rule) -> _Loop | None:
    gears = gears_of(system, rule, scheme_of(system, rule))
    return None if gears is None else _Loop(plan(system, rule), gears)

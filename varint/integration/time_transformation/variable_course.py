"""Runs to a wanted accuracy with steps that follow the scene, where its time scale varies."""

from __future__ import annotations

import math
import warnings
from functools import partial
from typing import Any

import casadi as ca
import numpy as np

from varint.errors import ConvergenceError, VarintError
from varint.integration.attempts import LAST_DIGIT, SAMPLES, Attempt
from varint.integration.choice import Choice
from varint.integration.energy_quantiles import quantiles
from varint.integration.error_scale import error_scales, scales_of_nodes
from varint.integration.problem import InitialValueProblem, RunOptions, Start
from varint.integration.rule_choice import (
    Priced,
    candidates,
    cheapest_of,
    first_steps,
    iteration_level,
    priced,
)
from varint.integration.run_distance import TELLING, beyond_shared, with_early
from varint.integration.second_looks import has_steps
from varint.integration.time_transformation.fictitious_start import start_velocity
from varint.integration.time_transformation.plain_course import (
    PhysicalRun,
    energies_of_nodes,
    physical_run,
    velocities,
)
from varint.integration.time_transformation.rate_ahead import (
    WORTH,
    has_many,
    kinds_of,
    seen_ahead,
    seen_along,
)
from varint.integration.time_transformation.rate_pilot import rate_pilot, rate_varies
from varint.integration.time_transformation.time_scale import AUTO, FLIGHT
from varint.integration.time_transformation.time_signals import signals_of
from varint.integration.time_transformation.transformed_run import (
    Prepared,
    prepare,
    with_other_digits_at_start,
)
from varint.integration.two_runs import FLOOR, UNRESCUED, Apart, Course, Trial, run_twice
from varint.integration.walls import Failure, require_way_on
from varint.integration.work_bound import keeps_energy
from varint.numerics.arrays import call
from varint.results.trajectory import Trajectory
from varint.rules.rule import Rule
from varint.scene.memory import per_scene
from varint.scene.system import System

TURNED = 4.0  # of the fastest signal in a step at most, in radians
# differences that show an error over forces and explicit time: energies tell not all of it there
PAIRS = 2
ATTEMPTS = 16  # equal steps, which are left else, would be far more
# encounters magnify what iterations leave, which no number of steps mends: a coarse run would be
# lost by that alone, or its energy say that it is
CLOSER = 0.01
# growth of what iterations leave where two bodies meet: an iteration more in each step, where
# one that was expected too late costs another run
FORESEEN = 1e5
MOST_COMPARED = 5000  # nodes of two runs that are compared, and up to as many more
STILL = 1e-3  # radians of a whole motion: forces of its beginning are none, and so is their rate
MOST_COORDINATES = 128  # beyond, finding the rate takes many seconds


def choose_varying_steps(
    system: System,
    rule: Rule | None,
    problem: InitialValueProblem,
    start: Start,
    options: RunOptions,
    tol: float,
    astray: Trajectory | int | None = None,
) -> Choice | ConvergenceError | None:
    """The run with steps that follow the local rate of the scene; None where that is not worth it
    or not possible, or where neither an error below tol nor that there is none can be shown. How it
    ends where a rate in flight leads no farther: that may have poles where the motion has none.

    The look ahead sees no more than the beginning: a run with equal steps that went `astray` later
    on shows whether the rate varies till there, or has shown which one of `kinds_of`.
    """
    ready = looks_ahead if astray is None else may_vary
    if problem.steps > 1 or not ready(system, rule):
        return None
    total, v, t0, c = problem.h, start_velocity(system, problem, start.v0), problem.t0, problem.c
    if astray is None:
        pilot = seen_ahead(system, np.concatenate((problem.q0, v)), t0, c, total).pilot
    elif isinstance(astray, int):
        pilot = seen_along(system, np.concatenate((problem.q0, v)), t0, c, total, astray)
    else:
        kinds = (x for x in kinds_of(system) if rate_varies(system, astray, WORTH, x))
        looks = (rate_pilot(system, problem.q0, v, t0, c, total, total < 0, x) for x in kinds)
        pilot = next((look for look in looks if look is not None), None)
    if pilot is None or pilot.mean * abs(total) < STILL:
        return None
    word = FLIGHT if pilot.flight else AUTO
    span = pilot.mean * total
    asked = options._replace(h=span, tol=None, scale=None, save_every=1, progress=False)
    asked = asked._replace(steps=None, events=None)
    price = cheapest_of(prices_for(system, rule), abs(span), tol)
    own, first = price.rule, first_steps(price, abs(span), tol)
    with np.errstate(all="ignore"), warnings.catch_warnings():  # of steps that are too large
        warnings.simplefilter("ignore")
        prepared = prepare(system, own, word, start, asked, problem)
        course = _course(prepared, span, total, options.scale, prepared.stop is not None)
        try:
            found = run_twice(own, course, first, tol, FLOOR)
        except ConvergenceError as error:
            if not pilot.flight:
                raise
            return error
    if found is None:
        return None
    if not resolves_signals(system, problem.c, found.run.t):
        return None
    motion = found.run.motion()
    reached = found.estimate <= tol
    return Choice(own, found.steps, motion, found.estimate, found.runs, reached, True, word)


def frequency_ahead(
    system: System, rule: Rule | None, problem: InitialValueProblem, start: Start
) -> float:
    """Of a motion whose first equal steps suit this one, 0 where nothing ahead tells of it."""
    if problem.steps > 1 or not looks_ahead(system, rule):
        return 0.0
    at = np.concatenate((problem.q0, start_velocity(system, problem, start.v0)))
    return seen_ahead(system, at, problem.t0, problem.c, problem.h).frequency


@per_scene
def prices_for(system: System, rule: Rule | None) -> tuple[Priced, ...]:
    """The rule, or those that can follow a rate that varies."""
    if rule is not None:
        return priced({rule: 1.0})
    return priced({r: work for r, work in candidates(system, True).items() if r.points})


def looks_ahead(system: System, rule: Rule | None) -> bool:
    """Whether the beginning of motions is looked at for a rate that varies."""
    return not has_many(system) and may_vary(system, rule)


def may_go_astray(system: System, rule: Rule | None) -> bool:
    """Whether a rate may be asked for where equal steps go astray: in scenes of many coordinates
    it is not known before.
    """
    return can_follow(system, rule) and (has_many(system) or bool(kinds_of(system)))


def may_vary(system: System, rule: Rule | None) -> bool:
    """Whether the scene has a rate that varies, which the rule can follow."""
    return can_follow(system, rule) and bool(kinds_of(system))


def can_follow(system: System, rule: Rule | None) -> bool:
    """Whether the rule could follow a rate of the scene, if there is one."""
    s = system.structure
    return (
        (rule is None or bool(rule.points))
        and s.n <= MOST_COORDINATES
        and (s.constant_mass or not has_many(system))
        and not (s.controls or s.constraints or s.linear or s.contacts or s.degenerate)
        and (keeps_energy(system) or not (s.nonholonomic or has_steps(system)))
        and signals_of(system).rate is not None  # pulses are found by equal steps
    )


def _course(prepared: Prepared, span: float, total: float, scale: Any, ends_early: bool) -> Course:
    system = prepared.system
    c = prepared.problem.c[: system.c.numel()]
    failures: list[Failure] = []  # since the last run that ended well

    def trial(steps: int, wanted: float, part: int, ready: Prepared = prepared) -> Attempt | None:
        problem = ready.problem._replace(
            h=span / steps,
            level=iteration_level(wanted, steps),
            steps=max(steps // part, 1),
            rescued=steps > UNRESCUED,
        )
        if part > 1:
            assert ready.total is not None
            ready = ready._replace(total=ready.total / part)
        try:
            found = physical_run(ready, problem)
        except ConvergenceError as error:  # steps too large for the motion
            failures.append((steps, error))
            require_way_on(failures, total, varying=True)
            return None
        except VarintError:
            return None
        failures.clear()
        return attempt_of(system, found, c)

    def parted(steps: int, wanted: float, way: int) -> Attempt | None:
        return trial(steps, wanted, 1, with_other_digits_at_start(prepared, way))

    apart = partial(apart_by, system, c, scale, ends_early)
    return course_that_follows(system, trial, apart, parted, span)


def course_that_follows(
    system: System, trial: Trial, apart: Apart, parted: Trial, span: float
) -> Course:
    """How runs over so much fictitious time are proved, however they are made."""
    return Course(
        trial,
        apart,
        abs(span),
        attempts=ATTEMPTS,
        closer=CLOSER,
        parted=parted,
        foreseen=FORESEEN,
        pairs=pairs_for(system),
    )


def pairs_for(system: System) -> int:
    """How many differences of runs show an error."""
    return 1 if keeps_energy(system) else PAIRS


def resolves_signals(system: System, c: np.ndarray, t: np.ndarray) -> bool:
    """Whether steps between such times are short for what acts in time."""
    if not signals_of(system).values.numel():
        return True
    (fastest,) = call(_fastest_function(system), c)[0]
    return bool(np.abs(np.diff(t)).max() * fastest <= TURNED)


@per_scene
def _fastest_function(system: System) -> ca.Function:
    """c → the rate of the fastest signal."""
    return ca.Function("fastest", [system.c], [ca.densify(signals_of(system).rate)])


def attempt_of(system: System, run: PhysicalRun, c: np.ndarray) -> Attempt:
    """A run with the energy errors of some of its nodes."""
    some = slice(None, None, max(1, len(run.t) // SAMPLES))
    energy, moving = energies_of_nodes(system, c, run, some)
    swing = quantiles(energy, moving)  # moving is sorted now
    size, most = moving.item(len(moving) // 2), moving.item(-1)
    return Attempt(run, swing, digit=LAST_DIGIT * most / size if size else math.inf)


def apart_by(
    system: System,
    c: np.ndarray,
    scale: Any,
    ends_early: bool,
    one: PhysicalRun,
    few: int,
    other: PhysicalRun,
    many: int,
) -> tuple[float, float, float]:
    """Largest difference of two runs with so many steps, that of their first half, and how many
    times larger it is between shared nodes: at nodes of the same fictitious times, whose physical
    ones differ.
    """
    if ends_early and len(other.t) < TELLING:
        return math.inf, math.inf, 1.0
    if scale is None and system.structure.quadratic_kinetic:
        still = np.zeros(system.structure.n)
        scales = scales_of_nodes(system, other.q, still, other.t[:1], c)
    else:
        scales = error_scales(system, other.motion(), scale)
    unit = math.gcd(few, many)
    every, of_other = few // unit, many // unit
    # the last node is no whole step from the one before
    count = min(-((1 - len(one.t)) // every), -((1 - len(other.t)) // of_other))
    apart = max(1, count // MOST_COMPARED)
    i = slice(0, count * every, apart * every)
    j = slice(0, count * of_other, apart * of_other)
    late = (one.t[i] - other.t[j])[:, None]
    off = np.abs(one.q[i] - other.q[j] - late * velocities(system, c, other, j))
    end = np.abs(one.q[-1:] - other.q[-1:])
    if ends_early:
        last = slice(len(other.t) - 1, None)
        end += abs(one.t[-1] - other.t[-1]) * np.abs(velocities(system, c, other, last))
    off = np.concatenate((off, end)) / scales
    return *with_early(off), beyond_shared(off, other.q, j, other.t)

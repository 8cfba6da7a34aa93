"""Trial runs for a wanted accuracy as numbers alone, without what a trajectory is made of around
each, where coordinates and momenta at nodes are all of it.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from varint.discrete.composed import steps_by_gauss
from varint.integration.attempts import SAMPLES, Attempt, attempt_by_energies
from varint.integration.backend import kernel_for, run_at_once
from varint.integration.energy_check import energies_along, energies_by_velocity
from varint.integration.energy_quantiles import QUANTILES
from varint.integration.error_scale import error_scales, scales_of_nodes
from varint.integration.linear_run import (
    TOLD,
    first_of_map,
    is_one_map,
    map_alone,
    nodes_by_map,
)
from varint.integration.plan import plan
from varint.integration.problem import InitialValueProblem
from varint.integration.round_off import with_other_digits
from varint.integration.rule_choice import iteration_level, steps_for
from varint.integration.run import motion_at_once
from varint.integration.run_distance import beyond_shared, with_early
from varint.integration.trajectories import Run, with_stats
from varint.integration.two_runs import FLOOR, SAME_STEP, SLOW, WATCHED, Course, Proved, run_twice
from varint.results.trajectory import Trajectory
from varint.rules.rule import Rule
from varint.scene.system import System

if TYPE_CHECKING:
    from varint.codegen.kernel import Kernel, LoopResult


class PlainTrial(NamedTuple):
    """A run by its loop alone."""

    problem: InitialValueProblem
    kernel: Kernel
    found: LoopResult


class NotPlain(Exception):
    """A run that takes another loop."""


def has_plain_trials(system: System, start: InitialValueProblem) -> bool:
    """Whether nothing but coordinates and momenta at nodes makes the motion."""
    s = system.structure
    held = s.constraints or s.nonholonomic or s.contacts
    first_order = s.degenerate and not steps_by_gauss(system)
    return start.steps == 1 and not (held or first_order or s.controls or system.rays)


def first_steps_of(
    start: InitialValueProblem, rule: Rule, steps: int, count: int, wanted: float
) -> InitialValueProblem:
    """The first `count` of so many steps, solved as far as a wanted error asks for."""
    return start._replace(
        h=start.h / steps,
        steps=count,
        save_every=1,
        u=np.empty((count, 1, 0)),
        nodes=len(rule.nodes),
        level=iteration_level(wanted, steps),
    )


@np.errstate(all="ignore")  # of steps that are too large
def by_plain_trials(
    system: System,
    rule: Rule,
    start: InitialValueProblem,
    tol: float,
    turned: tuple[float, float],
    scale: Any,
    backend: str,
) -> Proved | None:
    """`run_twice` with such trials; its run is a `PlainTrial`. `turned`: by how much the motion
    turns, and the one that the first steps are for.

    Raises
    ------
    NotPlain
    """
    (radians, begin), time = turned, np.array([start.t0])
    quadratic = system.structure.quadratic_kinetic
    still = np.zeros(system.structure.n)
    one_map = backend == "auto" and is_one_map(system, rule)
    few = first_of_map(rule, radians, tol) if one_map else None
    mapped = few is not None
    alone = map_alone(system, rule) if mapped else None
    first = steps_for(rule, begin, tol) if few is None else few
    floor = FLOOR if few is None else max(FLOOR, SAME_STEP * few)

    def trial(
        steps: int, wanted: float, part: int, start: InitialValueProblem = start
    ) -> Attempt | None:
        count = max(steps // part, 1)
        problem = first_steps_of(start, rule, steps, count, wanted)
        kernel = alone or kernel_for(system, rule, problem, backend)
        found = nodes_by_map(system, rule, problem) if mapped else None
        if found is None and kernel is not None:
            found = run_at_once(system, rule, problem, kernel, short=False)
        if kernel is None or (found is None and part == 1):
            raise NotPlain
        if found is None or not found.done or (part > 1 and found.iterations > SLOW * count):
            return None
        if not found.carry.size:  # the map keeps energies but for round-off, whatever the steps
            return Attempt(PlainTrial(problem, kernel, found), [0.0] * len(QUANTILES))
        some = found.rows[:: max(1, len(found.rows) // SAMPLES)]
        if quadratic:
            energy = energies_along(system, some[:, 0], some[:, 1], time, start.c)
        else:
            energy = energies_by_velocity(system, some, time, start.c)
        return attempt_by_energies(PlainTrial(problem, kernel, found), *energy)

    def apart(
        one: PlainTrial, few: int, other: PlainTrial, many: int
    ) -> tuple[float, float, float]:
        q = other.found.rows[:, 0].copy()  # side by side: three times as fast
        if scale is None:
            v = still if quadratic else np.nan_to_num(other.found.rows[0, 2])
            scales = scales_of_nodes(system, q, v, time, start.c)
        else:
            scales = error_scales(system, plain_motion(system, rule, other, 0.0), scale)
        unit = math.gcd(few, many)
        off = one.found.rows[:: few // unit, 0] - q[:: many // unit]
        off = np.abs(off, out=off) / scales
        return *with_early(off), beyond_shared(off, q, slice(None, None, many // unit))

    def parted(steps: int, wanted: float, way: int) -> Attempt | None:
        q0, p0 = with_other_digits(start.q0, start.p0, way)
        return trial(steps, wanted, 1, start._replace(q0=q0, p0=p0))

    linear = system.structure.linear
    course = Course(trial, apart, radians, linear, watched=WATCHED, parted=parted, exact=mapped)
    return run_twice(rule, course, first, tol, floor)


def plain_motion(system: System, rule: Rule, run: PlainTrial, began: float) -> Trajectory:
    """The motion of a run."""
    whole = Run(system, plan(system, rule), run.problem, [], iter(()), run.kernel, began)
    motion = motion_at_once(whole, run.found)
    return motion if run.found.carry.size else with_stats(motion, backend=TOLD)

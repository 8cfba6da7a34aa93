"""Runs with a time scale: fixed steps of the rescaled scene, nodes and dense output at physical
times.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from time import perf_counter
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, NamedTuple

import casadi as ca

from varint.errors import ConvergenceError, InputError
from varint.integration.energy_leap import energy_alarm
from varint.integration.fixed_steps import simulate_steps, watches_of
from varint.integration.plan import Plan, plan
from varint.integration.problem import (
    WHOLE,
    InitialValueProblem,
    RunOptions,
    Start,
    initial_value_problem,
)
from varint.integration.round_off import with_other_digits
from varint.integration.run import collect, start_run
from varint.integration.time_transformation.fictitious_start import (
    in_fictitious_time,
    rate_at,
    slowest_rate,
    start_velocity,
)
from varint.integration.time_transformation.physical_end import (
    blocks_until,
    end_at_duration,
    require_level,
)
from varint.integration.time_transformation.physical_time import (
    in_physical_time,
    physical_events,
)
from varint.integration.time_transformation.rate_pilot import RatePilot, rate_pilot
from varint.integration.time_transformation.time_scale import (
    AUTO,
    FLIGHT,
    own_scale,
    rate_of,
    transformed_scene,
)
from varint.integration.time_transformation.transformed_scene import TransformedScene
from varint.results.trajectory import Trajectory
from varint.rules.rule import Rule
from varint.scene.expressions import in_own_symbols
from varint.scene.inputs import number
from varint.scene.system import System

if TYPE_CHECKING:
    from varint.integration.events.crossings import Watch


def simulate_transformed(
    system: System, rule: Rule | None, sigma: Any, start: Start, options: RunOptions
) -> Trajectory:
    """`simulate` with a time scale: h is the step of τ, dt = σ(q) dτ; nodes at physical times."""
    h, steps, duration = options.h, options.steps, options.duration
    if h is None or (steps is None) == (duration is None):
        raise InputError(
            "with time_scale give h, the step of the fictitious time, and either steps or duration"
        )
    total = None if duration is None else number("duration", duration)
    if total is not None and not total * number("h", h) > 0:
        raise InputError(f"h={h} and duration={duration} must have the same sign and not be zero")
    if isinstance(sigma, str):
        sigma = own_scale(system, sigma)
        transformed_scene(system, sigma)
        if reason := rate_of(system, sigma).reason:
            return _equal_steps(system, rule, reason, start, options)
    prepared = prepare(system, rule, sigma, start, options)
    motion = run_prepared(prepared, prepared.problem)
    assert motion.fictitious is not None
    if alarm := energy_alarm(motion.fictitious):
        warnings.warn(alarm, stacklevel=3)
    return motion


class Prepared(NamedTuple):
    """A run in fictitious time, ready to go: the scene, its problem with the clock at zero, and
    what is looked for on the way.
    """

    system: System
    scene: TransformedScene
    chosen: Plan
    problem: InitialValueProblem
    t0: float
    total: float | None
    stop: Watch | None
    watches: Sequence[Watch]
    options: RunOptions
    pilot: RatePilot | None


def prepare(
    system: System,
    rule: Rule | None,
    sigma: Any,
    start: Start,
    options: RunOptions,
    begun: InitialValueProblem | None = None,
) -> Prepared:
    """Checked and completed input of a run with steps h and a duration, or a number of steps; of a
    run without controls whose start is checked already, `begun` is with other steps.
    """
    scene = transformed_scene(system, sigma)
    chosen = plan(scene.system, rule)
    total = None if options.duration is None else float(options.duration)
    count = 1 if options.steps is None else options.steps
    if begun is None:
        asked = options._replace(steps=count, duration=None)
        problem = initial_value_problem(system, chosen.rule, start, asked)
    else:
        problem = begun._replace(h=float(options.h), steps=count, nodes=len(chosen.rule.nodes))
    inside = partial(_inside, system, scene, problem.t0)
    until, events = options.until, options.events
    if until is not None:
        until = inside(until, "until")
    if isinstance(events, Mapping):
        events = {name: inside(wanted, name) for name, wanted in events.items()}
    stop, watches = watches_of(until, events)
    rate, pilot = 0.0, None
    if isinstance(sigma, str):
        v = start_velocity(system, problem, start.v0)
        flies = sigma == FLIGHT
        begin = problem.q0, v, problem.t0, problem.c
        pilot = rate_pilot(system, *begin, total, problem.h < 0, flies)
        rate = slowest_rate(pilot, total)
    inner = in_fictitious_time(system, scene, problem, start.v0, rate, total)
    return Prepared(system, scene, chosen, inner, problem.t0, total, stop, watches, options, pilot)


def with_other_digits_at_start(prepared: Prepared, way: int) -> Prepared:
    """With the start of `with_other_digits`, at an energy and a time scale of its own."""
    system, scene, inner = prepared.system, prepared.scene, prepared.problem
    n = system.structure.n
    q0, p0 = with_other_digits(inner.q0[:n], inner.p0[:n], way)
    own = inner._replace(q0=q0, p0=p0, t0=prepared.t0, c=inner.c[: system.c.numel()])
    slowest = float(inner.c[-3])
    problem = in_fictitious_time(system, scene, own, None, slowest, prepared.total)
    return prepared._replace(problem=problem)


def run_prepared(prepared: Prepared, problem: InitialValueProblem) -> Trajectory:
    """The run with the step, the number of steps and the level of iterations of `problem`."""
    system, scene, chosen, _, t0, total, stop, watches, options, _ = prepared
    run = start_run(scene.system, chosen, problem, perf_counter(), backend=options.backend)
    if total is not None:
        run = run._replace(blocks=blocks_until(scene, run, total))
    try:
        inner = collect(run, stop=stop, watches=watches, progress=options.progress, on_failure=None)
        require_level(scene, run, inner)
    except ConvergenceError as error:
        motion, failure = in_physical_time(system, t0, error.trajectory), error
        raise ConvergenceError(
            lambda _: (
                f"in fictitious time (dt = σ dτ): {failure}; it is physical time "
                f"t = {motion.t[-1]:g}"
            ),
            step=error.step,
            time=float(motion.t[-1]),
            residual=error.residual,
            trajectory=motion,
            cause=lambda: failure.cause,
        ) from None
    if total is not None and abs(inner.q[-1, -1]) >= abs(total):
        inner = end_at_duration(run, inner, total)
    motion = in_physical_time(system, t0, inner)
    if not inner.events:
        return motion
    return replace(motion, events=physical_events(system, t0, inner))


def _equal_steps(
    system: System, rule: Rule | None, reason: str, start: Start, options: RunOptions
) -> Trajectory:
    """The run of a scene whose own time scale is the same everywhere: equal steps dt = h/ω, or a
    little less where they end with the duration.
    """
    rate = rate_at(system, transformed_scene(system, AUTO), start)
    if not rate > 0:
        raise InputError(
            "time_scale='auto' takes steps of h over the rate of the forces' change, which is "
            f"{rate:g} here: nothing pulls or turns; leave time_scale out"
        )
    step = number("h", options.h) / rate
    if options.steps is None:
        count = max(1, math.ceil(abs(number("duration", options.duration) / step) * (1 - WHOLE)))
        grid = options._replace(h=None, steps=count)
    else:
        grid = options._replace(h=step)
    motion = simulate_steps(system, rule, start, grid)
    chosen = motion.stats["plan"]
    skipped = replace(chosen, skipped=(*chosen.skipped, f"time scale: {reason}"))
    return replace(motion, stats=MappingProxyType({**motion.stats, "plan": skipped}))


def _inside(system: System, scene: TransformedScene, t0: float, wanted: Any, what: str) -> Any:
    """What is watched, in the symbols of the rescaled scene, whose clock starts at zero."""
    expression, *direction = wanted if isinstance(wanted, tuple) else (wanted,)
    found = scene.translate(in_own_symbols(expression, system, what))
    clock = scene.system.q[-1]
    found = ca.substitute(found, clock, clock + t0) if t0 and not scene.accounts else found
    return (found, *direction) if direction else found

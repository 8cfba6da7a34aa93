"""Runs with a time scale: fixed steps of the rescaled scene, nodes and dense output at physical
times.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from time import perf_counter
from typing import Any

import casadi as ca
import numpy as np

from varint.discrete.legendre import velocity_function
from varint.errors import ConvergenceError, InputError
from varint.integration.energy_leap import energy_alarm
from varint.integration.events.crossings import parse_watch, parse_watches
from varint.integration.plan import plan
from varint.integration.problem import (
    InitialValueProblem,
    RunOptions,
    Start,
    initial_value_problem,
)
from varint.integration.run import (
    collect,
    start_run,
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
from varint.integration.time_transformation.time_scale import TransformedScene, transformed_scene
from varint.numerics.arrays import call
from varint.numerics.limits import MOST_STEPS, check_steps
from varint.results.trajectory import Trajectory
from varint.rules.rule import Rule
from varint.scene.expressions import in_own_symbols
from varint.scene.inputs import number
from varint.scene.system import System


def simulate_transformed(
    system: System, rule: Rule | None, sigma: Any, start: Start, options: RunOptions
) -> Trajectory:
    """`simulate` with a time scale: h is the step of τ, dt = σ(q) dτ; nodes at physical times."""
    began = perf_counter()
    h, steps, duration, events = options.h, options.steps, options.duration, options.events
    scene = transformed_scene(system, sigma)
    if h is None or (steps is None) == (duration is None):
        raise InputError(
            "with time_scale give h, the step of the fictitious time, and either steps or duration"
        )
    total = None if duration is None else number("duration", duration)
    if total is not None and not total * number("h", h) > 0:
        raise InputError(f"h={h} and duration={duration} must have the same sign and not be zero")
    chosen = plan(scene.system, rule)
    problem = initial_value_problem(
        system,
        chosen.rule,
        start,
        options._replace(steps=1 if steps is None else steps, duration=None),
    )
    energy, start_scale = _start(system, scene, problem, start.v0)
    check_steps(problem.t0, problem.h * start_scale, problem.steps)
    inside = partial(_inside, system, scene, problem.t0)
    until = options.until
    stop = None if until is None else parse_watch("until", inside(until, "until"))
    if isinstance(events, Mapping):
        events = {name: inside(wanted, name) for name, wanted in events.items()}
    watches = parse_watches(events)
    pace = 0.0 if total is None else total / float(problem.h * start_scale)
    if pace > MOST_STEPS:
        raise InputError(
            f"duration={total:g} takes {pace:.3g} steps of h={h}, more than any run can; take "
            "larger ones"
        )
    count = problem.steps if total is None else max(1, math.ceil(pace))
    run = start_run(
        scene.system,
        chosen,
        problem._replace(
            q0=np.append(problem.q0, 0.0),
            p0=np.append(problem.p0, start_scale),
            t0=0.0,
            steps=count,
            u=np.empty((count, 1, 0)),
            c=np.append(problem.c, (energy, start_scale)),
        ),
        began,
        backend=options.backend,
    )
    if total is not None:
        run = run._replace(blocks=blocks_until(scene, run, total))
    try:
        inner = collect(run, stop=stop, watches=watches, progress=options.progress)
    except ConvergenceError as error:
        motion = in_physical_time(system, problem.t0, error.trajectory)
        raise ConvergenceError(
            f"in fictitious time (dt = σ dτ): {error}; it is physical time t = {motion.t[-1]:g}",
            step=error.step,
            time=float(motion.t[-1]),
            residual=error.residual,
            trajectory=motion,
        ) from None
    require_level(scene, run, inner)
    if total is not None and abs(inner.q[-1, -1]) >= abs(total):
        inner = end_at_duration(run, inner, total)
    motion = in_physical_time(system, problem.t0, inner)
    if alarm := energy_alarm(inner):
        warnings.warn(alarm, stacklevel=3)
    return (
        replace(motion, events=physical_events(system, problem.t0, inner))
        if inner.events
        else motion
    )


def _start(
    system: System, scene: TransformedScene, problem: InitialValueProblem, v0: Any
) -> tuple[float, float]:
    """Energy and σ at the start."""
    t = np.array([problem.t0])
    if v0 is None:
        (velocity,) = call(velocity_function(system), problem.q0, problem.p0, t, problem.c)
    else:
        velocity = np.array(v0, dtype=float).ravel()
    (energy,), (scale,) = call(scene.energy, problem.q0, velocity, t, problem.c)
    if not (math.isfinite(scale) and scale > 0):
        raise InputError(f"time_scale must be positive, but it is {scale:g} at the start")
    return energy, scale


def _inside(system: System, scene: TransformedScene, t0: float, wanted: Any, what: str) -> Any:
    """What is watched, in the symbols of the rescaled scene, whose clock starts at zero."""
    expression, *direction = wanted if isinstance(wanted, tuple) else (wanted,)
    found = scene.translate(in_own_symbols(expression, system, what))
    clock = scene.system.q[-1]
    found = ca.substitute(found, clock, clock + t0) if t0 else found
    return (found, *direction) if direction else found

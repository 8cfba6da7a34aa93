"""Runs whose number of steps is given: from checked input to the trajectory, watched on the way."""

from __future__ import annotations

import warnings
from functools import partial
from time import perf_counter
from typing import TYPE_CHECKING, Any

from varint.errors import ConvergenceError
from varint.integration.energy_leap import energy_alarm
from varint.integration.false_speed import false_speed
from varint.integration.hard_steps import HardStep, until_hard
from varint.integration.plan import plan
from varint.integration.problem import (
    InitialValueProblem,
    RunOptions,
    Start,
    initial_value_problem,
)
from varint.integration.run import collect, short_run, start_run
from varint.integration.trajectories import subsample
from varint.numerics.limits import check_steps
from varint.results.trajectory import Trajectory
from varint.rules.rule import Rule
from varint.scene.system import System

if TYPE_CHECKING:
    from varint.integration.events.crossings import Watch


def simulate_steps(
    system: System, rule: Rule | None, start: Start, options: RunOptions, level: float | None = None
) -> Trajectory:
    """`simulate` with two of h, steps and duration.

    `level` is where compiled iterations end, where it is not `options.iteration_tol` that says so.
    """
    began, asked = perf_counter(), options
    stop, watches = watches_of(asked.until, asked.events)
    chosen = plan(system, rule)
    problem = initial_value_problem(system, chosen.rule, start, options)
    problem = problem if level is None else problem._replace(level=level)
    check_steps(problem.t0, problem.h, problem.steps)
    every, file = problem.save_every, None
    if asked.checkpoint is not None:
        from varint.integration.checkpoint import checkpoint_of

        words = dict(backend=asked.backend, on_failure=asked.on_failure)
        file = checkpoint_of(asked.checkpoint, system, chosen.rule, problem, stop, watches, **words)
    if system.structure.contacts and level is None:
        motion = _over_switches(system, chosen.rule, problem, asked, (stop, watches), began)
        if motion is not None:
            if alarm := energy_alarm(motion):
                warnings.warn(alarm, stacklevel=3)
            return motion
    if stop or watches:  # every node is looked at; those not asked for are dropped at the end
        problem = problem._replace(save_every=1)
    motion = None
    waits = asked.progress is None or asked.progress is False
    if waits and file is None and asked.on_failure == "raise":
        motion = short_run(system, chosen, problem, began, asked.backend, stop, watches)
    if motion is None:
        begin = partial(
            start_run,
            system,
            chosen,
            problem,
            began,
            backend=asked.backend,
            on_failure=asked.on_failure,
            file=file,
        )
        end = partial(
            collect,
            stop=stop,
            watches=watches,
            file=file,
            progress=asked.progress,
            on_failure=asked.on_failure,
        )
        try:
            motion = end(until_hard(begin()))
        except HardStep as step:
            motion = end(begin(by=step.kernel))
    if alarm := energy_alarm(motion) or false_speed(motion):
        warnings.warn(alarm, stacklevel=3)
    return motion if every == problem.save_every else subsample(motion, every)


def over_switches_after(
    failure: ConvergenceError,
    system: System,
    rule: Rule | None,
    start: Start,
    options: RunOptions,
) -> Trajectory:
    """The run again in steps of the given size that end at switches, too, where a step across one
    has no solution, as dry friction has none that holds a body.

    Raises
    ------
    ConvergenceError
        The failure, where the motion cannot be followed so.
    """
    began, motion = perf_counter(), None
    if not system.structure.contacts:  # beside contacts that has been tried
        rule = plan(system, rule).rule
        problem = initial_value_problem(system, rule, start, options)
        watched = watches_of(options.until, options.events)
        motion = _over_switches(system, rule, problem, options, watched, began)
    if motion is None:
        raise failure
    warnings.warn(
        f"the step after t = {failure.time:g} leads across a switch of the forces and has no "
        "solution: all steps end at switches now, which are nodes beside those of the grid "
        f"({motion.stats['switches']} switches); with duration= or tol= instead of h they always "
        "do",
        stacklevel=3,
    )
    return motion


def _over_switches(
    system: System,
    rule: Rule,
    problem: InitialValueProblem,
    asked: RunOptions,
    watched: tuple[Watch | None, list[Watch]],
    began: float,
) -> Trajectory | None:
    """The run of a scene whose steps end at switches; None where it has none, or cannot be followed
    over them.
    """
    from varint.integration.second_looks import has_switches

    if not has_switches(system):
        return None
    from varint.integration.switches.fixed_grid import switched_steps

    return switched_steps(system, rule, problem, asked, *watched, began)


def watches_of(until: Any, events: Any) -> tuple[Watch | None, list[Watch]]:
    """What is looked for on the way: `until`, and `events`."""
    if until is None and events is None:
        return None, []
    from varint.integration.events.crossings import parse_watch, parse_watches

    stop = None if until is None else parse_watch("until", until)
    return stop, parse_watches(events)

"""Runs whose number of steps is given: from checked input to the trajectory, watched on the way."""

from __future__ import annotations

import warnings
from functools import cache, partial
from time import perf_counter
from types import ModuleType
from typing import TYPE_CHECKING

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
    waits = asked.progress is None or asked.progress is False
    if waits and level is None and asked.backend == "auto":
        few = _few_steps().few_steps_call(system, rule, start, options, began)
        if few is not None:
            motion, quiet = few
            if not quiet and (alarm := energy_alarm(motion) or false_speed(motion)):
                warnings.warn(alarm, stacklevel=3)
            return motion
    stop, watches = watches_of(asked)
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
    if waits and not (stop or watches or file) and asked.on_failure == "raise":
        motion = short_run(system, chosen, problem, began, asked.backend)
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


def _over_switches(
    system: System,
    rule: Rule,
    problem: InitialValueProblem,
    asked: RunOptions,
    watched: tuple[Watch | None, list[Watch]],
    began: float,
) -> Trajectory | None:
    """The run of a scene with contacts whose steps end at switches; None where it has none, or
    cannot be followed over them.
    """
    from varint.integration.second_looks import has_switches

    if not has_switches(system):
        return None
    from varint.integration.switches.fixed_grid import switched_steps

    return switched_steps(system, rule, problem, asked, *watched, began)


def watches_of(asked: RunOptions) -> tuple[Watch | None, list[Watch]]:
    """What is looked for on the way: `until`, and `events`."""
    if asked.until is None and asked.events is None:
        return None, []
    from varint.integration.events.crossings import parse_watch, parse_watches

    stop = None if asked.until is None else parse_watch("until", asked.until)
    return stop, parse_watches(asked.events)


@cache
def _few_steps() -> ModuleType:
    """The module of runs of a few steps in C, which loads what a first run compiles with."""
    from varint.integration import few_steps

    return few_steps

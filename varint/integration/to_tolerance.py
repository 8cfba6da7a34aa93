"""Runs for a wanted accuracy: steps are chosen, then the run is done as it was asked for."""

from __future__ import annotations

import warnings
from time import perf_counter

import numpy as np

from varint.errors import InputError, parsed_or_refused
from varint.integration.energy_leap import energy_alarm
from varint.integration.events.crossings import parse_watch, parse_watches
from varint.integration.fixed_steps import simulate_steps
from varint.integration.plan import plan
from varint.integration.problem import RunOptions, Start, initial_value_problem
from varint.integration.tolerance import (
    choose_steps,
    iteration_level,
    problem_with_steps,
    with_estimate,
)
from varint.integration.trajectories import subsample
from varint.results.trajectory import Trajectory
from varint.rules.rule import Rule
from varint.scene.inputs import positive_integer
from varint.scene.system import System

DEFAULT_TOL = (
    1e-9  # of a duration alone, as users of every package for differential equations expect
)


def simulate_to_tolerance(
    system: System, rule: Rule | None, start: Start, options: RunOptions
) -> Trajectory:
    """`simulate` with a duration, and tol or nothing.

    Raises
    ------
    InputError
        If the input is not a well-posed problem.
    """
    began = perf_counter()
    if options.duration is None:
        raise InputError(
            "give duration (alone, or with tol: steps are chosen for that accuracy), or two of h, "
            "steps, duration"
        )
    tol = DEFAULT_TOL if options.tol is None else options.tol
    every = positive_integer("save_every", options.save_every)
    stop = None if options.until is None else parse_watch("until", options.until)
    watches = parse_watches(options.events)
    rows = _rows(system, start)
    whole = RunOptions(steps=rows, duration=options.duration)
    problem = initial_value_problem(system, plan(system, rule).rule, start, whole)
    choice = choose_steps(
        system, rule, problem, tol, stop=stop, scale=options.scale, backend=options.backend
    )
    if not watches and options.checkpoint is None and options.on_failure == "raise":
        motion = choice.motion
        if alarm := energy_alarm(motion):
            warnings.warn(alarm, stacklevel=3)
        motion = motion if every == 1 else subsample(motion, every)
    else:
        u = problem_with_steps(choice.rule, problem, choice.steps).u if rows > 1 else start.u
        motion = simulate_steps(
            system,
            choice.rule,
            start._replace(u=u),
            options._replace(steps=choice.steps),
            iteration_level(tol, choice.steps),
        )
    return with_estimate(motion, choice, tol, began)


def _rows(system: System, start: Start) -> int:
    """Steps for which a table of controls has values; 1 where they are the same all the time."""
    if start.u is None or not system.structure.controls:
        return 1
    table = parsed_or_refused(
        lambda: np.array(start.u, dtype=float),
        lambda: f"u must be numbers, got {type(start.u).__name__}",
    )
    one = table.ndim == 0 or table.shape == (system.structure.controls,)
    return 1 if one else len(table)

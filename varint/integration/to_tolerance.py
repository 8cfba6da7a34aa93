"""Runs for a wanted accuracy: steps are chosen, then the run is done as it was asked for."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from time import perf_counter
from typing import Any

from varint.errors import ConvergenceError, InputError
from varint.integration.backend import kernel_for
from varint.integration.choice import Choice
from varint.integration.cuts import cuts_of, meets_cut
from varint.integration.damped_end import damped_until
from varint.integration.energy_leap import energy_alarm, energy_leap
from varint.integration.fixed_steps import simulate_steps, watches_of
from varint.integration.no_farther import as_far_as_it_ends
from varint.integration.plan import plan
from varint.integration.problem import (
    LEVEL,
    InitialValueProblem,
    RunOptions,
    Start,
    check_on_failure,
    initial_value_problem,
)
from varint.integration.rule_choice import iteration_level
from varint.integration.run import looked_along
from varint.integration.run_distance import apart_from_proved
from varint.integration.second_looks import has_switches
from varint.integration.time_transformation.transformed_run import simulate_transformed
from varint.integration.time_transformation.variable_course import (
    choose_varying_steps,
    frequency_ahead,
    may_go_astray,
)
from varint.integration.time_transformation.varying_call import NOT_VARYING
from varint.integration.tolerance import DEFAULT_TOL, choose_steps, problem_with_steps
from varint.integration.trajectories import subsample, with_stats
from varint.integration.two_runs import shows_its_error
from varint.numerics.progress import notice
from varint.results.trajectory import Trajectory
from varint.rules.rule import Rule
from varint.scene.inputs import control_values, positive_integer
from varint.scene.system import System

ROUGH = 1e-3  # accuracy that shows whether a motion meets what jumps


def simulate_to_tolerance(
    system: System,
    rule: Rule | None,
    start: Start,
    options: RunOptions,
    tried: int | None,
    began: float,
) -> Trajectory:
    """`simulate` with a duration, and tol or nothing, where `short_call` has not found the motion
    and said no more than `tried`.

    Raises
    ------
    InputError
        If the input is not a well-posed problem.
    """
    if options.duration is None:
        raise InputError(
            "give duration (alone, or with tol: steps are chosen for that accuracy), or two of h, "
            "steps, duration"
        )
    check_on_failure(options.on_failure)
    options = options._replace(on_failure="raise")  # steps that are chosen are solved
    tol = DEFAULT_TOL if options.tol is None else options.tol
    every = positive_integer("save_every", options.save_every)
    stop, watches = watches_of(options.until, options.events)
    problem = whole_problem(system, plan(system, rule).rule, start, options.duration)
    rows = problem.steps

    def over_switches() -> Choice | None:
        from varint.integration.switches.switched_run import choose_switched_steps

        return choose_switched_steps(system, rule, problem, options, tol, stop, watches)

    switched = over_switches() if has_switches(system) else None
    if switched is not None:
        return with_estimate(switched.motion, switched, tol, began)
    looks = cuts_of(system) is not None and not has_switches(system)
    with notice(f"looking for the steps of tol={tol:g}", options.progress):

        def choose(problem: InitialValueProblem, options: RunOptions, tol: float = tol) -> Choice:
            ended = list[ConvergenceError]()

            def varying(astray: Trajectory | int | None = None) -> Choice | None:
                found = choose_varying_steps(system, rule, problem, start, options, tol, astray)
                if isinstance(found, ConvergenceError):
                    ended.append(found)
                    return None
                return found

            choice = None if tried == NOT_VARYING else varying()
            if choice is not None:
                return choice
            how: dict[str, Any] = {"stop": stop, "scale": options.scale, "backend": options.backend}
            follow = shows_its_error(system) and may_go_astray(system, rule)
            follow = follow and tried != NOT_VARYING
            known = None if tried == NOT_VARYING else tried
            how |= {"tried": known, "varying": varying, "follow": follow}
            ahead = frequency_ahead(system, rule, problem, start)
            how["grows"] = every == 1 and not watches
            try:
                return choose_steps(system, rule, problem, tol, **how, ahead=ahead)
            except ConvergenceError as error:  # told by the run that came farthest
                raise max([error, *ended], key=lambda x: abs(x.time - problem.t0)) from None

        if looks and _meets_cut_roughly(partial(choose, problem, options, max(tol, ROUGH))):
            switched, looks = over_switches(), False
            if switched is not None:
                return with_estimate(switched.motion, switched, tol, began)
        if stop is None or rows > 1:
            choice = choose(problem, options)
        else:
            by_dampers = system, rule, problem, tol, (stop, watches), options.backend
            found = damped_until(*by_dampers) if options.scale is None else None
            if found is not None:
                choice, watches = found, []  # looked for already
            else:
                choice, options = as_far_as_it_ends(system, rule, problem, options, choose)
    if looks and meets_cut(choice.motion) and (switched := over_switches()):
        return with_estimate(switched.motion, switched, tol, began)
    if watches and choice.motion.sizes is None:
        motion, choice = _watched(system, start, options, problem, choice, tol)
        return with_estimate(motion, choice, tol, began)
    motion = choice.motion
    if watches:  # found as without events, which are looked for along it
        kernel = kernel_for(system, choice.rule, problem, options.backend)
        motion = looked_along(motion, motion.v, kernel, None, watches)
    elif alarm := _alarm(choice, tol):
        warnings.warn(alarm, stacklevel=3)
    motion = motion if every == 1 else subsample(motion, every)
    return with_estimate(motion, choice, tol, began)


def _meets_cut_roughly(choose: Callable[[], Choice]) -> bool:
    """Whether an angle jumps on the way, as far as a rough motion tells: over a cut the accuracy
    that is asked for takes very many steps.
    """
    try:
        return meets_cut(choose().motion)
    except ConvergenceError:
        return False


def _alarm(choice: Choice, tol: float) -> str | None:
    """What is wrong with the energy of a run that is chosen."""
    if not choice.level:
        return energy_alarm(choice.motion, tol)
    leap = energy_leap(choice.motion, tol)
    return leap.alarm() if leap else None


def _watched(
    system: System,
    start: Start,
    options: RunOptions,
    problem: InitialValueProblem,
    choice: Choice,
    tol: float,
) -> tuple[Trajectory, Choice]:
    """The chosen run again with all that was asked of it. Iterations of the one that proved its
    error may have gone on for longer, for errors that grow: where a run without that is too far
    from it, they go on to round-off.
    """
    level = iteration_level(tol, choice.steps)
    if choice.reached:
        motion = _once_more(system, start, options, problem, choice, level)
        if motion.stats["interrupted"]:
            return motion, choice
        estimate = choice.estimate + apart_from_proved(motion, choice.motion, options.scale)
        if estimate <= tol:
            return motion, replace(choice, estimate=estimate)
    return _once_more(system, start, options, problem, choice, 0.0), choice


def _once_more(
    system: System,
    start: Start,
    options: RunOptions,
    problem: InitialValueProblem,
    choice: Choice,
    level: float,
) -> Trajectory:
    """The chosen run, whose iterations end at this level."""
    if choice.motion.fictitious is not None:
        h = choice.motion.fictitious.h
        asked = options._replace(h=h, steps=None, tol=None, iteration_tol=level / LEVEL or None)
        return simulate_transformed(system, choice.rule, choice.time_scale, start, asked)
    u = start.u
    if problem.steps > 1:
        u = problem_with_steps(choice.rule, problem, choice.steps).u
    asked = options._replace(steps=choice.steps)
    return simulate_steps(system, choice.rule, start._replace(u=u), asked, level)


def with_estimate(motion: Trajectory, choice: Choice, tol: float, began: float) -> Trajectory:
    """The motion with what is known of its error; a warning where that is more than tol."""
    if not choice.reached:
        warnings.warn(
            f"tol={tol:g} is out of reach: with more than {choice.steps} steps of {choice.rule} "
            f"the error is still estimated at {choice.estimate:.1e}. Round-off times the growth of "
            "errors (chaos), or a force that jumps or acts for less than a step, is the limit: "
            "take a shorter duration or a larger tol, or judge invariants and statistics",
            stacklevel=3,
        )
    return with_stats(
        motion,
        tol=tol,
        error_estimate=choice.estimate,
        rule=str(choice.rule),
        runs=choice.runs,
        seconds=perf_counter() - began,
    )


def whole_problem(system: System, rule: Rule, start: Start, duration: Any) -> InitialValueProblem:
    """Checked and completed input of a run of one step over the whole duration, or of a step for
    each row of a table of controls.
    """
    options = RunOptions(steps=_rows(system, start), duration=duration)
    return initial_value_problem(system, rule, start, options)


def _rows(system: System, start: Start) -> int:
    """Steps for which a table of controls has values; 1 where they are the same all the time."""
    if start.u is None or not system.structure.controls:
        return 1
    table = control_values(start.u)
    one = table.ndim == 0 or table.shape == (system.structure.controls,)
    return 1 if one else len(table)

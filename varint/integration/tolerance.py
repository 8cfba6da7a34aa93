"""Accuracy on demand: rule and steps for a wanted error of the motion.

The whole run is done with more and more steps, twice as many each time, until two runs agree; how
fast they come together says which order the motion really shows, be it the rule's or, where a force
jumps or a transient is stiff, a lower one. From there the number of steps for the wanted error
follows, and a last run is judged against the one before it by the order that was seen, never by one
that was assumed. What nodes do not show is looked at as well: the first steps, in which a transient
may pass, and forces that act for less than a step. Where the runs stop to come together, round-off,
chaos or the steps' number is the limit: the best run is returned with its honest estimate and a
warning.

Where the scene keeps its energy, two runs prove the error (`two_runs`); all this is for the rest.
"""

from __future__ import annotations

import math
import warnings
from contextlib import suppress
from time import perf_counter
from typing import TYPE_CHECKING, Any

import numpy as np

from varint.codegen.two_runs import NOT_SHORT, VARIES
from varint.errors import ConvergenceError, InputError
from varint.integration.backend import runs_by_stages
from varint.integration.choice import Choice
from varint.integration.cost import repays, rescues
from varint.integration.damped_trials import by_damped_trials
from varint.integration.failures import leap_over
from varint.integration.known_at_start import fastest_at_start, stiff_at_start
from varint.integration.linear_run import MAPPED, TURNS, is_one_map, runs_driven
from varint.integration.plain_trials import (
    NotPlain,
    by_plain_trials,
    has_plain_trials,
    plain_motion,
)
from varint.integration.plan import plan
from varint.integration.problem import InitialValueProblem
from varint.integration.refinement import Varying, refine
from varint.integration.round_off import with_other_digits, with_other_times
from varint.integration.rule_choice import (
    FEWEST,
    RADIANS,
    candidates,
    choose_rule,
    choose_rule_for_rows,
    iteration_level,
)
from varint.integration.run import collect, short_run, start_run
from varint.integration.second_looks import has_steps
from varint.integration.settled_run import LONG, SHORT, by_powers, settles_within
from varint.integration.short_refinement import by_short_refinement
from varint.integration.short_trials import by_short_trials
from varint.integration.small_motions import angles_turned, decay_rates
from varint.integration.table_trials import by_table_trials, controls_of_steps
from varint.integration.trajectories import Run
from varint.integration.two_runs import UNRESCUED, shows_its_error
from varint.integration.walls import Failure, at_one_time
from varint.integration.watched_trials import by_watched_trials
from varint.numerics.limits import check_steps
from varint.results.trajectory import Trajectory
from varint.rules.rule import Rule, gauss
from varint.scene.system import System

if TYPE_CHECKING:
    from varint.integration.events.crossings import Watch

LEAST_TOL, MOST_TOL = 1e-13, 0.1
# of a duration alone, as users of every package for differential equations expect
DEFAULT_TOL = 1e-9
FOLLOW = 3  # times the steps of a run: those that are likely to be made after it


def check_reach(tol: float) -> None:
    """Refuse a tolerance that no run can have, or is to have."""
    if not LEAST_TOL <= tol <= MOST_TOL:
        raise InputError(
            f"tol is the wanted error relative to the motion, between {LEAST_TOL:g} and "
            f"{MOST_TOL:g}; got {tol!r}"
        )


def rule_for(
    system: System,
    rule: Rule | None,
    start: InitialValueProblem,
    turned: tuple[float, float],
    tol: float,
    backend: str,
) -> Rule:
    """The rule that is asked for, or the one that is likely to be cheapest where the motion turns
    by so much, and what the first steps are for.
    """
    own, (radians, begin) = plan(system, rule).rule, turned
    if rule is not None or start.u.shape[1] > 1:
        return own
    by_stages = runs_by_stages(system, gauss(8), backend)
    compiled = backend == "compiled" or (
        backend == "auto" and not by_stages and repays(system, own, max(int(radians), 64))
    )
    rules = candidates(system, compiled, by_stages)
    own = choose_rule(rules, begin, tol)
    if start.steps > 1:  # of a table, in each of whose rows some steps are
        own = choose_rule_for_rows(rules, start.steps, begin, tol)
    once = (radians > TURNS and is_one_map(system, MAPPED)) or (
        backend == "auto" and runs_driven(system)
    )
    return MAPPED if once else own


def choose_steps(
    system: System,
    rule: Rule | None,
    start: InitialValueProblem,
    tol: float,
    *,
    stop: Watch | None = None,
    scale: Any = None,
    backend: str = "auto",
    tried: int | None = None,
    varying: Varying | None = None,
    follow: bool = False,
    ahead: float = 0.0,
    grows: bool = False,
) -> Choice:
    """Rule and number of steps with which every coordinate's error stays below tol times its scale.

    Parameters
    ----------
    system : System
    rule : Rule or None
        None: the one that is likely to be cheapest.
    start : InitialValueProblem
        Of one step over the whole duration, or of a table of controls.
    tol : float
    stop : Watch, optional
        Where the run ends.
    scale : float or array (n,), optional
        See `error_scales`.
    backend : str
    tried : int, optional
        What `by_short_trials` would say: NOT_PROVED or NOT_SHORT.
    varying : callable, optional
        The choice with steps that follow the scene, where a run that went astray asks for them.
    follow : bool, optional
        Whether short ones may.
    ahead : float, optional
        Frequency of a motion whose first steps suit this one, by what is seen ahead.
    grows : bool, optional
        Whether steps may differ where no stiff dampers stop something: nothing but its nodes is
        asked for.

    Raises
    ------
    InputError
        If tol is out of range, or no number of steps leads through the whole duration.
    ConvergenceError
        If the motion ends before, whatever the steps.
    """
    check_reach(tol)
    began, own = perf_counter(), plan(system, rule).rule
    check_steps(start.t0, start.h * start.steps, 1)
    fastest, mass = fastest_at_start(system, own, start)
    turned = radians, begin = angles_turned(start.h * start.steps, fastest, ahead)
    by_rows = start.steps > 1 and stop is None and scale is None and tried is None
    if by_rows and mass is not None and backend != "interpreted":
        tables = system, rule, start, mass, tol, radians, backend, began
        if (shown := by_table_trials(*tables)) is not None:
            return shown

    alone = tried is None and scale is None and stop is None and start.steps == 1
    if alone:
        dampers = system, rule, start, tol, radians, backend, began
        if (damped := by_damped_trials(*dampers)) is not None:
            return damped
    own = rule_for(system, rule, start, turned, tol, backend)
    plainly = backend == "auto" and grows and stop is None and start.steps == 1

    def may_settle(least: tuple[float, float]) -> bool:
        return plainly and own == MAPPED and settles_within(system, start.c, start.h, least)

    if may_settle(LONG):
        settled = by_powers(system, start, tol, scale, began)
        if settled is not None:
            return settled
    mapped = backend == "auto" and radians > TURNS and is_one_map(system, own)

    found: Choice | int | None
    by_two_runs = start.steps == 1 and shows_its_error(system)
    plain = by_two_runs and stop is None and has_plain_trials(system, start)
    with_map = MAPPED if rule is None else own
    one_map = tried is None and backend == "auto" and is_one_map(system, with_map)
    if plain and scale is None and mass is not None and one_map:
        found = by_short_trials(system, with_map, start, mass, tol, turned, backend, began)
        if isinstance(found, Choice):
            return found
    if plain and scale is None and mass is not None and not mapped:
        found = tried
        if tried is None:
            short = system, own, start, mass, tol, turned, backend, began
            found = by_short_trials(*short, follow)
            if varying and isinstance(found, int) and found >= VARIES:
                found = varying(found - VARIES) or by_short_trials(*short)
        if isinstance(found, Choice):
            return found
        plain = by_two_runs = found == NOT_SHORT
    if plain:
        with suppress(NotPlain):
            proved = by_plain_trials(system, own, start, tol, turned, scale, backend)
            if proved is not None:
                motion, estimate = plain_motion(system, own, proved.run, began), proved.estimate
                reached = estimate <= tol
                return Choice(own, proved.steps, motion, estimate, proved.runs, reached, True)
            by_two_runs = False

    forced = not shows_its_error(system) and not has_steps(system)
    if forced and stop is None and has_plain_trials(system, start):
        found = tried
        if tried is None and scale is None and mass is not None:
            trials = system, own, start, mass, tol, turned, backend, began
            found = by_short_trials(*trials, grows=grows)
        if isinstance(found, Choice):
            return found
        asked = system, own, start, tol, radians, scale, backend, began, varying
        again = found is None or found == NOT_SHORT
        powers = may_settle(SHORT)
        if again and powers:  # steps that the map does are over before
            found = by_short_refinement(*asked, by_map=True)
        if powers and not isinstance(found, Choice):
            found = by_powers(system, start, tol, scale, began)
        if again and not isinstance(found, Choice):
            found = by_short_refinement(*asked)
        if isinstance(found, Choice):
            return found

    failures: list[Failure] = []  # since the last run that ended well
    smooth = shows_its_error(system) and not has_steps(system)
    first_order = system.structure.degenerate  # as in `by_short_refinement`
    stiff = 0.0 if smooth else stiff_at_start(system, own, start, radians)
    unproved = False  # by two runs: errors may grow, also what iterations leave

    def attempt(
        chosen: Rule,
        steps: int,
        part: int = 1,
        wanted: float = tol,
        beyond: float = 0.0,
        digits: int | None = None,
        node: tuple[np.ndarray, np.ndarray, float] | None = None,
        count: int = 0,
    ) -> tuple[Trajectory, Run | None] | None:
        """A motion, and the run that made it where it was not over at once."""
        nonlocal stiff
        problem = problem_with_steps(chosen, start, steps)
        if digits is not None:
            q0, p0 = with_other_digits(start.q0, start.p0, digits)
            h = with_other_times(problem.h, digits)
            problem = problem._replace(q0=q0, p0=p0, h=h)
        if node is not None:  # so many of the steps, from a node (q, p, t) of another run
            q0, p0, t0 = node
            problem = problem._replace(q0=q0, p0=p0, t0=t0, steps=count, u=problem.u[:count])
        problem = problem._replace(
            h=problem.h * (1 + beyond / steps) if beyond else problem.h,
            level=0.0 if unproved or first_order else iteration_level(wanted, steps),
            steps=max(problem.steps // part, 1),
            rescued=(steps < stiff or steps > UNRESCUED) and rescues(system, chosen, steps),
            ahead=FOLLOW * steps,
        )
        try:
            way = plan(system, chosen)
            motion, run = short_run(system, way, problem, began, backend, stop), None
            if motion is None:
                run = start_run(system, way, problem, began, backend=backend)
                motion = collect(run, stop=stop, progress=False)
                if motion.stats["interrupted"]:  # no part of a run says what a whole one errs by
                    raise KeyboardInterrupt
        except ConvergenceError as error:
            failures.append((steps, error))
            if not smooth and error.trajectory is not None:
                decays = decay_rates(error.trajectory[-1:]) * abs(start.h * start.steps)
                stiff = max(stiff, decays.max(initial=0.0))
            return None
        if smooth and failures:
            if leapt := leap_over(motion, failures[-1]):
                failures.append((steps, leapt))
                return None
            if at_one_time(failures, start.h * start.steps):
                return motion, run
        failures.clear()
        return motion, run

    def trial(chosen: Rule, steps: int, *how: Any, **more: Any) -> Trajectory | None:
        found = attempt(chosen, steps, *how, **more)
        return None if found is None else found[0]

    first = max(FEWEST, math.ceil(begin / RADIANS)) / start.steps  # in a row of a table
    first = 2 ** math.ceil(math.log2(max(first, 1.0)))
    with np.errstate(all="ignore"), warnings.catch_warnings():  # of steps that are too large
        warnings.simplefilter("ignore")
        if by_two_runs:
            found = by_watched_trials(system, own, tol, turned, attempt, scale, stop is not None)
            if found:
                return found
        failures.clear()
        unproved = start.steps == 1 and shows_its_error(system)
        few, ends_early = start.steps * first, stop is not None
        search = system, own, start, tol, radians, trial, failures, few, scale, ends_early
        return refine(*search, varying)


def problem_with_steps(rule: Rule, start: InitialValueProblem, steps: int) -> InitialValueProblem:
    """The same problem in so many steps; controls are those of the table, or of its one row."""
    h, u = start.h * start.steps / steps, start.u
    if not u.size:
        u = np.empty((steps, *u.shape[1:]))
    elif start.steps == 1 and u.shape[1] == 1:
        u = np.broadcast_to(u, (steps, *u.shape[1:]))
    else:
        u = controls_of_steps(rule, u, steps)
    return start._replace(h=h, steps=steps, save_every=1, u=u, nodes=len(rule.nodes))

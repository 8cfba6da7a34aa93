"""The way from start to start until a solver finds an optimal control."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np

from varint.control.build import build_control_solver
from varint.control.guess import build_start
from varint.control.neighbours import WAYS_AROUND, cheapest_neighbour, has_many_minima
from varint.control.outcome import FEASIBLE, has_converged, raise_unless_converged
from varint.control.problem import ControlProblem
from varint.control.starts import (
    default_starts,
    is_nearly_a_motion,
    must_go_around,
    without_guesses,
)
from varint.control.trajectories import build_trajectories
from varint.control.warm_start import carry_multipliers
from varint.nlp.options import MOST_ITERATIONS
from varint.nlp.solver import SolverResult
from varint.results.trajectory import Trajectory

if TYPE_CHECKING:
    from varint.control.coarse import RoughStart
    from varint.control.contradiction import Contradiction

# (iteration, cost, violation, paths) → true to stop
Callback = Callable[[int, float, float, list[Trajectory]], Any]
# iterations without getting closer to what is asked for, as in a long restoration: another default
# guess is tried
PATIENCE = 50
OTHER = 1  # seed of neighbours where ways around have been tried: not the same ones again
ROUGHLY = "by a rough solution near the guess"
IN_VAIN = "by rough solutions, of which there is none"
DRAWN = 150  # the same from a rough solution near a path that the user has drawn
# ends of a solver that has met no motion which keeps all conditions
UNMET = (
    "Infeasible_Problem_Detected",
    "Restoration_Failed",
    "Error_In_Step_Computation",
    "Not_Enough_Degrees_Of_Freedom",
)


def solve(
    problem: ControlProblem,
    name: str,
    options: Mapping[str, Any] | None,
    progress: bool | None,
    callback: Callback | None = None,
) -> list[Trajectory]:
    """Build the solver, solve from the guess or from one default guess after the other, judge the
    end.
    """
    starts, around = default_starts(problem), must_go_around(problem)
    x = next(starts)
    # a way around is a guess at sizes, of controls that brake and turn for nothing
    solver = build_control_solver(problem, build_start(problem) if around else x, name, options)
    problem = replace(problem, solver=solver, again=_prepared_from)
    tell = _teller(problem, callback)
    run = partial(solver, progress=progress, callback=tell)
    multipliers = carry_multipliers(problem)
    if multipliers is not None:
        outcome = run(x, multipliers)
        if outcome.success or outcome.stopped:
            return raise_unless_converged(problem, outcome)
        # multipliers of another problem can mislead
    guesses = [part.phase.guess for part in problem.phases]
    known = all(isinstance(guess, Trajectory) for guess in guesses)
    if all(isinstance(guess, Mapping) for guess in guesses):
        return _from_path(problem, run, x, progress)
    first = outcome = run(x, patience=np.inf if known else PATIENCE)
    while not has_converged(outcome) and not outcome.stopped:
        other = next(starts, None)
        if other is None:  # a start that was given up may have needed more than that
            outcome = run(x) if first.gave_up else first
            break
        outcome = run(other, patience=PATIENCE)
    several = around or (outcome is first and has_many_minima(problem))
    if name == "ipopt" and has_converged(outcome) and several:
        more = (WAYS_AROUND, OTHER) if around else ()
        outcome, costs = cheapest_neighbour(problem, run, x, outcome, tell, *more)
        found = raise_unless_converged(problem, outcome)
        return [replace(x, stats=MappingProxyType({**x.stats, "starts": costs})) for x in found]
    if _unmet(outcome):
        nearest = _least_violation(problem, outcome)
        if nearest is None or nearest.broken:
            return raise_unless_converged(problem, outcome, nearest)
        feasible = np.clip(nearest.x, problem.nlp.x_low, problem.nlp.x_high)
        again = run(feasible)
        outcome = again if has_converged(again) or again.stopped else outcome
    return raise_unless_converged(problem, outcome)


def _from_path(
    problem: ControlProblem,
    run: Callable[..., SolverResult],
    x: np.ndarray,
    progress: bool | None,
) -> list[Trajectory]:
    """From a path that the user has drawn: by rough solutions near it, and at once (first, if it is
    nearly a motion), from the default starts, and then from the path with all the time that it
    wants. Where no rough solution was found none is looked for by another rule. The trajectories
    tell the attempts and their iterations where the first one failed.
    """
    from varint.control.coarse import coarse_start
    from varint.control.lifted import lifted_start

    tries: list[tuple[str, int]] = []

    def attempt(what: str, start: np.ndarray, patience: float, before: int = 0) -> SolverResult:
        outcome = run(start, patience=patience)
        tries.append((what, before + outcome.iterations))
        return outcome

    def directly() -> SolverResult | None:
        return attempt("from the guess", x, PATIENCE)

    def roughly(rough_start: Callable[..., RoughStart]) -> SolverResult | None:
        rough = rough_start(problem, progress)
        if rough.stopped:
            return run(rough.x, callback=lambda _: True)
        if rough.x is not None:
            return attempt(ROUGHLY, rough.x, DRAWN, rough.iterations)
        if rough.iterations:
            tries.append((IN_VAIN, rough.iterations))
        return None

    def by_one_rule() -> SolverResult | None:
        in_vain = any(what == IN_VAIN for what, _ in tries)
        return None if in_vain else roughly(coarse_start)

    def by_default() -> SolverResult | None:
        outcome = None
        for start in default_starts(without_guesses(problem)):
            outcome = attempt("from a default start, for the guess led nowhere", start, PATIENCE)
            if _is_over(outcome):
                break
        return outcome

    def patiently() -> SolverResult | None:
        return attempt("from the guess, with patience", x, np.inf)

    lifted = partial(roughly, lifted_start)
    first = (directly, lifted) if is_nearly_a_motion(problem, x) else (lifted, directly)
    for way in (*first, by_one_rule, by_default, patiently):
        outcome = way()
        if outcome is not None and _is_over(outcome):
            break
    assert outcome is not None  # the last way has one
    nearest = _least_violation(problem, outcome) if _unmet(outcome) else None
    found = raise_unless_converged(problem, outcome, nearest)
    note = {"attempts": tuple(tries)} | ({"start": tries[-1][0]} if len(tries) > 1 else {})
    return [replace(y, stats=MappingProxyType({**y.stats, **note})) for y in found]


def _is_over(outcome: SolverResult) -> bool:
    return has_converged(outcome) or outcome.stopped


def _unmet(outcome: SolverResult) -> bool:
    """Did it end without a motion that keeps all conditions, or go on without one as long as
    solvers may unless told otherwise?
    """
    for_ever = outcome.violation > FEASIBLE and outcome.iterations >= MOST_ITERATIONS
    return not _is_over(outcome) and (outcome.status in UNMET or for_ever)


def _prepared_from(motion: Trajectory, problem: ControlProblem) -> Callable[..., Any]:
    from varint.control.prepared import prepared_from

    return prepared_from(motion, problem)


def _least_violation(problem: ControlProblem, outcome: SolverResult) -> Contradiction | None:
    from varint.control.contradiction import least_violation

    return least_violation(problem, outcome)


def _teller(
    problem: ControlProblem, callback: Callback | None
) -> Callable[[SolverResult], Any] | None:
    """The callback of the solver that makes trajectories for the user's."""
    if callback is None:
        return None

    def tell(iterate: SolverResult) -> Any:
        paths = build_trajectories(problem, iterate)
        return callback(iterate.iterations, iterate.cost, iterate.violation, paths)

    return tell

"""How a solver ended: trajectories, or an error in words."""

from __future__ import annotations

import warnings
from typing import TYPE_CHECKING

from varint.control.kinks import kinks_in_words
from varint.control.problem import ControlProblem
from varint.control.trajectories import build_trajectories
from varint.errors import SolverError
from varint.nlp.options import WORDS
from varint.nlp.solver import SolverResult
from varint.results.trajectory import Trajectory

if TYPE_CHECKING:
    from varint.control.contradiction import Contradiction

FEASIBLE = 1e-6  # a row or bound violated by more is violated


def has_converged(outcome: SolverResult) -> bool:
    """Did the solver succeed, and do all conditions hold?"""
    return outcome.success and outcome.violation <= FEASIBLE


def raise_unless_converged(
    problem: ControlProblem, outcome: SolverResult, nearest: Contradiction | None = None
) -> list[Trajectory]:
    """The trajectories, or an error in words: those of the conditions that contradict each other
    where they are known.
    """
    found = build_trajectories(problem, outcome)
    if outcome.stopped:
        warnings.warn(
            f"stopped on request after {len(outcome.history.get('cost', ()))} iterations",
            stacklevel=4,
        )
        return found
    if has_converged(outcome):
        return found
    status = outcome.status.removeprefix("EXIT: ")
    words = WORDS.get(status, "no solution was found from this guess")
    if nearest is not None and nearest.broken:
        words = f"{_against(problem)}: {nearest}. Relax one"
        words += _another_duration(problem)
    if kinks := kinks_in_words([part.phase for part in problem.phases]):
        words += f". {kinks}"
    raise SolverError(
        f"{status}: {words}. Largest violation of a condition: {outcome.violation:.1e}; "
        "error.iterate is the last iterate",
        status=status,
        iterate=found[0] if len(found) == 1 else found,
        contradiction=nearest,
    )


def _against(problem: ControlProblem) -> str:
    """Conditions that no motion keeps, or none near the guess where the duration is free."""
    if _guessed_durations(problem):
        return "no motion that keeps all conditions was found near this guess"
    return "the conditions contradict each other near the last iterate"


def _another_duration(problem: ControlProblem) -> str:
    guessed = " and ".join(f"{x:.6g}" for x in _guessed_durations(problem))
    return f", or try another guess of the duration, here {guessed}" if guessed else ""


def _guessed_durations(problem: ControlProblem) -> list[float]:
    phases = [part.phase for part in problem.phases]
    return [x.duration[0] for x in phases if x.free_duration]

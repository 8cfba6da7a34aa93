"""A problem that is built once and solved again with other numbers, warm from what is known."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from varint.control.build import build_control_solver
from varint.control.guess import build_start
from varint.control.links import Link, default_links
from varint.control.numbers import with_numbers
from varint.control.outcome import has_converged, raise_unless_converged
from varint.control.phase import Phase
from varint.control.problem import ControlProblem, transcribe
from varint.control.solution import ControlSolution
from varint.control.starts import default_starts
from varint.control.trajectories import build_trajectories
from varint.control.transcription import PhaseTranscription
from varint.errors import InputError
from varint.nlp.solver import Solver, SolverResult, choose_backend
from varint.results.trajectory import Trajectory
from varint.scene.parameters import ParameterValues
from varint.scene.travel import itself, stays

SOLVES = 100  # of a prepared problem, about: what compiling its kernels is weighed against


@dataclass(frozen=True, eq=False)
class Prepared:
    """An optimal control problem that is built; call it with the numbers that change.

    Attributes
    ----------
    problem : ControlProblem
    solver : Solver
    guess : list of Trajectory or None
        Where it starts if nothing else is said, one a phase.
    several : bool
        Does it return a list, one trajectory a phase?
    """

    problem: ControlProblem
    solver: Solver
    guess: Sequence[Trajectory] | None = None
    several: bool = False

    __reduce__ = stays("a prepared problem")
    __copy__ = __deepcopy__ = itself

    def __repr__(self) -> str:
        phases = (part.phase for part in self.problem.phases)
        meshes = ", ".join(f"{phase.rule!r} × {phase.steps}" for phase in phases)
        return f"Prepared({meshes}, {self.problem.unknowns} unknowns)"

    def __call__(
        self,
        *,
        start: Mapping[str, Any] | None = None,
        end: Mapping[str, Any] | None = None,
        params: ParameterValues | None = None,
        duration: float | None = None,
        t0: float | None = None,
        guess: Any = None,
        phases: Mapping[int, Mapping[str, Any]] | None = None,
    ) -> Any:
        """Solve with these numbers, warm where `guess` is a solution of this problem.

        Parameters
        ----------
        start, end : dict, optional
            As for `optimal_control`; what is not named keeps its numbers. What was given stays
            given, and what was free stays free. Of several phases: the start of the first, the end
            of the last.
        params : dict, optional
            Values of parameters by name or symbol, in all phases that have them.
        duration, t0 : float, optional
            Where the duration is not free, and the start time.
        guess : Trajectory or dict, or a list of them, optional
            As for `optimal_control`, one a phase.
        phases : dict, optional
            Numbers of single phases, ``{1: dict(duration=0.3, end=…)}``.

        Returns
        -------
        Trajectory, or a list of them
            A list, one a phase, where the problem was given as a list or came from
            `optimal_phases` with several.

        Raises
        ------
        InputError
            If the numbers do not belong to this problem.
        SolverError
            If no solution is found.
        """
        problem = with_numbers(self.problem, start, end, params, duration, t0, phases)
        guesses, outcome = self.guess if guess is None else self._guesses(guess), None
        if guesses is not None:
            parts = [_guessed(part, one) for part, one in zip(problem.phases, guesses, strict=True)]
            problem = replace(problem, phases=parts)
            known = _known(guesses)
            if known is not None and len(known.x) == problem.unknowns:
                outcome = self._run(problem, known.x, (known.lam_x, known.lam_g))
        starts = default_starts(problem)
        while outcome is None or not (has_converged(outcome) or outcome.stopped):
            x = next(starts, None)
            if x is None:
                break
            outcome = self._run(problem, x)
        assert outcome is not None
        found = raise_unless_converged(problem, outcome)
        return found if self.several else found[0]

    def _guesses(self, given: Any) -> list[Any]:
        """One guess a phase."""
        guesses = list(given) if self.several and isinstance(given, Sequence) else [given]
        if len(guesses) != len(self.problem.phases):
            raise InputError(
                f"guess must be a list with one for each of the {len(self.problem.phases)} phases, "
                f"got {given!r}"
            )
        return guesses

    def _run(
        self,
        problem: ControlProblem,
        x: np.ndarray,
        multipliers: tuple[np.ndarray, np.ndarray] | None = None,
    ) -> SolverResult:
        nlp = problem.nlp
        return self.solver(
            np.clip(x, nlp.x_low, nlp.x_high),
            multipliers,
            x_low=nlp.x_low,
            x_high=nlp.x_high,
            g_low=nlp.g_low,
            g_high=nlp.g_high,
            p=nlp.p,
            progress=False,
        )


def prepare(
    phase: Phase | Sequence[Phase],
    links: Sequence[Link] | None = None,
    *,
    t0: float = 0.0,
    solver: str = "ipopt",
    options: Mapping[str, Any] | None = None,
    backend: str = "auto",
) -> Prepared:
    """A problem built once, to be solved with other ends, durations and parameters.

    Parameters
    ----------
    phase : Phase or list of Phase
        The problem, as for `optimal_phases`.
    links : sequence of Link, optional
        As for `optimal_phases`.
    t0, solver, options, backend
        As in `optimal_control`.

    Returns
    -------
    Prepared
        Call it with what changes: ``start=``, ``end=``, ``params=``, ``duration=``, ``t0=``; with
        ``guess=`` an earlier answer it starts warm.

    Raises
    ------
    InputError
        If the problem is not well posed.

    Examples
    --------
    >>> import casadi as ca
    >>> import varint as vi
    >>> q, v = vi.coordinates("x")
    >>> force = ca.SX.sym("force")
    >>> cart = vi.System(q, v, v**2 / 2, force=force, control=force)
    >>> transfer = vi.prepare(vi.Phase(
    ...     cart, vi.gauss(2), 1.0, 5, force**2, start=dict(q=[0], v=[0]), end=dict(q=[1], v=[0])))
    >>> first = transfer()
    >>> further = transfer(end=dict(q=[2]), guess=first)
    >>> round(first.cost, 6), round(further.cost, 6)
    (12.0, 48.0)
    """
    phases = [phase] if isinstance(phase, Phase) else phase
    if not isinstance(phases, Sequence) or not all(isinstance(x, Phase) for x in phases):
        raise InputError(f"prepare takes a varint.Phase or a list of them, got {phase!r}")
    if not phases:
        raise InputError("prepare takes a varint.Phase or a list of them, at least one")
    ties = default_links(len(phases)) if links is None else links
    problem = transcribe(phases, ties, t0, choose_backend(solver, backend), SOLVES)
    run = build_control_solver(problem, build_start(problem), solver, options)
    several = not isinstance(phase, Phase)
    return Prepared(replace(problem, solver=run, again=prepared_from), run, None, several)


def prepared_from(motion: Trajectory, problem: ControlProblem) -> Prepared:
    """The problem of an optimal control with its solver, and the motions of all its phases as their
    guesses.
    """
    assert problem.solver is not None
    several = len(problem.phases) > 1
    known = _known([motion])
    guess = [motion] if not several or known is None else build_trajectories(problem, known)
    return Prepared(problem, problem.solver, guess, several)


def _guessed(part: PhaseTranscription, guess: Any) -> PhaseTranscription:
    given = replace(part.phase.given, guess=guess)
    return replace(part, phase=replace(part.phase, guess=guess, given=given))


def _known(guesses: Sequence[Any]) -> SolverResult | None:
    """The solver's own numbers of an earlier solution of this run, that all phases belong to."""
    solutions = [x.solution if isinstance(x, Trajectory) else None for x in guesses]
    origins = [x.origin if isinstance(x, ControlSolution) else None for x in solutions]
    outcomes = [x.outcome for x in origins if x is not None]
    same = len(outcomes) == len(guesses) and all(x is outcomes[0] for x in outcomes)
    return outcomes[0] if same else None

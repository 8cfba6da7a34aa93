"""A problem that is built once and solved again with other numbers, warm from what is known."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from varint.control.build import build_control_solver
from varint.control.guess import build_start
from varint.control.numbers import with_numbers
from varint.control.outcome import has_converged, raise_unless_converged
from varint.control.phase import Phase
from varint.control.problem import ControlProblem, transcribe
from varint.control.solution import ControlSolution
from varint.control.starts import default_starts
from varint.errors import InputError
from varint.nlp.solver import Solver, SolverResult, choose_backend
from varint.results.trajectory import Trajectory
from varint.scene.parameters import ParameterValues

SOLVES = 100  # of a prepared problem, about: what compiling its kernels is weighed against


@dataclass(frozen=True, eq=False)
class Prepared:
    """An optimal control problem that is built; call it with the numbers that change.

    Attributes
    ----------
    problem : ControlProblem
    solver : Solver
    guess : Trajectory or None
        Where it starts if nothing else is said.
    """

    problem: ControlProblem
    solver: Solver
    guess: Trajectory | None = None

    def __call__(
        self,
        *,
        start: Mapping[str, Any] | None = None,
        end: Mapping[str, Any] | None = None,
        params: ParameterValues | None = None,
        duration: float | None = None,
        t0: float | None = None,
        guess: Any = None,
    ) -> Trajectory:
        """Solve with these numbers, warm where `guess` is a solution of this problem.

        Parameters
        ----------
        start, end : dict, optional
            As for `optimal_control`; what is not named keeps its numbers. What was given stays
            given, and what was free stays free.
        params : dict, optional
            Values of parameters by name or symbol.
        duration, t0 : float, optional
            Where the duration is not free, and the start time.
        guess : Trajectory or dict, optional
            As for `optimal_control`.

        Returns
        -------
        Trajectory

        Raises
        ------
        InputError
            If the numbers do not belong to this problem.
        SolverError
            If no solution is found.
        """
        problem = with_numbers(self.problem, start, end, params, duration, t0)
        guess, outcome = self.guess if guess is None else guess, None
        if guess is not None:
            part = problem.phases[0]
            given = replace(part.phase.given, guess=guess)
            phase = replace(part.phase, guess=guess, given=given)
            problem = replace(problem, phases=[replace(part, phase=phase)])
            known = _known(guess)
            if known is not None and len(known.x) == problem.unknowns:
                outcome = self._run(problem, known.x, (known.lam_x, known.lam_g))
        starts = default_starts(problem)
        while outcome is None or not (has_converged(outcome) or outcome.stopped):
            x = next(starts, None)
            if x is None:
                break
            outcome = self._run(problem, x)
        assert outcome is not None
        return raise_unless_converged(problem, outcome)[0]

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
    phase: Phase,
    *,
    t0: float = 0.0,
    solver: str = "ipopt",
    options: Mapping[str, Any] | None = None,
    backend: str = "auto",
) -> Prepared:
    """A problem built once, to be solved with other ends, durations and parameters.

    Parameters
    ----------
    phase : Phase
        The problem, as for `optimal_phases`.
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
    if not isinstance(phase, Phase):
        raise InputError(f"prepare takes a varint.Phase, got {type(phase).__name__}")
    problem = transcribe([phase], [], t0, choose_backend(solver, backend), SOLVES)
    run = build_control_solver(problem, build_start(problem), solver, options)
    return Prepared(replace(problem, solver=run, again=prepared_from), run)


def prepared_from(motion: Trajectory, problem: ControlProblem) -> Prepared:
    """The problem of an optimal control with its solver, and the motion as its guess."""
    if len(problem.phases) != 1:
        raise InputError(
            "again() is for problems of one phase; solve several with optimal_phases, each phase "
            "with its guess="
        )
    assert problem.solver is not None
    return Prepared(problem, problem.solver, motion)


def _known(guess: Any) -> SolverResult | None:
    """The solver's own numbers of an earlier solution of this run."""
    found = guess.solution if isinstance(guess, Trajectory) else None
    return (
        found.origin.outcome
        if isinstance(found, ControlSolution) and found.origin is not None
        else None
    )

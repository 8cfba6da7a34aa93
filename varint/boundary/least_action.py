"""The verb for paths: between fixed end points, closed, of given energy, as a minimum under bounds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from time import perf_counter
from types import NoneType
from typing import Any

import numpy as np

from varint.boundary.minimise import minimised
from varint.boundary.newton import Outcome, newton
from varint.boundary.posing import posed
from varint.boundary.result import conjugate_ends, path_of
from varint.boundary.stationary import Iterate, Problem, with_duration
from varint.errors import InputError, SolverError
from varint.horizon import Free
from varint.rules import Rule, gauss
from varint.system import System
from varint.trajectory import Trajectory

SHORTEST = 1024  # continuation begins at this part of the duration at the latest
SMALLEST_GROWTH = 1.002
MOST_STAGES = 100


def least_action(
    system: System,
    rule: Rule | None = None,
    *,
    q_start: Any = None,
    q_end: Any = None,
    duration: float | Free | None = None,
    steps: int,
    t0: float = 0.0,
    guess: Any = None,
    u: Any = None,
    params: Mapping[str, Any] | None = None,
    bounds: Sequence[tuple[Any, Any, Any]] | None = None,
    periodic: bool = False,
    symmetry: Any = None,
    energy: float | None = None,
) -> Trajectory:
    """Path of stationary action, ∂S_d/∂q_k = D2 L_d(q_{k−1}, q_k) + D1 L_d(q_k, q_{k+1}) = 0 with the ends given.

    The action of a path is stationary, not always least: `Trajectory.morse_index` counts the directions in which it is
    a maximum, `Trajectory.conjugate_times` say when they arise. It is minimised (by Ipopt) only where there are
    `bounds` or the duration has bounds of its own.

    Parameters
    ----------
    system : System
    rule : Rule, optional
        Default: the scene's own, or `gauss(2)` where that has no path between its nodes and the action is minimised.
    q_start, q_end : array (n,)
        End points; both are left out for periodic paths.
    duration : float or Free
        Time from start to end. ``free(guess, lower, upper)``: the action is least with respect to the duration as well
        (least time, where S is the time); with `energy`, no more than a guess and a check of the result.
    steps : int
        Number of steps.
    t0 : float
        Start time.
    guess : array (k, n) or Trajectory, optional
        Configurations at equally spaced times, the first and last at the ends. Default: the straight line. A periodic
        path needs a guess.
    u : array (steps, k) or (steps, r, k) or (k,), optional
        Controls, as for `simulate`.
    params : dict, optional
        Parameter values that differ from the defaults.
    bounds : sequence of (lower, expression, upper), optional
        Inequalities on q, t and the parameters at every control point; the action is then minimised.
    periodic : bool
        The path closes, q(T) = S q(0) + b and p(0) = Sᵀ p(T).
    symmetry : array (n, n) or (n, n + 1), optional
        S, or [S | b], of a periodic path; default the identity.
    energy : float, optional
        Energy of the path; the duration is then found (Maupertuis and Jacobi).

    Returns
    -------
    Trajectory
        With forces it is the path of the Lagrange–d'Alembert principle. Started from its first q and p, `simulate`
        reproduces it to round-off. With bounds, `solution` tells where the path leans on them (`Contacts`).

    Raises
    ------
    InputError
        If the input is not a well-posed problem; the message says what to change.
    SolverError
        If no path was found; `iterate` is the last one tried. Another `guess` or more steps may help.

    Examples
    --------
    >>> import varint as vi
    >>> q, v = vi.coordinates("x")
    >>> oscillator = vi.System(q, v, (v**2 - q**2) / 2)
    >>> path = vi.least_action(oscillator, vi.gauss(4), q_start=0.0, q_end=1.0, duration=4.0, steps=20)
    >>> path.morse_index, path.conjugate_times.round(6)
    (1, array([3.141593]))
    """
    began = perf_counter()
    if not isinstance(bounds, (Sequence, NoneType)):
        raise InputError(f"bounds must be a list of (lower, expression, upper), got {type(bounds).__name__}")
    minimise = bool(bounds) or (isinstance(duration, Free) and energy is None)
    if rule is None and minimise and not system.structure.constraints:
        rule = gauss(2)  # a composition has no path between its nodes to bound
    problem, iterate, window = posed(
        system, rule, q_start=q_start, q_end=q_end, duration=duration, steps=steps, t0=t0, guess=guess, u=u,
        params=params, periodic=periodic, symmetry=symmetry, energy=energy,
    )  # fmt: skip
    if minimise:
        return minimised(problem, iterate, window, bounds or [], began)
    outcome = found(problem, iterate)
    path = path_of(problem, outcome, began)
    if (outcome.solved or system.structure.linear) and conjugate_ends(problem, outcome, path):
        raise SolverError(
            f"the end is conjugate to the start at t = {path.t[-1]:g}: no path or a whole family of paths joins them; "
            "change the duration or the end points a little",
            status="conjugate end points", iterate=path,
        )  # fmt: skip
    if not outcome.solved:
        raise SolverError(
            f"no path was found: Newton's method ended after {outcome.iterations} iterations with {outcome.status} "
            f"(last correction {outcome.correction:.1e} of the path, residual {outcome.residual:.1e} of the momenta); "
            "give a guess nearer to the path, another number of steps or a shorter duration",
            status=outcome.status, iterate=path,
        )  # fmt: skip
    if not window[0] <= outcome.iterate.duration <= window[1]:
        raise SolverError(
            f"the path has the duration {outcome.iterate.duration:g}, outside {window[0]:g} … {window[1]:g}",
            status="duration outside its bounds", iterate=path,
        )  # fmt: skip
    return path


def found(problem: Problem, iterate: Iterate) -> Outcome:
    """Newton's method; where it fails between fixed ends, continuation from a short duration."""
    outcome = newton(problem, iterate)
    if outcome.solved or problem.closure is not None or problem.energy is not None:
        return outcome
    ratio, best = 2, outcome
    while ratio <= SHORTEST:
        best = newton(problem, with_duration(iterate, iterate.duration / ratio))
        if best.solved:
            break
        ratio *= 2
    if not best.solved:
        return outcome
    return _continued(problem, best, iterate.duration, outcome)


def _continued(problem: Problem, outcome: Outcome, duration: float, failed: Outcome) -> Outcome:
    """Longer and longer paths up to `duration`, each starting from the last; the failed outcome where they end."""
    growth, iterations = np.sqrt(2.0), outcome.iterations + failed.iterations
    for _ in range(MOST_STAGES):
        now = outcome.iterate.duration
        if now >= duration:
            return replace(outcome, iterations=iterations)
        trial = newton(problem, with_duration(outcome.iterate, min(duration, growth * now)))
        iterations += trial.iterations
        if trial.solved:
            outcome, growth = trial, growth**1.5
        else:
            growth = np.sqrt(growth)
        if growth < SMALLEST_GROWTH:
            break
    return replace(failed, iterations=iterations)

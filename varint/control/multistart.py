"""Local minima are the rule: solve from many guesses and keep every different solution."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import Any

import numpy as np

from varint.control.build import build_control_solver
from varint.control.guess import build_start, read_guess, write_guess
from varint.control.neighbours import wave
from varint.control.outcome import FEASIBLE
from varint.control.phase import Phase
from varint.control.problem import ControlProblem, transcribe
from varint.control.trajectories import build_trajectories
from varint.errors import InputError, SolverError
from varint.nlp.solver import choose_backend
from varint.results.trajectory import Trajectory
from varint.scene.inputs import generator, guesses_of, number, positive_integer

SAME = 1e-5  # relative to the cost and to the path's extent: closer solutions are one


def multistart(
    phase: Phase,
    starts: int | Sequence[Any] = 20,
    *,
    spread: float = 1.0,
    seed: int = 0,
    t0: float = 0.0,
    solver: str = "ipopt",
    options: Mapping[str, Any] | None = None,
    backend: str = "auto",
) -> list[Trajectory]:
    """All different local minima found from many starts, cheapest first.

    Parameters
    ----------
    phase : Phase
        The problem, as for `optimal_phases`.
    starts : int or sequence
        Number of random paths about the phase's own guess (the first start is that guess itself),
        or the guesses.
    spread : float
        Amplitude of the random paths, in units of each coordinate's range.
    seed : int
        Of the random numbers.
    t0, solver, options, backend
        As in `optimal_control`.

    Returns
    -------
    list of Trajectory
        ``stats["found"]`` of each says how many starts led to it.

    Raises
    ------
    SolverError
        If no start leads to a solution.

    Examples
    --------
    >>> import casadi as ca, numpy as np
    >>> import varint as vi
    >>> q, v = vi.coordinates("theta")
    >>> torque = ca.SX.sym("torque")
    >>> pendulum = vi.System(q, v, v**2 / 2 + 9.81 * ca.cos(q), force=torque, control=torque)
    >>> swing = vi.Phase(
    ...     pendulum, vi.gauss(3), 3.0, 30, torque**2,
    ...     start=dict(q=[0], v=[0]), end=dict(q=[np.pi], v=[0]))
    >>> found = vi.multistart(swing, 12)
    >>> round(found[0].cost, 2), len(found) > 1
    (36.64, True)
    """
    if not isinstance(phase, Phase):
        raise InputError(f"multistart takes one varint.Phase, got {type(phase).__name__}")
    if not isinstance(starts, (int, np.integer)):
        starts = guesses_of(starts)
    solves = len(starts) if isinstance(starts, list) else positive_integer("starts", starts)
    spread, random = number("spread", spread), generator(seed)
    problem = transcribe([phase], [], t0, choose_backend(solver, backend), solves)
    x = build_start(problem)
    run = build_control_solver(problem, x, solver, options)
    kept: list[tuple[Trajectory, int]] = []
    worst = None
    for start in _starts(problem, starts, spread, random):
        outcome = run(start, progress=False)
        if not outcome.success or outcome.violation > FEASIBLE:
            worst = outcome
            continue
        found = build_trajectories(problem, outcome)[0]
        twin = next((i for i, (other, _) in enumerate(kept) if _same(found, other)), None)
        if twin is None:
            kept.append((found, 1))
        else:
            kept[twin] = (kept[twin][0], kept[twin][1] + 1)
    if not kept:
        status = worst.status if worst else "no start"
        raise SolverError(
            f"none of the starts led to a solution; the last one ended with {status}", status=status
        )
    kept.sort(key=lambda pair: pair[0].cost)
    return [replace(m, stats=MappingProxyType({**m.stats, "found": count})) for m, count in kept]


def _starts(
    problem: ControlProblem, starts: int | Sequence[Any], spread: float, rng: np.random.Generator
):
    """Start values, one after the other."""
    transcription = problem.phases[0]
    t0 = transcription.t0
    if isinstance(starts, (int, np.integer)):
        own = read_guess(transcription.phase, t0)
        guesses = [own, *(wave(own, transcription, spread, rng) for _ in range(starts - 1))]
    else:
        guesses = [read_guess(replace(transcription.phase, guess=g), t0) for g in starts]
    for guess in guesses:
        x = build_start(problem)
        write_guess(x, transcription, guess)
        yield np.clip(x, problem.nlp.x_low, problem.nlp.x_high)


def _same(a: Trajectory, b: Trajectory) -> bool:
    extent = np.maximum(np.ptp(a.q, axis=0), np.ptp(b.q, axis=0)) + 1e-300
    near = bool((np.abs(a.q - b.q) <= 100 * SAME * extent).all())
    return near and abs(a.cost - b.cost) <= SAME * max(abs(a.cost), abs(b.cost))

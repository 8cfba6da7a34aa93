"""Local minima are the rule: solve from many guesses and keep every different solution."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import Any

import numpy as np

from varint.control import nlp
from varint.control.guess import Guess, fill, phase_guess, start_values
from varint.control.leg import Leg
from varint.control.optimal import FEASIBLE
from varint.control.phase import Phase
from varint.control.problem import Problem, problem
from varint.control.solution import trajectories
from varint.errors import InputError, SolverError
from varint.parameters import generator, guesses_of, number, whole
from varint.trajectory import Trajectory

SAME = 1e-5  # relative to the cost and to the path's extent: closer solutions are one
WAVES = 4  # sine waves of a random path


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
        Number of random paths about the phase's own guess (the first start is that guess itself), or the guesses.
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
    ...     pendulum, vi.gauss(3), 3.0, 30, torque**2, start=dict(q=[0], v=[0]), end=dict(q=[np.pi], v=[0]))
    >>> found = vi.multistart(swing, 12)
    >>> round(found[0].cost, 2), len(found) > 1
    (36.64, True)
    """
    if not isinstance(phase, Phase):
        raise InputError(f"multistart takes one varint.Phase, got {type(phase).__name__}")
    if not isinstance(starts, (int, np.integer)):
        starts = guesses_of(starts)
    solves = len(starts) if isinstance(starts, list) else whole("starts", starts)
    spread, random = number("spread", spread), generator(seed)
    one = problem([phase], [], t0, nlp.backend_for(solver, backend), solves)
    x = start_values(one)
    run = nlp.solver(one, x, solver, options)
    kept: list[tuple[Trajectory, int]] = []
    worst = None
    for start in _starts(one, starts, spread, random):
        outcome = run(start, progress=False)
        if not outcome.success or outcome.violation > FEASIBLE:
            worst = outcome
            continue
        found = trajectories(one, outcome)[0]
        twin = next((i for i, (other, _) in enumerate(kept) if _same(found, other)), None)
        if twin is None:
            kept.append((found, 1))
        else:
            kept[twin] = (kept[twin][0], kept[twin][1] + 1)
    if not kept:
        status = worst.status if worst else "no start"
        raise SolverError(f"none of the starts led to a solution; the last one ended with {status}", status=status)
    kept.sort(key=lambda pair: pair[0].cost)
    return [replace(m, stats=MappingProxyType({**m.stats, "found": count})) for m, count in kept]


def _starts(one: Problem, starts: int | Sequence[Any], spread: float, rng: np.random.Generator):
    """Start values, one after the other."""
    leg = one.legs[0]
    t0 = float(leg.data[2 * leg.phase.steps])
    if isinstance(starts, (int, np.integer)):
        own = phase_guess(leg.phase, t0)
        guesses = [own, *(_waved(own, leg, spread, rng) for _ in range(starts - 1))]
    else:
        guesses = [phase_guess(replace(leg.phase, guess=g), t0) for g in starts]
    for guess in guesses:
        x = start_values(one)
        fill(x, leg, guess)
        yield np.clip(x, one.x_low, one.x_high)


def _waved(own: Guess, leg: Leg, spread: float, rng: np.random.Generator) -> Guess:
    """The path plus sine waves of random height that vanish at the ends."""
    path = own.q(leg.phase.mesh)
    reach = np.maximum(np.ptp(path, axis=0), 1e-3 * np.abs(path).max(initial=0.0))
    reach = np.where(reach > 0, reach, 1.0)
    waves = np.arange(1, WAVES + 1)
    heights = spread * reach * rng.normal(size=(WAVES, path.shape[1])) / waves[:, None]
    return replace(own, q=lambda s: own.q(s) + np.sin(np.pi * s[:, None] * waves) @ heights, u=None)


def _same(a: Trajectory, b: Trajectory) -> bool:
    extent = np.maximum(np.ptp(a.q, axis=0), np.ptp(b.q, axis=0)) + 1e-300
    near = bool((np.abs(a.q - b.q) <= 100 * SAME * extent).all())
    return near and abs(a.cost - b.cost) <= SAME * max(abs(a.cost), abs(b.cost))

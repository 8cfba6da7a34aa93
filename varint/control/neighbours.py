"""Cheaper minima beside the first one: a few more starts where a scene is known for many minima.

Each joint without a motor multiplies the minima of a swing-up, and so do the ways around where
nothing may slip; the solver ends in one of them, often not the cheapest. A few paths near the line
are tried, each for at most twice the iterations of the first one.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from varint.control.guess import Guess, read_guess, write_guess
from varint.control.problem import ControlProblem
from varint.control.transcription import PhaseTranscription
from varint.nlp.solver import SolverResult

PASSIVE = 2  # coordinates beyond the controls: one has few minima
NEIGHBOURS = 4
WAYS_AROUND = 8  # neighbours where nothing may slip: of 4 a quarter miss the cheapest
SPREAD = 0.3  # height of the waves, of each coordinate's range
LONGER = 2  # times the iterations of the first solve
PATIENCE = 25
FEASIBLE = 1e-6
WAVES = 4  # sine waves of a random path
STILL = 1e-3  # of the largest range: a coordinate that moves by less stays where it is

Run = Callable[..., SolverResult]


def has_many_minima(problem: ControlProblem) -> bool:
    """One phase without a guess, between given configurations, with several passive joints."""
    part, structure = problem.phases[0], problem.phases[0].phase.system.structure
    ends = (part.phase.start.q, part.phase.end.q)
    return (
        len(problem.phases) == 1
        and part.phase.guess is None
        and not structure.linear
        and structure.controls > 0
        and structure.n - structure.velocity_rows - structure.controls >= PASSIVE
        and all((q[1] == q[2]).all() for q in ends)
    )


def cheapest_neighbour(
    problem: ControlProblem,
    run: Run,
    x: np.ndarray,
    first: SolverResult,
    tell: Any,
    tries: int = NEIGHBOURS,
    seed: int = 0,
) -> tuple[SolverResult, tuple[float, ...]]:
    """The cheapest of the first solution and of those from random paths about the default one, and
    the costs of all that were found.
    """
    part, random = problem.phases[0], np.random.default_rng(seed)
    own = read_guess(part.phase, part.t0)
    most = LONGER * max(first.iterations, 1)
    found = [first]

    def enough(iterate: SolverResult) -> bool:
        return bool(tell is not None and tell(iterate)) or iterate.iterations > most

    for _ in range(tries):
        start = x.copy()
        write_guess(start, part, wave(own, part, SPREAD, random))
        start = np.clip(start, problem.nlp.x_low, problem.nlp.x_high)
        outcome = run(start, patience=PATIENCE, callback=enough)
        if outcome.success and outcome.violation <= FEASIBLE:
            found.append(outcome)
    found.sort(key=lambda outcome: outcome.cost)
    return found[0], tuple(outcome.cost for outcome in found)


def wave(
    own: Guess, transcription: PhaseTranscription, spread: float, rng: np.random.Generator
) -> Guess:
    """The path plus sine waves of random height that vanish at the ends."""
    path = own.q(transcription.phase.mesh)
    reach = _reach(transcription, path)
    waves = np.arange(1, WAVES + 1)
    heights = spread * reach * rng.normal(size=(WAVES, path.shape[1])) / waves[:, None]
    return replace(own, q=lambda s: own.q(s) + np.sin(np.pi * s[:, None] * waves) @ heights, u=None)


def _reach(transcription: PhaseTranscription, path: np.ndarray) -> np.ndarray:
    """The range of each coordinate; of one that stays where it is that of its bounds or of the
    others, at most 1: it may be an angle beside lengths of any size.
    """
    low, high = transcription.phase.bounds.q
    ranges = np.ptp(path, axis=0)
    largest = float(ranges.max(initial=0.0))
    other = min(1.0, largest) if largest > 0 else 1.0
    moves = ranges > STILL * largest
    return np.where(moves, ranges, np.minimum(other, high - low))

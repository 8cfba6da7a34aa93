"""Runs to a wanted accuracy that end where an expression crosses zero: no farther than it takes.

How many steps a motion needs is found from whole runs of it. Where it ends early, the duration that
was given says nothing of that: runs over a first piece come first, then over pieces that are
eight times longer, until one of them has the end. What came before is a small part of the last.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import NamedTuple

from varint.integration.choice import Choice
from varint.integration.known_at_start import fastest_at_start
from varint.integration.plan import plan
from varint.integration.problem import InitialValueProblem, RunOptions
from varint.rules.rule import Rule
from varint.scene.system import System

FIRST = 32.0  # radians that the fastest small motion about the start turns in the first piece
GROWTH = 8.0  # from piece to piece
WITHIN = 1e-9  # of a piece: an end so near to its own is none


class Ending(NamedTuple):
    """What was chosen, and the options of the run until there."""

    choice: Choice
    options: RunOptions


def as_far_as_it_ends(
    system: System,
    rule: Rule | None,
    problem: InitialValueProblem,
    options: RunOptions,
    choose: Callable[[InitialValueProblem, RunOptions], Choice],
) -> Ending:
    """The choice for the shortest piece in which the motion ends, or for the whole duration.

    Parameters
    ----------
    system : System
    rule : Rule or None
    problem : InitialValueProblem
        Of one step over the whole duration.
    options : RunOptions
        Of a run that ends at an expression's zero.
    choose : callable
        (problem, options) → choice, with the motion until its end.
    """
    runs = 0
    for duration in _pieces(system, rule, problem):
        asked = options._replace(duration=duration)
        choice = choose(problem._replace(h=duration), asked)
        runs += choice.runs
        if abs(choice.motion.t[-1] - problem.t0) < (1 - WITHIN) * abs(duration):
            return Ending(replace(choice, runs=runs), asked)
        if not choice.reached:  # chaos, or round-off: longer pieces would not be either
            break
    choice = choose(problem, options)
    return Ending(replace(choice, runs=runs + choice.runs), options)


def _pieces(system: System, rule: Rule | None, problem: InitialValueProblem) -> Iterator[float]:
    """Durations of the pieces that are clearly shorter than the whole; none where nothing moves to
    and fro.
    """
    fastest, _ = fastest_at_start(system, plan(system, rule).rule, problem)
    if not fastest > 0:
        return
    duration = FIRST / fastest * (1.0 if problem.h > 0 else -1.0)
    while abs(duration) * GROWTH <= abs(problem.h):
        yield duration
        duration *= GROWTH

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
from varint.results.trajectory import Trajectory
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

    def choose_for(duration: float) -> Choice:
        return choose(problem._replace(h=duration), options._replace(duration=duration))

    fastest, _ = fastest_at_start(system, plan(system, rule).rule, problem)
    choice, duration = in_pieces(fastest, problem.t0, problem.h, choose_for)
    return Ending(choice, options._replace(duration=duration))


def in_pieces(
    fastest: float, t0: float, total: float, choose: Callable[[float], Choice]
) -> tuple[Choice, float]:
    """The choice for a duration for the shortest piece in which the motion ends, or the whole; and
    which that is. `fastest` is the frequency of the fastest small motion about the start.
    """
    runs = 0
    for duration in pieces(fastest, total):
        choice = choose(duration)
        runs += choice.runs
        if ends_within(choice.motion, t0, duration):
            return replace(choice, runs=runs), duration
        if not choice.reached:  # chaos, or round-off: longer pieces would not be either
            break
    choice = choose(total)
    return replace(choice, runs=runs + choice.runs), total


def ends_within(motion: Trajectory, t0: float, duration: float) -> bool:
    """Whether the motion ends clearly before a piece does."""
    return bool(abs(motion.t[-1] - t0) < (1 - WITHIN) * abs(duration))


def pieces(fastest: float, total: float) -> Iterator[float]:
    """Durations of the pieces that are clearly shorter than the whole; none where nothing moves to
    and fro.
    """
    if not fastest > 0:
        return
    duration = FIRST / fastest * (1.0 if total > 0 else -1.0)
    while abs(duration) * GROWTH <= abs(total):
        yield duration
        duration *= GROWTH

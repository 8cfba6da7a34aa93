"""Runs with contacts that are over before anyone could wait, from their start to their end in one
call of the loop in C, without the blocks of the long ones.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from time import perf_counter
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from varint.codegen.contacts import ENDED, Flight, first_flight_state
from varint.codegen.kernel import Kernel
from varint.discrete.constraints import ActiveSet
from varint.integration.events.flights import (
    Flights,
    Stretch,
    events_of,
    flown,
    held_in,
    steps_in_a_call,
)
from varint.integration.gears import gears_with, kernel_after, newton
from varint.integration.many_steps import in_gear, steps_again
from varint.integration.plan import Plan
from varint.integration.problem import InitialValueProblem
from varint.integration.steppers.uniform_field import is_uniform
from varint.integration.trajectories import one_by_one, stats_of
from varint.numerics.arrays import call
from varint.results.trajectory import Trajectory
from varint.scene.system import System

NOTHING: Mapping[str, Any] = MappingProxyType({})
ANY_NUMBER = 2**62  # of steps: those of parts of steps between impacts count, too


class ShortFlight(NamedTuple):
    """A whole run: the loop that it began with, what the call found, and what held from which row
    on.
    """

    kernel: Kernel
    found: Flight
    stretches: list[Stretch]


def short_flight(
    system: System,
    chosen: Plan,
    problem: InitialValueProblem,
    flights: Flights,
    fewer: int = 0,
) -> ShortFlight | None:
    """The run, from a start that may touch contacts, beside one in `fewer` steps where they are
    some; None where it is long, or has more in it than clean impacts and changes of what holds.
    """
    active_set = problem.active_set or ActiveSet(tuple(range(system.structure.constraints)))
    kernel = flights.loop_in(active_set)
    if kernel is None or problem.first:
        return None
    if problem.steps > steps_in_a_call(kernel):
        return None
    held, n, t0 = held_in(system, active_set), system.structure.n, problem.t0
    q, p = problem.q0, problem.p0
    here, h = np.concatenate(((t0, t0), q, p)), np.array((problem.h,))
    (start,) = call(held.arrival, here, h, problem.c)
    rest, sizes = np.zeros(n), (start[n : 3 * n], start[3 * n :])
    state = first_flight_state(kernel, 0, t0, 0, q, p, start[:n], rest, rest)
    given = system, problem, flights, held, kernel, state, sizes
    found, stretches = flown(*given, ANY_NUMBER, begins=True, fewer=fewer)
    uniform = is_uniform(held.scene)
    gears = None if uniform else gears_with(held.scene, chosen.rule, newton(), kernel)
    if gears:
        kernel_after(gears, found.seconds, 0.0)
    return ShortFlight(kernel, found, stretches) if found.status == ENDED else None


def motion_of_flight(
    system: System,
    chosen: Plan,
    problem: InitialValueProblem,
    run: ShortFlight,
    began: float,
    more: Mapping[str, Any] = NOTHING,
) -> Trajectory:
    """The motion of a whole run, with what is told besides; its impacts become records, and what is
    told of it a mapping, when they are looked at.
    """
    kernel, found, stretches = run
    rule, motion = chosen.rule, object.__new__(Trajectory)
    active_sets: dict[ActiveSet, int] = {}
    active_set = np.zeros(len(found.t), dtype=np.int64)
    ends = [*[part.row for part in stretches[1:]], len(found.t)]
    for part, end in zip(stretches, ends, strict=True):
        if part.row < end:  # what touches at the start may change at once what holds
            active_set[part.row : end] = active_sets.setdefault(part.active_set, len(active_sets))
    told = {"seconds": perf_counter() - began, **more}
    # in half the time of its constructor, which short runs notice
    object.__setattr__(
        motion,
        "__dict__",
        {
            "system": system,
            "rule": rule,
            "t": found.t,
            "q": found.q.copy(),
            "p": found.p.copy(),
            "h": problem.h,
            "k": found.k,
            "u": problem.u,
            "c": problem.c,
            "functions": steps_again(rule, in_gear),
            "active_sets": tuple(active_sets),
            "active_set": active_set,
            "origin": problem.t0,
            "_make": partial(_made, chosen, kernel, problem, found, told),
        },
    )
    return motion


def _made(
    chosen: Plan,
    kernel: Kernel,
    problem: InitialValueProblem,
    found: Flight,
    told: Mapping[str, Any],
    name: str,
) -> Any:
    """The field of this name."""
    if name == "events":
        return tuple(one_by_one(events_of(found.hits, len(problem.q0)), problem.h))
    if name == "stats":
        work = found.iterations, found.residual
        return stats_of(chosen, kernel, problem.steps, work, dict(told))
    return None

"""Flights between impacts in C: steps, the gaps along them and clean impacts without Python; what
is more than that is left to the loop that knows all of it.
"""

from __future__ import annotations

from collections.abc import Callable, Generator
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from varint.codegen.contacts import (
    FULL,
    HIT,
    SETTLED,
    ContactData,
    Flight,
    first_flight_state,
    fly,
)
from varint.codegen.kernel import Kernel
from varint.discrete.constraints import ActiveSet
from varint.discrete.legendre import velocity_function
from varint.integration.compiled_loop import CAUTION, PATIENCE
from varint.integration.events.contacts import Instant, first_contact
from varint.integration.gears import gears_with, kernel_after, newton
from varint.integration.problem import InitialValueProblem
from varint.integration.state import NodeBlock, RunState
from varint.integration.steppers.stepper import state_layout
from varint.integration.steppers.uniform_field import is_uniform
from varint.numerics.arrays import call
from varint.results.records import Event
from varint.rules.rule import Rule
from varint.scene.system import System

KINDS = ("impact", "stop", "detachment")  # by their numbers in a call


class Flights(NamedTuple):
    """The loops of the scene in its active sets, None where there is none, and its contacts as
    data.
    """

    loop_in: Callable[[ActiveSet], Kernel | None]
    contacts: ContactData


class Located(NamedTuple):
    """An instant at which a gap closes, before the impact, and whether its step ends there; or
    after it, as `settled`, with what happened, where other contacts hold from then on.
    """

    now: Instant
    ends: bool
    settled: bool = False
    events: tuple[Event, ...] = ()


def flight_state(
    system: System, problem: InitialValueProblem, kernel: Kernel, at: RunState
) -> np.ndarray:
    """Where a flight begins that follows other blocks."""
    assert at.t is not None
    layout = state_layout(system.structure.n)
    q, p = at.x[layout.q].copy(), at.x[layout.p].copy()
    v = call(velocity_function(system), q, p, np.array([at.t]), problem.c)[0]
    rests = at.x[layout.q_rest], at.x[layout.p_rest]
    return first_flight_state(kernel, at.k, at.t, at.events, q, p, v, *rests)


def flight_blocks(
    system: System, rule: Rule, problem: InitialValueProblem, flights: Flights, at: RunState
) -> Generator[NodeBlock, None, tuple[RunState, Located | None]]:
    """The run from a position on, block by block, up to where something else than a clean impact
    is to be dealt with: where the run stands then, and the instant of that, where it is known.
    """
    assert at.active_set is not None
    n, active_set = system.structure.n, at.active_set
    kernel = flights.loop_in(active_set)
    if kernel is None:
        return at, None
    scene, first = active_set.scene(system), first_contact(system)
    fixed = (*active_set.rows, *range(system.constraint.numel(), first))
    held = (*fixed, *(first + i for i in active_set.contacts))
    holds = np.isin(np.arange(system.contact.numel()), active_set.holding)
    state = flight_state(scene, problem, kernel, at) if at.carry is None else at.carry
    gears = None if is_uniform(scene) else gears_with(scene, rule, newton(), kernel)
    work = max(kernel.operations * kernel.nodes, 1)
    most = max(int(PATIENCE / (CAUTION * work)), 1)
    status = int(FULL)
    while status == FULL:
        began = int(state[0])
        found = fly(
            kernel,
            flights.contacts,
            state,
            held,
            holds,
            at.scale,
            problem.c,
            t0=problem.t0,
            h=problem.h,
            last=problem.steps,
            save_every=problem.save_every,
            steps=most,
            level=problem.level,
        )
        status, state = found.status, found.state
        block = _block(found, at, n)
        moved = state[0] > began or len(block.events)
        if moved:
            assert block.after is not None
            at = block.after
            yield block
        per_step = max(found.seconds / max(int(state[0]) - began, 1), 1e-12)
        if gears:
            kernel = kernel_after(gears, found.seconds, per_step * (problem.steps - state[0]))
        most = max(min(10 * most, int(PATIENCE / per_step)), 1)
    return at, None if found.located is None else _located(found, active_set, n)


def _located(found: Flight, active_set: ActiveSet, n: int) -> Located:
    flat = found.located
    assert flat is not None
    q, p, _, q_rest, p_rest = flat[2:].reshape(5, n)
    x, events = np.concatenate([q, q_rest, p, p_rest]), tuple[Event, ...]()
    if found.status == SETTLED:
        active_set = replace(active_set, contacts=found.holding, holding=found.holding)
        events = _events(found.hits[found.hits[:, 0] == len(found.t)], n)
    now = Instant(float(flat[0]), x, active_set)
    return Located(now, bool(flat[1]), found.status == SETTLED, events)


def _events(hits: np.ndarray, n: int) -> tuple[Event, ...]:
    """The impacts that a call tells of."""
    contacts, kinds = hits[:, 1:3].astype(int).T.tolist()
    states = (list(map(tuple, hits[:, i : i + n].tolist())) for i in range(HIT, HIT + 5 * n, n))
    return tuple(
        Event(time, KINDS[kind], contact, *numbers)
        for contact, kind, time, *numbers in zip(
            contacts, kinds, *hits[:, 3:HIT].T.tolist(), *states, strict=True
        )
    )


def _block(found: Flight, at: RunState, n: int) -> NodeBlock:
    """The nodes that a call found, and where the run stands after it."""
    state = found.state
    q, p, _, q_rest, p_rest = state[4 : 4 + 5 * n].reshape(5, n)
    x = np.concatenate([q, q_rest, p, p_rest])
    after = at._replace(x=x, k=int(state[0]), t=float(state[1]), events=int(state[2]), carry=state)
    hits = found.hits[found.hits[:, 0] < len(found.t)]
    return NodeBlock(
        found.k,
        found.q,
        found.p,
        found.residual,
        len(found.k),
        t=found.t,
        active_set=at.active_set,
        events=_events(hits, n),
        iterations=found.iterations,
        after=after,
        v=found.v,
        impacts=tuple(hits[:, 0].astype(int).tolist()),
    )

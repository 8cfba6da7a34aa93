"""Flights between impacts in C: steps, the gaps along them and clean impacts without Python; what
is more than that is left to the loop that knows all of it.
"""

from __future__ import annotations

from collections.abc import Callable, Generator
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import casadi as ca
import numpy as np

from varint.codegen.contacts import (
    FULL,
    HIT,
    SETTLED,
    Begun,
    ContactData,
    Flight,
    first_flight_state,
    fly,
)
from varint.codegen.kernel import Kernel
from varint.discrete.constraints import ActiveSet
from varint.discrete.legendre import velocity_function
from varint.discrete.scales import inertia_function, scale_function
from varint.integration.compiled_loop import CAUTION, PATIENCE, most_after
from varint.integration.events.contacts import Instant, first_contact
from varint.integration.events.quiet import FIRST_LOOK
from varint.integration.gears import gears_with, kernel_after, newton
from varint.integration.problem import InitialValueProblem
from varint.integration.state import NodeBlock, RunState
from varint.integration.steppers.stepper import state_layout
from varint.integration.steppers.uniform_field import is_uniform
from varint.numerics.arrays import call
from varint.results.records import Event
from varint.rules.rule import Rule
from varint.scene.memory import per_scene, per_system
from varint.scene.system import System

KINDS = ("impact", "stop", "detachment")  # by their numbers in a call


class Held(NamedTuple):
    """What there is to know of an active set: the scene in it, the rows that hold, which contacts
    are closed, and the functions of its start, see `arrival_function`.
    """

    active_set: ActiveSet
    scene: System
    rows: tuple[int, ...]
    closed: np.ndarray
    arrival: ca.Function
    velocity: ca.Function


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


@per_system
def held_in(system: System, active_set: ActiveSet) -> Held:
    """What there is to know of an active set."""
    scene, first = active_set.scene(system), first_contact(system)
    fixed = (*active_set.rows, *range(system.constraint.numel(), first))
    rows = (*fixed, *(first + i for i in active_set.contacts))
    closed = np.isin(np.arange(system.contact.numel()), active_set.holding)
    return Held(active_set, scene, rows, closed, arrival_function(scene), velocity_function(scene))


@per_scene
def arrival_function(system: System) -> ca.Function:
    """((t, time of its step, q, p), h, c) → (v, typical sizes, the inertia between them), each in
    one piece: a call takes as long as its arguments are many.
    """
    n = system.structure.n
    sizes = (2 + 2 * n, 1, system.c.numel())
    here, h, c = inputs = [ca.MX.sym(f"a{i}", size) for i, size in enumerate(sizes)]
    t, grid, q, p = ca.vertsplit(here, [0, 1, 2, 2 + n, 2 + 2 * n])
    scale = scale_function(system)(q, p, ca.MX(0, 1), grid, h, c)
    inertia = inertia_function(system)(q, p, grid, c)
    found = ca.vertcat(velocity_function(system)(q, p, t, c), scale, inertia)
    return ca.Function("arrival", inputs, [ca.densify(found)])


def flight_state(
    held: Held, problem: InitialValueProblem, kernel: Kernel, at: RunState
) -> np.ndarray:
    """Where a flight begins that follows other blocks."""
    assert at.t is not None
    layout = state_layout(held.scene.structure.n)
    q, p = at.x[layout.q].copy(), at.x[layout.p].copy()
    v = call(held.velocity, q, p, np.array([at.t]), problem.c)[0]
    rests = at.x[layout.q_rest], at.x[layout.p_rest]
    return first_flight_state(kernel, at.k, at.t, at.events, q, p, v, *rests)


class Stretch(NamedTuple):
    """What holds from a row of a call on, typical sizes and the inertia between them."""

    row: int
    active_set: ActiveSet
    scale: np.ndarray
    inertia: np.ndarray


def flight_blocks(
    system: System, rule: Rule, problem: InitialValueProblem, flights: Flights, at: RunState
) -> Generator[NodeBlock, None, tuple[RunState, Located | None]]:
    """The run from a position on, block by block, up to where something else than a clean impact
    or a change of what holds is to be dealt with: where the run stands then, and the instant of
    that, where it is known.
    """
    n, status, most = system.structure.n, int(FULL), 0
    located = None
    while status == FULL:
        active_set = at.active_set
        assert active_set is not None
        kernel = flights.loop_in(active_set)
        if kernel is None:
            return at, None
        held = held_in(system, active_set)
        state = flight_state(held, problem, kernel, at) if at.carry is None else at.carry
        paces = _paces(held.scene, rule)
        if not most:
            most = steps_in_a_call(kernel)
            if known := paces.get(kernel.is_native):
                most = max(min(10 * most, int(PATIENCE / known)), 1)
        began = int(state[0])
        sizes = at.scale, at.inertia
        found, stretches = flown(system, problem, flights, held, kernel, state, sizes, most)
        status, moved = found.status, int(found.state[0]) - began
        if moved or len(found.hits):
            blocks = _blocks(found, at, stretches, n)
            yield from blocks
            assert blocks[-1].after is not None
            at = blocks[-1].after
        per_step = max(found.seconds / max(moved, 1), 1e-12)
        paces[kernel.is_native] = per_step
        gears = None if is_uniform(held.scene) else gears_with(held.scene, rule, newton(), kernel)
        if gears:
            kernel_after(gears, found.seconds, per_step * (problem.steps - began - moved))
        most = most_after(most, per_step, gears, PATIENCE)
        located = found.located
    active_set = stretches[-1].active_set
    return at, None if located is None else _located(found, active_set, n)


def steps_in_a_call(kernel: Kernel) -> int:
    """As many as Ctrl-C may wait for, with caution."""
    return max(int(PATIENCE / (CAUTION * max(kernel.operations * kernel.nodes, 1))), 1)


def flown(
    system: System,
    problem: InitialValueProblem,
    flights: Flights,
    held: Held,
    kernel: Kernel,
    state: np.ndarray,
    sizes: tuple[np.ndarray, np.ndarray],
    most: int,
    begins: bool = False,
    fewer: int = 0,
) -> tuple[Flight, list[Stretch]]:
    """One call, of so many steps at most, from a state (see `fly`), with typical sizes and the
    inertia between them there, and what held from which row on.
    """
    stretches = [Stretch(0, held.active_set, *sizes)]
    found = fly(
        kernel,
        flights.contacts,
        state,
        held.rows,
        held.closed,
        sizes[0],
        problem.c,
        t0=problem.t0,
        h=problem.h,
        last=problem.steps,
        save_every=problem.save_every,
        steps=most,
        level=problem.level,
        begins=begins,
        fewer=fewer,
        change=partial(_change, _Changing(system, problem, flights, stretches, {})),
    )
    return found, stretches


@per_scene
def _paces(system: System, rule: Rule) -> dict[bool, float]:
    """Seconds that a step took in the last call, by whether the loop is native: the next run of the
    scene need not begin with caution.
    """
    return {}


class _Changing(NamedTuple):
    """What changes of a call are made of: its stretches so far, and by the contacts that hold what
    there is to know of them, where there is a loop.
    """

    system: System
    problem: InitialValueProblem
    flights: Flights
    stretches: list[Stretch]
    known: dict[tuple[int, ...], tuple[Held, Kernel] | None]


def _change(
    of: _Changing, row: int, k: int, last: int, flat: np.ndarray, holding: tuple[int, ...]
) -> Begun | None:
    """What other contacts begin with (see `fly`), as `position` in contact_loop.py has it; of the
    run in fewer steps nothing else is wanted.
    """
    system, problem, flights, stretches, known = of
    if holding not in known:
        active_set = replace(stretches[-1].active_set, contacts=holding, holding=holding)
        kernel = flights.loop_in(active_set)
        known[holding] = None if kernel is None else (held_in(system, active_set), kernel)
    if (begins := known[holding]) is None:
        return None
    (active_set, scene, rows, _, arrival, _), kernel = begins
    n, h = scene.structure.n, problem.h * (problem.steps // last)
    before = h * min(k, last - 1)
    here = flat[: 2 + 2 * n].copy()
    here[1] = (here.item(0) - before) + before
    (found,) = call(arrival, here, np.array((h,)), problem.c)
    if last == problem.steps:
        stretches.append(Stretch(row, active_set, found[n : 3 * n], found[3 * n :]))
    return Begun(kernel, rows, found[: 3 * n])


def _located(found: Flight, active_set: ActiveSet, n: int) -> Located:
    flat = found.located
    assert flat is not None
    q, p, _, q_rest, p_rest = flat[2:].reshape(5, n)
    x, events = np.concatenate([q, q_rest, p, p_rest]), tuple[Event, ...]()
    if found.status == SETTLED:
        active_set = replace(active_set, contacts=found.holding, holding=found.holding)
        events = events_of(found.hits[found.hits[:, 0] == len(found.t)], n)
    now = Instant(float(flat[0]), x, active_set)
    return Located(now, bool(flat[1]), found.status == SETTLED, events)


def events_of(hits: np.ndarray, n: int) -> tuple[Event, ...]:
    """The impacts that a call tells of."""
    if not len(hits):
        return ()
    contacts, kinds = hits[:, 1:3].astype(int).T.tolist()
    states = (hits[:, i : i + n].tolist() for i in range(HIT, HIT + 5 * n, n))
    return tuple(
        Event(time, KINDS[kind], contact, *numbers)
        for contact, kind, time, *numbers in zip(
            contacts, kinds, *hits[:, 3:HIT].T.tolist(), *states, strict=True
        )
    )


def _blocks(found: Flight, at: RunState, stretches: list[Stretch], n: int) -> list[NodeBlock]:
    """The nodes that a call found, a block for each active set, and where the run stands after the
    last of them.
    """
    state = found.state
    q, p, _, q_rest, p_rest = state[4 : 4 + 5 * n].reshape(5, n)
    x = np.concatenate([q, q_rest, p, p_rest])
    after = at._replace(x=x, k=int(state[0]), t=float(state[1]), events=int(state[2]), carry=state)
    if len(stretches) > 1:
        _, active_set, scale, inertia = stretches[-1]
        after = after._replace(
            scale=scale, inertia=inertia, active_set=active_set, largest=FIRST_LOOK
        )
    rows, ends = found.hits[:, 0].astype(int), [*(x.row for x in stretches[1:]), len(found.t)]
    events, where, first = events_of(found.hits, n), rows.tolist(), 0
    blocks = []
    for part, end, last in zip(stretches, ends, np.searchsorted(rows, ends).tolist(), strict=True):
        begin = part.row
        blocks.append(
            NodeBlock(
                found.k[begin:end],
                found.q[begin:end],
                found.p[begin:end],
                found.residual,
                end - begin,
                t=found.t[begin:end],
                active_set=part.active_set,
                events=events[first:last],
                v=found.v[begin:end],
                impacts=tuple([row - begin for row in where[first:last]]),
            )
        )
        first = last
    blocks[-1] = blocks[-1]._replace(iterations=found.iterations, after=after)
    return [block for block in blocks if block.good or block.after]

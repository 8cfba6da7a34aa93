"""The time loop with contacts: blocks of steps as long as nothing happens, then back to the step
where it did.

A step in which a gap closes or a multiplier changes sign is cut there by sub-steps of the same
rule; after the event the grid goes on where it would have been. Between two blocks a run is a
`RunState` with time and active set: from there it goes on as if it had not stopped.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from varint.discrete.constraints import ActiveSet
from varint.discrete.tolerances import RESIDUAL_LIMIT
from varint.errors import StepRefused
from varint.integration.events.contacts import Instant, View, view
from varint.integration.events.flights import Flights, Located, flight_blocks
from varint.integration.events.gaps import Passage, first_event
from varint.integration.events.impacts import (
    MOST_IMPACTS,
    RESTLESS,
    Setting,
    event_between,
    settle,
)
from varint.integration.events.quiet import FIRST_LOOK, quiet_block
from varint.integration.events.roots import LOCATED
from varint.integration.interpreted_loop import (
    start_state,
    with_sizes_anew,
)
from varint.integration.plan import plan
from varint.integration.problem import InitialValueProblem
from varint.integration.state import NodeBlock, RunState
from varint.integration.steppers.stepper import state_layout
from varint.numerics.arrays import call
from varint.results.records import Event
from varint.rules.rule import Rule
from varint.scene.system import System

MOST_EVENTS = 10 * MOST_IMPACTS  # between two nodes of the grid


def contact_run(
    system: System,
    rule: Rule,
    problem: InitialValueProblem,
    at: RunState | None = None,
    flights: Flights | None = None,
) -> Iterator[NodeBlock]:
    """The run of a scene with contacts from a position on; event nodes lie between the nodes of
    the grid. Flights from one impact to the next take the loop in C where there is one.
    """
    unsaid = 0  # iterations of steps none of whose nodes is kept
    blocks = (
        every_node(system, rule, problem, at)
        if flights is None
        else with_flights(system, rule, problem, flights, at)
    )
    for found in blocks:
        block = found._replace(iterations=found.iterations + unsaid)
        unsaid = 0
        wanted = (block.k % problem.save_every == 0) | (block.k == problem.steps)
        if problem.save_every == 1 or block.events or block.good < len(block.k) or wanted.all():
            yield block
        else:
            assert block.t is not None
            if not wanted.any():
                unsaid = block.iterations
                continue
            k, q, p, t = (x[wanted] for x in (block.k, block.q, block.p, block.t))
            yield block._replace(k=k, q=q, p=p, t=t, good=len(k))


def with_flights(
    system: System,
    rule: Rule,
    problem: InitialValueProblem,
    flights: Flights,
    at: RunState | None,
) -> Iterator[NodeBlock]:
    """The run, its flights in C; what is no clean impact or rests is as `every_node` has it."""
    while at is None or at.k < problem.steps:
        if at is not None:
            at, located = yield from flight_blocks(system, rule, problem, flights, at)
            if at.k == problem.steps:
                return
            if located is not None:
                block = _at_instant(system, rule, problem, at, located)
                yield block
                at = block.after
                continue
            if at.active_set and flights.loop_in(at.active_set):  # the flight ends in this step
                here = at._replace(carry=None)
                block, _ = _pass_to_event(
                    system, rule, problem, here, _view_at(system, problem, here)
                )
                if block.good:
                    yield block
                    at = block.after
                    continue
                at = _without_flight(system, rule, problem, at)
        for block in every_node(system, rule, problem, at):
            yield block
            at = block.after
            if block.good < len(block.k):
                return
            if block.good:
                break


def _at_instant(
    system: System, rule: Rule, problem: InitialValueProblem, at: RunState, located: Located
) -> NodeBlock:
    """What happens where a flight has located it: a block of that one node."""
    there, k, events = located.now, at.k + located.ends, list(located.events)
    if not located.settled:
        reach = abs(problem.h) * at.scale[: len(there.q)]
        setting = Setting(system, problem.c, np.empty(0), problem.h, reach)
        seen, tired = view(system, there, problem.c), at.events >= MOST_IMPACTS
        there, _, events = settle(setting, there, seen, tired=tired)
    after = position(system, rule, problem, there, k, at._replace(carry=None))
    after = after._replace(events=0 if located.ends else at.events + 1)
    return _node(after, 0.0, tuple(events), 0)


def _without_flight(
    system: System, rule: Rule, problem: InitialValueProblem, at: RunState
) -> RunState:
    """The same position for the steppers of `every_node`."""
    assert at.t is not None and at.active_set is not None
    now = Instant(at.t, at.x[state_layout(system.structure.n).moving], at.active_set)
    return position(system, rule, problem, now, at.k, at._replace(carry=None))._replace(
        events=at.events
    )


def every_node(
    system: System, rule: Rule, problem: InitialValueProblem, at: RunState | None
) -> Iterator[NodeBlock]:
    """The run with every node of the grid."""
    seen: View | None = None
    anew = False  # whether typical sizes are those of this very place
    if at is None:
        first = _settled_start(system, rule, problem)
        yield first
        at = first.after
    while at is not None and at.k < problem.steps:
        if at.t == problem.t0 + problem.h * at.k:
            block, happens = quiet_block(
                system, rule, problem, at, seen or _view_at(system, problem, at)
            )
            seen = seen if happens and not block.good else None
            failed, last = not happens and block.good < len(block.k), block.after
            if failed and not (anew and not block.good):
                assert last is not None and last.active_set is not None
                at, anew = with_sizes_anew(last.active_set.scene(system), problem, last), True
                if block.good:
                    yield block._replace(k=block.k[: block.good], failed=0.0, after=at)
                continue
            if block.good or not happens:
                yield block
            if failed:
                return
            at, anew = block.after, False
            if not happens:
                continue
        assert at is not None
        block, seen = _pass_to_event(
            system, rule, problem, at, seen or _view_at(system, problem, at)
        )
        yield block
        if not block.good:
            return
        at = block.after


def _view_at(system: System, problem: InitialValueProblem, at: RunState) -> View:
    assert at.active_set is not None and at.t is not None
    return view(system, Instant(at.t, at.x[: 4 * system.structure.n], at.active_set), problem.c)


def _settled_start(system: System, rule: Rule, problem: InitialValueProblem) -> NodeBlock:
    """The start: what touches and approaches bounces at once, what rests and must push holds."""
    active_set, n = (
        problem.active_set or ActiveSet(tuple(range(system.constraint.numel()))),
        len(problem.q0),
    )
    x = np.concatenate([problem.q0, np.zeros(n), problem.p0, np.zeros(n)])
    now = Instant(problem.t0 + problem.h * problem.first, x, active_set)
    seen = view(system, now, problem.c)
    passage = Passage(system, rule, problem, now, seen, np.abs(seen.v), problem.first)
    u = passage.controls(0.0, (0.0,)).ravel()
    now, _, events = settle(Setting(system, problem.c, u, problem.h, passage.reach), now, seen)
    return _node(position(system, rule, problem, now, problem.first), 0.0, tuple(events), 0)


def position(
    system: System,
    rule: Rule,
    problem: InitialValueProblem,
    now: Instant,
    k: int,
    last: RunState | None = None,
) -> RunState:
    """Where the run stands at an instant in step k; typical sizes stay as they were in the same
    active set.

    Between two nodes of the grid x is [q, its compensation, p, its compensation] alone.
    """
    scene, n, step = now.active_set.scene(system), len(now.q), min(k, problem.steps - 1)
    if last is None or now.active_set != last.active_set:
        q, p = now.q.copy(), now.p.copy()
        last = start_state(
            scene, rule, problem._replace(q0=q, p0=p, t0=now.t - problem.h * step, first=step)
        )
        x = last.x
    elif now.t != problem.t0 + problem.h * k:
        x = now.x
    else:
        start = plan(scene, rule).build(scene, rule).start
        u, t, h = problem.controls(step, 1), np.array([now.t]), np.array([problem.h])
        x = call(start, now.q, now.p, u, t, h, problem.c)[0]
    if x is not now.x:
        x[state_layout(n).moving] = now.x
    return last._replace(x=x, k=k, largest=FIRST_LOOK, t=now.t, active_set=now.active_set, events=0)


def _pass_to_event(
    system: System, rule: Rule, problem: InitialValueProblem, at: RunState, here: View
) -> tuple[NodeBlock, View | None]:
    """From an instant in step k to the next event, or to node k + 1: a block of that one node,
    and the view there.
    """
    assert at.active_set is not None and at.t is not None
    if at.events >= MOST_EVENTS:
        raise StepRefused(
            f"more than {MOST_EVENTS} events in the step after t = {at.t:g}: take a smaller h"
        )
    n, k, end = system.structure.n, at.k, problem.t0 + problem.h * (at.k + 1)
    now = Instant(at.t, at.x[state_layout(n).moving], at.active_set)
    passage = Passage(system, rule, problem, now, here, at.scale, k)
    restless = at.events >= RESTLESS
    reached, happens, lets_go, sinking = first_event(passage, end - now.t, restless)
    there, seen = reached.now, reached.seen
    if not (reached.residual <= RESIDUAL_LIMIT and reached.is_finite):
        nothing, failed = np.empty((0, n)), reached.residual if reached.is_finite else float("nan")
        return NodeBlock(
            np.array([k + 1]),
            nothing,
            nothing,
            0.0,
            0,
            failed,
            np.empty(0),
            now.active_set,
            after=at,
        ), None
    if reached.ahead == end - now.t or abs(end - there.t) <= LOCATED * abs(end):
        there, k = replace(there, t=end), k + 1
    events: list[Event] = []
    released: frozenset[int] = frozenset()
    if lets_go is not None:
        events.append(
            event_between(there.t, "detachment", lets_go, 0.0, (there, seen), (there, seen))
        )
        kept = tuple(i for i in there.active_set.holding if i != lets_go)
        there, released = (
            replace(there, active_set=replace(there.active_set, contacts=kept, holding=kept)),
            frozenset({lets_go}),
        )
    if happens:
        setting, tired = (
            Setting(system, problem.c, reached.u, problem.h, passage.reach),
            at.events >= MOST_IMPACTS,
        )
        there, seen, more = settle(
            setting, there, seen, released=released, sinking=sinking, tired=tired
        )
        events += more
    after = position(system, rule, problem, there, k, at)
    after = after._replace(events=at.events + 1 if k == at.k else 0)
    return _node(after, reached.residual, tuple(events), reached.iterations), seen


def _node(
    after: RunState, residual: float, events: tuple[Event, ...], iterations: int
) -> NodeBlock:
    layout = state_layout(len(after.scale) // 2)
    q, p, t = after.x[None, layout.q], after.x[None, layout.p], np.array([after.t])
    return NodeBlock(
        np.array([after.k]), q, p, residual, 1, 0.0, t, after.active_set, events, iterations, after
    )

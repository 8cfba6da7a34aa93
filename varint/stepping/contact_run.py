"""The time loop with contacts: blocks of steps as long as nothing happens, then back to the step where it did.

A step in which a gap closes or a multiplier changes sign is cut there by sub-steps of the same rule; after the event
the grid goes on where it would have been. Between two blocks a run is a `Position` with time and phase: from there it
goes on as if it had not stopped.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from varint.arrays import call, over_columns
from varint.errors import StepRefused
from varint.manifold import Phase, multipliers_along
from varint.polynomials import lagrange_values
from varint.rules import Rule
from varint.stepping.contact import MOST_IMPACTS, PULL, TOUCH, Setting, settle
from varint.stepping.contact_search import Passage, earliest
from varint.stepping.contact_view import Instant, View, first_contact, rates_function, view
from varint.stepping.events import LOCATED, lowest
from varint.stepping.pace import steps_at_once
from varint.stepping.plan import plan
from varint.stepping.run import (
    RESIDUAL_LIMIT,
    Block,
    Position,
    Task,
    advanced,
    beginning,
    counted,
    good_nodes,
    next_block,
    rollout,
    size,
)
from varint.system import System
from varint.trajectory import Event

FIRST_LOOK = 10  # steps after an event
MOST_EVENTS = 10 * MOST_IMPACTS  # between two nodes of the grid


def contact_run(system: System, rule: Rule, task: Task, at: Position | None = None) -> Iterator[Block]:
    """The run of a scene with contacts from a position on; event nodes lie between the nodes of the grid."""
    unsaid = 0  # iterations of steps none of whose nodes is kept
    for found in every_node(system, rule, task, at):
        block = found._replace(iterations=found.iterations + unsaid)
        unsaid = 0
        wanted = (block.k % task.save_every == 0) | (block.k == task.steps)
        if task.save_every == 1 or block.events or block.good < len(block.k) or wanted.all():
            yield block
        else:
            assert block.t is not None
            if not wanted.any():
                unsaid = block.iterations
                continue
            k, q, p, t = (x[wanted] for x in (block.k, block.q, block.p, block.t))
            yield block._replace(k=k, q=q, p=p, t=t, good=len(k))


def every_node(system: System, rule: Rule, task: Task, at: Position | None) -> Iterator[Block]:
    """The run with every node of the grid."""
    seen: View | None = None
    if at is None:
        first = _settled_start(system, rule, task)
        yield first
        at = first.after
    while at is not None and at.k < task.steps:
        if at.t == task.t0 + task.h * at.k:
            block, happens = _quiet(system, rule, task, at, seen or _seen(system, task, at))
            seen = seen if happens and not block.good else None
            if block.good or not happens:
                yield block
            if not happens and block.good < len(block.k):
                return
            at = block.after
            if not happens:
                continue
        assert at is not None
        block, seen = _passed(system, rule, task, at, seen or _seen(system, task, at))
        yield block
        if not block.good:
            return
        at = block.after


def _seen(system: System, task: Task, at: Position) -> View:
    assert at.phase is not None and at.t is not None
    return view(system, Instant(at.t, at.x[: 4 * system.structure.n], at.phase), task.c)


def _settled_start(system: System, rule: Rule, task: Task) -> Block:
    """The start: what touches and approaches bounces at once, what rests and must push holds."""
    phase, n = task.phase or Phase(tuple(range(system.constraint.numel()))), len(task.q0)
    x = np.concatenate([task.q0, np.zeros(n), task.p0, np.zeros(n)])
    now = Instant(task.t0 + task.h * task.first, x, phase)
    seen = view(system, now, task.c)
    passage = Passage(system, rule, task, now, seen, np.abs(seen.v), task.first)
    u = passage.controls(0.0, (0.0,)).ravel()
    now, _, events = settle(Setting(system, task.c, u, task.h, passage.reach), now, seen)
    return _node(position(system, rule, task, now, task.first), 0.0, tuple(events), 0)


def position(system: System, rule: Rule, task: Task, now: Instant, k: int, last: Position | None = None) -> Position:
    """Where the run stands at an instant in step k; typical sizes stay as they were in the same phase.

    Between two nodes of the grid x is [q, its compensation, p, its compensation] alone.
    """
    scene, n, step = now.phase.scene(system), len(now.q), min(k, task.steps - 1)
    if last is None or now.phase != last.phase:
        q, p = now.q.copy(), now.p.copy()
        last = beginning(scene, rule, task._replace(q0=q, p0=p, t0=now.t - task.h * step, first=step))
        x = last.x
    elif now.t != task.t0 + task.h * k:
        x = now.x
    else:
        start = plan(scene, rule).build(scene, rule).start
        u, t, h = task.controls(step, 1), np.array([now.t]), np.array([task.h])
        x = call(start, now.q, now.p, u, t, h, task.c)[0]
    if x is not now.x:
        x[: 4 * n] = now.x
    return last._replace(x=x, k=k, largest=FIRST_LOOK, t=now.t, phase=now.phase, events=0)


def _quiet(system: System, rule: Rule, task: Task, at: Position, here: View) -> tuple[Block, bool]:
    """Steps from a node of the grid on in which no contact closes or lets go, and whether one does in the next."""
    assert at.phase is not None and at.t is not None
    n, scene = system.structure.n, at.phase.scene(system)
    count, _ = next_block(at.k, task.steps, 1, at.largest, steps_at_once(scene, rule))
    k = at.k + np.arange(1, count + 1)
    t = task.t0 + task.h * np.append(at.k, k)
    arguments = task.controls(at.k, count), t[:-1].copy(), np.array([task.h]), task.c, at.scale
    states = call(rollout(scene, rule, count, 1), at.x, *arguments)[0].reshape(count, -1)
    good = int(good_nodes(states))
    quiet = _first_event(system, rule, task, at, here, states[:good], t[: good + 1])
    happens = quiet < good
    after = advanced(at, states[:quiet], task.h, 1)
    after = after._replace(t=float(t[quiet]), largest=FIRST_LOOK if happens else after.largest)
    kept = quiet if happens else min(quiet + 1, count)
    failed = 0.0 if happens or good == count else size(states[good])
    worst = float(states[quiet - 1, -1]) if quiet else 0.0
    count_of = int(counted(scene, rule, at.x, states[:quiet])[-1]) if quiet else 0
    q, p = states[:quiet, :n], states[:quiet, 2 * n : 3 * n]
    return Block(k[:kept], q, p, worst, quiet, failed, t[1 : quiet + 1], at.phase, (), count_of, after), happens


def _first_event(
    system: System, rule: Rule, task: Task, at: Position, here: View, states: np.ndarray, t: np.ndarray
) -> int:
    """Number of nodes before the first step in which a contact closes or lets go."""
    assert at.phase is not None
    if not len(states):
        return 0
    n, phase = system.structure.n, at.phase
    x = np.vstack([at.x, states])
    q, p = np.ascontiguousarray(x[:, :n]), np.ascontiguousarray(x[:, 2 * n : 3 * n])
    v, gap, rate = over_columns(rates_function(system, phase.rows, phase.contacts), q, p, t[:, None], task.c)
    close = TOUCH * here.sizes(at.x[:n], abs(task.h) * at.scale[:n])
    happens = ~np.isfinite(gap[1:] + rate[1:]).all(axis=1)  # looked at more closely
    for i in range(gap.shape[1]):
        if i not in phase.holding:
            deep = (gap[1:, i] < -close[i]) | ((gap[1:, i] < 0) & (task.h * rate[1:, i] < 0))
            slope = rate[:, i] * task.h
            happens |= deep | (lowest(gap[:-1, i], gap[1:, i], slope[:-1], slope[1:])[1] < 0)
    if phase.holding:
        u = task.u[at.k : at.k + len(states), -1] if task.u.shape[1] == 1 else _at_ends(rule, task, at.k, len(states))
        lam = multipliers_along(system, phase, q[1:], v[1:], u, t[1:], task.c)
        held = lam[:, [first_contact(system) + i for i in phase.holding]]
        happens |= (held < -PULL * np.abs(lam).max(axis=1, initial=0.0)[:, None]).any(axis=1)
    return int(np.argmax(happens)) if happens.any() else len(states)


def _at_ends(rule: Rule, task: Task, k: int, count: int) -> np.ndarray:
    """Controls at the ends of steps."""
    return lagrange_values(np.array(rule.nodes), np.ones(1))[0] @ task.u[k : k + count]


def _passed(system: System, rule: Rule, task: Task, at: Position, here: View) -> tuple[Block, View | None]:
    """From an instant in step k to the next event, or to node k + 1: a block of that one node, and the view there."""
    assert at.phase is not None and at.t is not None
    if at.events >= MOST_EVENTS:
        raise StepRefused(f"more than {MOST_EVENTS} events in the step after t = {at.t:g}: take a smaller h")
    n, k, end = system.structure.n, at.k, task.t0 + task.h * (at.k + 1)
    now = Instant(at.t, at.x[: 4 * n], at.phase)
    passage = Passage(system, rule, task, now, here, at.scale, k)
    reached, happens, lets_go = earliest(passage, end - now.t)
    there, seen = reached.now, reached.seen
    if not (reached.residual <= RESIDUAL_LIMIT and reached.is_finite):
        nothing, failed = np.empty((0, n)), reached.residual if reached.is_finite else float("nan")
        return Block(np.array([k + 1]), nothing, nothing, 0.0, 0, failed, np.empty(0), now.phase, after=at), None
    if reached.ahead == end - now.t or abs(end - there.t) <= LOCATED * abs(end):
        there, k = replace(there, t=end), k + 1
    events: list[Event] = []
    released: frozenset[int] = frozenset()
    if lets_go is not None:
        events.append(Event(there.t, "detachment", lets_go, 0.0, seen.energy, seen.energy))
        kept = tuple(i for i in there.phase.holding if i != lets_go)
        there, released = replace(there, phase=replace(there.phase, contacts=kept, holding=kept)), frozenset({lets_go})
    if happens:
        setting, tired = Setting(system, task.c, reached.u, task.h, passage.reach), at.events >= MOST_IMPACTS
        there, seen, more = settle(setting, there, seen, released=released, tired=tired)
        events += more
    after = position(system, rule, task, there, k, at)
    after = after._replace(events=at.events + 1 if k == at.k else 0)
    return _node(after, reached.residual, tuple(events), reached.iterations), seen


def _node(after: Position, residual: float, events: tuple[Event, ...], iterations: int) -> Block:
    n = len(after.scale) // 2
    q, p, t = after.x[None, :n], after.x[None, 2 * n : 3 * n], np.array([after.t])
    return Block(np.array([after.k]), q, p, residual, 1, 0.0, t, after.phase, events, iterations, after)

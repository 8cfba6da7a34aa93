"""The time loop with contacts: blocks of steps as long as nothing happens, then back to the step where it did.

A step in which a gap closes or a multiplier changes sign is cut there by sub-steps of the same rule; after the event
the grid goes on where it would have been.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from varint.arrays import call, over_columns
from varint.errors import InputError
from varint.legendre import velocity_function
from varint.manifold import Phase, multipliers_along
from varint.rules import Rule
from varint.stepping.contact import (
    MOST_IMPACTS,
    PULL,
    TOUCH,
    Instant,
    View,
    gap_function,
    instant_function,
    settle,
    view,
)
from varint.stepping.events import root
from varint.stepping.run import RESIDUAL_LIMIT, Block, Task, run
from varint.stepping.step_function import counting_step_function
from varint.system import System
from varint.trajectory import Event

LONGEST = 1000  # steps between two looks at the contacts
HALVINGS = 50

# ahead → the instant that much later in the same phase, residual and iterations of that sub-step
Advance = Callable[[float], tuple[Instant, float, int]]


def contact_run(system: System, rule: Rule, task: Task) -> Iterator[Block]:
    """The run of a scene with contacts, block after block; event nodes lie between the nodes of the grid."""
    unsaid = 0  # iterations of steps none of whose nodes is kept
    for found in _every_node(system, rule, task):
        block = replace(found, iterations=found.iterations + unsaid)
        unsaid = 0
        wanted = (block.k % task.save_every == 0) | (block.k == task.steps)
        if task.save_every == 1 or block.events or block.good < len(block.k):
            yield block
        elif wanted.any():
            assert block.t is not None
            k, q, p = (x[wanted] for x in (block.k, block.q, block.p))
            yield replace(block, k=k, q=q, p=p, t=block.t[wanted], good=len(k))
        else:
            unsaid = block.iterations


def _every_node(system: System, rule: Rule, task: Task) -> Iterator[Block]:
    phase = task.phase or Phase(tuple(range(system.constraint.numel())))
    now, events = settle(system, Instant(task.t0, task.q0, task.p0, phase), task.c, _controls(task, 0), task.h)
    yield Block(
        np.zeros(1, dtype=int), now.q[None], now.p[None], 0.0, 1, 0.0, np.array([now.t]), now.phase, tuple(events)
    )
    k, size = 0, 10
    while k < task.steps:
        count = min(size, task.steps - k)
        count = 10 ** int(np.log10(count) + 1e-9)
        part = replace(task, q0=now.q, p0=now.p, first=k, steps=k + count, save_every=1)
        block = next(run(now.phase.scene(system), rule, part))
        quiet = _first_event(system, now, block, task)
        if quiet == block.good:
            times = task.t0 + task.h * block.k[:quiet]
            yield replace(block, t=times, phase=now.phase)
            if block.good < len(block.k):
                return
            k, size = k + count, min(10 * size, LONGEST)
            now = Instant(float(times[-1]), block.q[-1], block.p[-1], now.phase)
            continue
        size = 10
        if quiet:
            times = task.t0 + task.h * block.k[:quiet]
            assert block.counts is not None
            yield replace(
                block, k=block.k[:quiet], q=block.q[:quiet], p=block.p[:quiet], good=quiet, t=times, phase=now.phase,
                iterations=int(block.counts[quiet - 1]),
            )  # fmt: skip
            k += quiet
            now = Instant(float(times[-1]), block.q[quiet - 1], block.p[quiet - 1], now.phase)
        for passed in _through(system, rule, task, now, k):
            yield passed
            if not passed.good:
                return
            assert passed.t is not None and passed.phase is not None
            now = Instant(float(passed.t[-1]), passed.q[-1], passed.p[-1], passed.phase)
        k += 1


def _controls(task: Task, k: int) -> np.ndarray:
    """Controls at the start of step k."""
    return np.ascontiguousarray(task.u[min(k, len(task.u) - 1), 0])


def _first_event(system: System, now: Instant, block: Block, task: Task) -> int:
    """Number of nodes of the block before the first step in which a contact closes or lets go."""
    good = block.good
    q, p = np.vstack([now.q, block.q]), np.vstack([now.p, block.p])
    t = np.concatenate([[now.t], task.t0 + task.h * block.k[:good]])
    v = over_columns(velocity_function(now.phase.scene(system)), q, p, t[:, None], task.c)[0]
    u = np.array([_controls(task, int(i)) for i in range(block.k[0] - 1, block.k[0] + good)])
    happens = _crossings(system, now, q, v, u, t, task)
    return int(np.argmax(happens)) if happens.any() else good


def _crossings(system: System, now: Instant, q, v, u, t, task: Task) -> np.ndarray:
    """In which of the intervals between the nodes does a contact close or let go?"""
    gap, rate = over_columns(instant_function(system), q, v, t[:, None], task.c)[:2]
    size = view(system, now, task.c).size
    loose = [i for i in range(gap.shape[1]) if i not in now.phase.holding]
    happens = np.zeros(len(q) - 1, dtype=bool)
    for i in loose:
        deep = (gap[1:, i] < -TOUCH * size[i]) | ((gap[1:, i] < 0) & (rate[1:, i] < 0))
        happens |= deep | (_dip(gap[:, i], rate[:, i], np.diff(t))[1] < 0)
    if now.phase.holding:
        lam = multipliers_along(system, now.phase, q, v, u, t, task.c)
        first = lam.shape[1] - gap.shape[1]
        held = lam[:, [first + i for i in now.phase.holding]]
        happens |= (held[1:] < -PULL * np.abs(lam[1:]).max(axis=1, initial=0.0)[:, None]).any(axis=1)
    return happens


def _dip(gap: np.ndarray, rate: np.ndarray, h: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Where in each interval the cubic through gaps and rates is least, and how much; 1 for an end."""
    a, b, ra, rb = gap[:-1], gap[1:], rate[:-1] * h, rate[1:] * h
    c3, c2 = 2 * (a - b) + ra + rb, 3 * (b - a) - 2 * ra - rb
    spread = np.sqrt(np.maximum(c2**2 - 3 * c3 * ra, 0))
    with np.errstate(divide="ignore", invalid="ignore"):
        s = np.where(c2 + spread != 0, -ra / (c2 + spread), 0.5)
    s = np.clip(np.nan_to_num(s, nan=0.5), 0, 1)
    inner = (ra < 0) & (rb > 0)
    return s, np.where(inner, a + s * (ra + s * (c2 + s * c3)), 1.0)


def _through(system: System, rule: Rule, task: Task, now: Instant, k: int) -> Iterator[Block]:
    """From node k to node k + 1 through all events between; a block for each event and one for the node."""
    end, u = task.t0 + task.h * (k + 1), _controls(task, k)
    for count in range(10 * MOST_IMPACTS):
        advance = _advance(system, rule, task, now, k)
        left = end - now.t
        found = _earliest(system, now, advance, left, task, u) if left * task.h > 0 else None
        if found is None:
            there, residual, count = advance(left) if left * task.h > 0 else (now, 0.0, 0)
            yield _node(k + 1, replace(there, t=end), residual, (), count)
            return
        ahead, lets_go = found
        there, residual, count = advance(ahead) if ahead else (now, 0.0, 0)
        if not residual <= RESIDUAL_LIMIT:
            yield _node(k, there, residual, (), count)
            return
        energy = view(system, there, task.c).energy
        events = [] if lets_go is None else [Event(there.t, "detachment", lets_go, 0.0, energy, energy)]
        if lets_go is not None:
            kept = tuple(i for i in there.phase.holding if i != lets_go)
            there = replace(there, phase=replace(there.phase, contacts=kept, holding=kept))
        released = frozenset() if lets_go is None else frozenset({lets_go})
        now, more = settle(system, there, task.c, u, task.h, released=released, tired=count >= MOST_IMPACTS)
        yield _node(k, now, residual, (*events, *more), count)
    raise InputError(f"more than {10 * MOST_IMPACTS} events in the step after t = {now.t:g}: take a smaller h")


def _node(k: int, now: Instant, residual: float, events: tuple[Event, ...], count: int) -> Block:
    good = int(residual <= RESIDUAL_LIMIT)
    q, p, t = (x[:good] for x in (now.q[None], now.p[None], np.array([now.t])))
    worst, failed = (residual, 0.0) if good else (0.0, residual)
    return Block(np.array([k]), q, p, worst, good, failed, t, now.phase, events, good * count)


def _advance(system: System, rule: Rule, task: Task, now: Instant, k: int) -> Advance:
    """Sub-steps from an instant within step k."""
    step = counting_step_function(now.phase.scene(system), rule)
    u = np.ascontiguousarray(task.controls(k, 1)).ravel()

    def advance(ahead: float) -> tuple[Instant, float, int]:
        q, p, residual, count = call(step, now.q, now.p, u, task.c, np.array([now.t]), np.array([ahead]))
        return Instant(now.t + ahead, q, p, now.phase), float(residual[0]), int(count[0])

    return advance


def _earliest(system: System, now: Instant, advance, left: float, task: Task, u) -> tuple[float, int | None] | None:
    """(time ahead, contact that lets go or None for one that closes) of the first event in the rest of the step."""
    there = advance(left)[0]
    here, then = view(system, now, task.c), view(system, there, task.c)
    found: list[tuple[float, int | None]] = []
    for i in range(len(here.gap)):
        if i not in now.phase.holding:
            ahead = _closing(system, i, here, then, advance, left, task)
            found += [] if ahead is None else [(ahead, None)]
    for i in now.phase.holding:

        def push(ahead: float, i: int = i) -> float:
            return _push(system, advance(ahead)[0] if ahead else now, i, task, u)

        end = push(left)
        if end < 0:
            begin = push(0.0)
            found.append((root(push, 0.0, left, begin, end) if begin > 0 else 0.0, i))
    return min(found, key=lambda x: abs(x[0]), default=None)


def _push(system: System, at: Instant, contact: int, task: Task, u: np.ndarray) -> float:
    """Multiplier of a contact that holds."""
    slot = system.constraint.numel() + system.nonholonomic.shape[0] + contact
    t = np.array([at.t])
    v = call(velocity_function(at.phase.scene(system)), at.q, at.p, t, task.c)[0]
    return float(multipliers_along(system, at.phase, at.q[None], v[None], u[None], t, task.c)[0, slot])


def _closing(system: System, i: int, here: View, then: View, advance, left: float, task: Task) -> float | None:
    """Time ahead at which gap i closes, None if it does not."""

    def gap(ahead: float) -> float:
        at = advance(ahead)[0]
        return float(call(gap_function(system), at.q, np.array([at.t]), task.c)[0][i])

    b, fb = left, float(then.gap[i])
    if fb > -TOUCH * here.size[i] and not (fb < 0 and then.rate[i] < 0):
        gaps, rates = np.array([here.gap[i], then.gap[i]]), np.array([here.rate[i], then.rate[i]])
        where, depth = _dip(gaps, rates, np.array([left]))
        b = float(where[0]) * left
        fb = gap(b) if depth[0] < 0 else 1.0
        if not fb < 0:
            return None
    if here.gap[i] > TOUCH * here.size[i]:
        return root(gap, 0.0, b, float(here.gap[i]), fb)
    a = b  # it has just bounced: begin where it is off the contact
    for _ in range(HALVINGS if here.rate[i] > 0 else 0):
        a /= 2
        fa = gap(a)
        if fa > 0:
            return root(gap, a, b, fa, fb)
        b, fb = a, fa
    return 0.0

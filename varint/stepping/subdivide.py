"""The automatic remedy for a step that fails: equal parts of it instead."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import TypeVar

import numpy as np

from varint.arrays import call
from varint.discrete import energy_function
from varint.legendre import velocity_function
from varint.polynomials import lagrange_values
from varint.rules import Rule
from varint.stepping.plan import plan
from varint.stepping.run import Block, Position, Task, beginning, counted, good_nodes, is_saved, size
from varint.system import System
from varint.trajectory import Event

T = TypeVar("T")

AGREED = 1e-8  # of the way of the step
COARSE = 1e-2  # of it: as many parts as there may be agree with half of them at least so far, or nothing is known
MOST_PARTS = 1024  # of a step: what still fails then is a singularity, not a step that is too large


def around_failures(
    blocks: Callable[[Position | None], Iterator[Block]],
    divided: Callable[[Position], list[Block]],
    steps: int,
    at: Position | None,
) -> Iterator[Block]:
    """The run that `blocks` makes from a position on, each failure followed by the blocks that go around it."""
    while True:
        block = None
        for block in blocks(at):
            yield block._replace(k=block.k[: block.good])
        if block is None or block.after is None or block.after.k == steps:
            return
        around = divided(block.after)
        yield from around
        if around[-1].good < len(around[-1].k):
            return
        at = around[-1].after


def in_parts(rule: Rule, task: Task, k: int, began: float, left: float, parts: int) -> Task:
    """What is `left` of step k from a time on, as a run of its own; controls as `Trajectory.at` has them."""
    u = task.u[k]
    if len(u) == 1:
        u = np.broadcast_to(u, (parts, *u.shape))
    else:
        nodes, passed = np.array(rule.nodes), (began - task.t0) / task.h - k
        at = passed + left / task.h / parts * (np.arange(parts)[:, None] + nodes)
        u = (lagrange_values(nodes, at.ravel()) @ u).reshape(parts, *u.shape)
    return task._replace(t0=began, h=left / parts, steps=parts, save_every=1, first=0, u=u)


def agreeing(attempt: Callable[[int], tuple[np.ndarray | None, T]], start: np.ndarray) -> tuple[T, int]:
    """What an attempt with 2, 4, … parts found, and how many: enough to be solved and to agree with half of them.

    An attempt returns the coordinates where it ended, None where it failed, and what it found on the way. No parts are
    returned where even the most of them do not agree.
    """
    parts, before = 1, None
    while True:
        parts *= 2
        end, found = attempt(parts)
        apart, way = np.inf, 0.0
        if end is not None and before is not None:
            apart, way = np.abs(end - before).max(), np.abs(end - start).max()
        if apart <= AGREED * way or parts == MOST_PARTS:
            return found, parts if apart <= COARSE * way else 0
        before = end


def subdivided(system: System, rule: Rule, task: Task, at: Position) -> Block:
    """The steps from a position to the next node, those that fail replaced by 2, 4, 8, … parts.

    A part is a step of the same rule, but changing h costs the long-time guarantees of a symplectic method around it.
    Start, parts and end of such a step become nodes of the trajectory, so its dense output stays right.
    """
    n, end = system.structure.n, min((at.k // task.save_every + 1) * task.save_every, task.steps)
    if not at.scale.size:  # of a compiled run: q and p alone
        q, p = at.x.reshape(2, n)
        at = beginning(system, rule, task._replace(q0=q, p0=p, first=at.k))
    nodes: list[tuple[int, float, np.ndarray]] = []  # whole steps, time, state
    divided: list[Event] = []
    x, k, worst, failed, iterations = at.x, at.k, 0.0, 0.0, 0
    while k < end:
        states, parts = _divided(system, rule, task, k, x, at.scale)
        if not parts:
            failed = size(states[-1])
            break
        t = task.t0 + task.h * (k + np.arange(1, parts + 1) / parts)
        if parts > 1:
            began = float(task.t0 + task.h * k)
            energies = [_energy(system, time, state, task.c) for time, state in ((began, x), (t[-1], states[-1]))]
            divided.append(division(began, parts, *energies))
            if not is_saved(k, task.steps, task.save_every) and (not nodes or nodes[-1][0] < k):
                nodes.append((k, began, x))
            nodes += [(k, float(t[j]), states[j]) for j in range(parts - 1)]
        k += 1
        iterations += _iterations(system, rule, x, states, parts)
        worst = max(worst, float(states[:, -1].max()))
        x = _restarted(system, rule, task, k, states[-1]) if parts > 1 else states[-1].copy()
        x[-1] = 0.0
        if parts > 1 or is_saved(k, task.steps, task.save_every):
            nodes.append((k, task.t0 + task.h * k, x))
    saved = np.array([x for _, _, x in nodes]).reshape(len(nodes), len(x))
    counts = [i for i, _, _ in nodes] + ([k + 1] if k < end else [])
    return Block(
        np.array(counts, dtype=int), saved[:, :n], saved[:, 2 * n : 3 * n], worst, len(nodes), failed,
        np.array([t for _, t, _ in nodes]), None, tuple(divided), iterations, at._replace(x=x, k=k, largest=1),
    )  # fmt: skip


def division(began: float, parts: int, before: float, after: float) -> Event:
    """The event of a step that was divided."""
    return Event(began, f"divided in {parts}", None, 0.0, before, after)


def _iterations(system: System, rule: Rule, x: np.ndarray, states: np.ndarray, parts: int) -> int:
    """Iterations of a whole step from x, or of its parts, which are counted from zero."""
    return int(counted(system, rule, x if parts == 1 else np.zeros(len(x)), states)[-1])


def _divided(
    system: System, rule: Rule, task: Task, k: int, x: np.ndarray, scale: np.ndarray
) -> tuple[np.ndarray, int]:
    """States at the ends of the parts of step k, and how many: one, or enough, or none where no number is enough."""
    states, n = _one_step(system, rule, task, k, x, scale), system.structure.n
    if good_nodes(states) == 1:
        return states, 1

    def attempt(parts: int) -> tuple[np.ndarray | None, np.ndarray]:
        states = _parts(system, rule, task, k, x, scale, parts)
        return states[-1, :n] if good_nodes(states) == len(states) else None, states

    return agreeing(attempt, x[:n])


def _energy(system: System, t: float, x: np.ndarray, c: np.ndarray) -> float:
    n = system.structure.n
    q, p, time = x[:n].copy(), x[2 * n : 3 * n].copy(), np.array([t])
    v = call(velocity_function(system), q, p, time, c)[0]
    return float(call(energy_function(system), q, v, time, c)[0][0])


def _one_step(system: System, rule: Rule, task: Task, k: int, x: np.ndarray, scale: np.ndarray) -> np.ndarray:
    step = plan(system, rule).build(system, rule).step
    t, h = np.array([task.t0 + task.h * k]), np.array([task.h])
    return call(step, x, task.controls(k, 1), t, h, task.c, scale)[0][None]


def _parts(system: System, rule: Rule, task: Task, k: int, x: np.ndarray, scale: np.ndarray, parts: int) -> np.ndarray:
    """States at the ends of the parts of step k, up to the first that is not solved."""
    small = in_parts(rule, task, k, task.t0 + task.h * k, task.h, parts)
    states = []
    x = _restarted(system, rule, small, 0, x)
    for j in range(parts):
        state = _one_step(system, rule, small, j, x, scale)
        states.append(state[0])
        if not good_nodes(state):
            break
        x = state[0]
    return np.array(states)


def _restarted(system: System, rule: Rule, task: Task, k: int, x: np.ndarray) -> np.ndarray:
    """The state at the same node for steps of another size: compensations kept, the stepper's memory made anew."""
    n, stepper = system.structure.n, plan(system, rule).build(system, rule)
    t, h = np.array([task.t0 + task.h * k]), np.array([task.h])
    u = task.controls(min(k, task.steps - 1), 1)
    fresh = call(stepper.start, x[:n].copy(), x[2 * n : 3 * n].copy(), u, t, h, task.c)[0]
    fresh[n : 2 * n], fresh[3 * n : 4 * n] = x[n : 2 * n], x[3 * n : 4 * n]
    return fresh

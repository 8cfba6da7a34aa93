"""The automatic remedy for a step that fails: equal parts of it instead."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from varint.arrays import call
from varint.discrete import energy_function
from varint.legendre import velocity_function
from varint.rules import Rule
from varint.stepping.plan import plan
from varint.stepping.run import Block, Position, Task, counted, good_nodes, is_saved, run, size
from varint.system import System
from varint.trajectory import Event

AGREED = 1e-8  # of the way of the step
MOST_PARTS = 1024  # of a step: what still fails then is a singularity, not a step that is too large


def around_failures(system: System, rule: Rule, task: Task, at: Position | None) -> Iterator[Block]:
    """The run, each block that failed followed by one that goes around the failure."""
    while True:
        block = None
        for block in run(system, rule, task, at):
            yield block._replace(k=block.k[: block.good])
        if block is None or block.after is None or block.after.k == task.steps:
            return
        around = subdivided(system, rule, task, block.after)
        yield around
        if around.good < len(around.k):
            return
        at = around.after


def subdivided(system: System, rule: Rule, task: Task, at: Position) -> Block:
    """The steps from a position to the next node, those that fail replaced by 2, 4, 8, … parts.

    A part is a step of the same rule, but changing h costs the long-time guarantees of a symplectic method around it.
    Start, parts and end of such a step become nodes of the trajectory, so its dense output stays right.
    """
    n, end = system.structure.n, min((at.k // task.save_every + 1) * task.save_every, task.steps)
    nodes: list[tuple[int, float, np.ndarray]] = []  # whole steps, time, state
    divided: list[Event] = []
    x, k, worst, failed, iterations = at.x, at.k, 0.0, 0.0, 0
    while k < end:
        states, parts = _divided(system, rule, task, k, x, at.scale)
        if good_nodes(states) < len(states):
            failed = size(states[-1])
            break
        t = task.t0 + task.h * (k + np.arange(1, parts + 1) / parts)
        if parts > 1:
            began = float(task.t0 + task.h * k)
            energies = [_energy(system, time, state, task.c) for time, state in ((began, x), (t[-1], states[-1]))]
            divided.append(Event(began, f"divided in {parts}", None, 0.0, *energies))
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


def _iterations(system: System, rule: Rule, x: np.ndarray, states: np.ndarray, parts: int) -> int:
    """Iterations of a whole step from x, or of its parts, which are counted from zero."""
    return int(counted(system, rule, x if parts == 1 else np.zeros(len(x)), states)[-1])


def _divided(
    system: System, rule: Rule, task: Task, k: int, x: np.ndarray, scale: np.ndarray
) -> tuple[np.ndarray, int]:
    """States at the ends of the parts of step k, and how many: one, or enough to be solved and to agree with half."""
    states, parts = _one_step(system, rule, task, k, x, scale), 1
    if good_nodes(states) == 1:
        return states, 1
    n, before = system.structure.n, None
    while parts < MOST_PARTS:
        parts *= 2
        states = _parts(system, rule, task, k, x, scale, parts)
        if good_nodes(states) < len(states):
            continue
        end = states[-1, :n]
        if before is not None and np.abs(end - before).max() <= AGREED * np.abs(end - x[:n]).max():
            break
        before = end
    return states, parts


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
    small = task._replace(
        h=task.h / parts, u=np.broadcast_to(task.u[k], (parts, *task.u.shape[1:])), t0=task.t0 + task.h * k
    )
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

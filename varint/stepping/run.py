"""The time loop: blocks of steps inside CasADi, checked one by one."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, NamedTuple

import casadi as ca
import numpy as np

from varint.arrays import call, over_columns
from varint.rules import Rule
from varint.stepping.pace import steps_at_once
from varint.stepping.plan import plan
from varint.stepping.step_function import SMALLEST, inertia_function, scale_function
from varint.system import System, per_system
from varint.trajectory import Event

if TYPE_CHECKING:
    from varint.manifold import Phase

RESIDUAL_LIMIT = 1e-10  # relative to the momenta; converged steps have 1e-16 to 1e-13
LARGEST_BLOCK = 1000  # nodes between two looks at the run
LARGE_STATE = 300  # numbers; CasADi takes long to build a long loop over a large state


class Task(NamedTuple):
    """What the time loop needs: start, grid, controls (steps, r or 1, k) at the `nodes`, parameters; what holds."""

    q0: np.ndarray
    p0: np.ndarray
    t0: float
    h: float
    steps: int
    save_every: int
    u: np.ndarray
    c: np.ndarray
    nodes: int
    phase: Phase | None = None
    first: int = 0
    level: float = 0.0  # relative error of a step's unknowns where a compiled iteration may stop; 0: round-off

    def controls(self, k: int, count: int) -> np.ndarray:
        """Controls of `count` steps from step k on, at every node."""
        u = self.u[k : k + count]
        if not u.size:
            return np.empty((len(u), self.nodes, 0))
        return np.ascontiguousarray(np.broadcast_to(u, (len(u), self.nodes, u.shape[2])))


class Position(NamedTuple):
    """Where a run stands between two blocks: all that it needs to go on as if it had not stopped.

    The stepper's state x, typical sizes of v and p and the inertia between them, k steps taken, and how many nodes the
    next block may have (few after a failure). Of a compiled run: q and p as x, what its loop carries along, and whether
    Newton's method has taken over from fixed-point iteration. Of a run with contacts: when it is, what holds, and
    how many events there were in step k.
    """

    x: np.ndarray
    scale: np.ndarray
    inertia: np.ndarray
    k: int
    largest: int
    carry: np.ndarray | None = None
    by_newton: bool = False
    t: float | None = None
    phase: Phase | None = None
    events: int = 0


class Block(NamedTuple):
    """Some saved nodes: step counts k, coordinates, momenta.

    The first `good` of them are solved, with `residual` the worst among them; `failed` is that of the next one. Scenes
    with contacts also say when the nodes are (`t`), what holds from there on (`phase`) and what happened before them.
    `iterations` are those of Newton's method, or of the stages, in the solved steps; `counts` the sums up to each node,
    where runs may be cut. The run goes on from `after`, where it can be taken up again.
    """

    k: np.ndarray
    q: np.ndarray
    p: np.ndarray
    residual: float
    good: int
    failed: float = 0.0
    t: np.ndarray | None = None
    phase: Phase | None = None
    events: tuple[Event, ...] = ()
    iterations: int = 0
    after: Position | None = None
    counts: np.ndarray | None = None


@per_system
def rollout(system: System, rule: Rule, nodes: int, every: int) -> ca.Function:
    """(x, u, t, h, c, scale) → states at `nodes` nodes, `every` steps apart."""
    stepper = plan(system, rule).build(system, rule)
    step = stepper.step
    if nodes * every == 1:
        return step
    sizes = [step.numel_in(i) for i in range(step.n_in())]
    x, u, t, h, c, scale = (
        ca.MX.sym(f"a{i}", size, nodes * every if i in (1, 2) else 1) for i, size in enumerate(sizes)
    )
    inner = step.fold(every) if every > 1 else step
    rolled = inner.mapaccum(f"roll_{nodes}_{every}", nodes) if nodes > 1 else inner
    states = rolled(x, u, t, *(ca.repmat(a, 1, nodes * every) for a in (h, c, scale)))
    return ca.Function("rollout", [x, u, t, h, c, scale], [states])


def beginning(system: System, rule: Rule, task: Task) -> Position:
    """The position before the first step."""
    u, t = task.controls(task.first, 1).reshape(1, -1), task.t0 + task.h * task.first
    typical = np.abs(task.u).max(axis=(0, 1), initial=0.0)[None]
    one = beginning_rows(system, rule, task.q0[None], task.p0[None], u, typical, t, np.array([task.h]), task.c[None])
    return one._replace(x=one.x[0], scale=one.scale[0], inertia=one.inertia[0], k=task.first)


def beginning_rows(
    system: System,
    rule: Rule,
    q0: np.ndarray,
    p0: np.ndarray,
    u: np.ndarray,
    typical: np.ndarray,
    t0: float,
    h: np.ndarray,
    c: np.ndarray,
) -> Position:
    """The positions of several motions before the first step; arrays have the motions first.

    `u` are the controls of the first step, `typical` the largest sizes of each control during the run.
    """
    t = np.full((len(q0), 1), t0)
    x, scale, inertia = over_columns(_beginning_function(system, rule), q0, p0, u, typical, t, h, c)
    return Position(x, scale, inertia, 0, largest_block(x[0]))


@per_system
def _beginning_function(system: System, rule: Rule) -> ca.Function:
    """(q0, p0, u, typical, t, h, c) → x, typical sizes, and the inertia between them."""
    start, n = plan(system, rule).build(system, rule).start, system.structure.n
    sizes = (n, n, start.numel_in(2), system.structure.controls, 1, 1, system.c.numel())
    q, p, u, typical, t, h, c = inputs = [ca.MX.sym(f"a{i}", size) for i, size in enumerate(sizes)]
    scale = scale_function(system)(q, p, typical, t, h, c)
    outputs = [start(q, p, u, t, h, c), scale, inertia_function(system)(q, p, t, c)]
    return ca.Function("beginning", inputs, outputs)


def run(system: System, rule: Rule, task: Task, at: Position | None = None) -> Iterator[Block]:
    """The run from a position on, block after block; it ends with the first block that is not wholly good."""
    n, h, most = system.structure.n, np.array([task.h]), steps_at_once(system, rule)
    at = beginning(system, rule, task) if at is None else at
    while at.k < task.steps:
        count, every = next_block(at.k, task.steps, task.save_every, at.largest, most)
        total = count * every
        times = task.t0 + task.h * np.arange(at.k, at.k + total)
        function = rollout(system, rule, count, every)
        states = call(function, at.x, task.controls(at.k, total), times, h, task.c, at.scale)[0].reshape(count, -1)
        good = int(good_nodes(states))
        worst = float(states[good - 1, -1]) if good else 0.0
        after, counts = advanced(at, states[:good], task.h, every), counted(system, rule, at.x, states[:good])
        k = at.k + every * np.arange(1, count + 1)
        if good == count and not is_saved(int(k[-1]), task.steps, task.save_every):  # within a long interval
            k, states = k[:0], states[:0]
        q, p = states[:good, :n], states[:good, 2 * n : 3 * n]
        failed = 0.0 if good == count else size(states[good])
        total = int(counts[-1]) if good else 0
        yield Block(k, q, p, worst, len(q), failed, iterations=total, after=after, counts=counts)
        if good < count:
            return
        at = after


def next_block(k: int, steps: int, every: int, largest: int, most: int) -> tuple[int, int]:
    """(nodes, steps between them) of the block after k steps: a power of ten of nodes, or of steps within an interval.

    It has at most so many nodes and steps (`steps_at_once`). It depends on the position alone, so a run that is taken
    up again has the blocks of the one that was not stopped.
    """
    whole = (steps - k) // every
    if k % every or not whole or every > most:
        return 1, _power_of_ten(min(every - k % every, steps - k, most))
    return _power_of_ten(min(whole, largest, max(most // every, 1))), every


def is_saved(k: int, steps: int, every: int) -> bool:
    """Whether the node after k steps is kept."""
    return k % every == 0 or k == steps


def good_nodes(states: np.ndarray) -> np.ndarray:
    """How many of the states (…, nodes, size), from the first on, are finite and solved."""
    good = np.isfinite(states).all(axis=-1) & (states[..., -1] <= RESIDUAL_LIMIT)
    return np.where(good.all(axis=-1), states.shape[-2], np.argmin(good, axis=-1))


def counted(system: System, rule: Rule, before: np.ndarray, states: np.ndarray) -> np.ndarray:
    """Iterations since the state `before`, at each of the states (nodes, size) that follow it."""
    iterates = plan(system, rule).build(system, rule).counts
    return states[:, -2] - before[-2] if iterates else np.zeros(len(states))


def advanced(at: Position, states: np.ndarray, h: float, every: int) -> Position:
    """The position after the solved states, (nodes, size)."""
    if not len(states):
        return at._replace(largest=1)
    x, k = states[-1].copy(), at.k + every * len(states)
    x[-1] = 0.0
    return at._replace(
        x=x, scale=rescaled(at, states, abs(h) * every), k=k, largest=min(10 * at.largest, largest_block(x))
    )


def largest_block(x: np.ndarray) -> int:
    """Nodes of a block: fewer where a state is large."""
    return LARGEST_BLOCK if x.size < LARGE_STATE else LARGEST_BLOCK // 10


def _power_of_ten(most: int) -> int:
    size = 1
    while 10 * size <= most:
        size *= 10
    return size


def size(state: np.ndarray) -> float:
    """Residual of a state that failed: NaN where the state itself is not finite."""
    return float(state[-1]) if np.isfinite(state).all() else float("nan")


def rescaled(at: Position, states: np.ndarray, apart: float) -> np.ndarray:
    """Typical sizes of velocities and momenta as the states (…, nodes, size) after `at` show; see `scale_function`."""
    n = at.inertia.shape[-1]
    q, p = states[..., :n], states[..., 2 * n : 3 * n]
    before = np.concatenate([at.x[..., None, :n], q[..., :-1, :]], axis=-2)
    v_size = np.maximum(np.abs(q - before).max(axis=-2) / apart, 0.1 * at.scale[..., :n])
    p_size = np.maximum(np.abs(p).max(axis=-2), 0.1 * at.scale[..., n:])
    root = np.sqrt(at.inertia)
    least = SMALLEST * (v_size * root).max(axis=-1, keepdims=True)
    v_size = np.maximum(v_size, least / root)
    return np.concatenate([v_size, np.maximum(p_size, v_size * at.inertia)], axis=-1)

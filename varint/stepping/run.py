"""The time loop: blocks of steps inside CasADi, checked one by one."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import casadi as ca
import numpy as np

from varint.arrays import blocks, call
from varint.manifold import Phase
from varint.rules import Rule
from varint.stepping.plan import plan
from varint.stepping.step_function import SMALLEST, scale_function
from varint.system import System, per_system
from varint.trajectory import Event

RESIDUAL_LIMIT = 1e-10  # relative to the momenta; converged steps have 1e-16 to 1e-13
LARGEST_BLOCK = 1000  # nodes between two looks at the run
LARGE_STATE = 300  # numbers; CasADi takes long to build a long loop over a large state
MOST_STEPS_IN_BLOCK = 100_000


@dataclass(frozen=True, eq=False)
class Task:
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
        return np.ascontiguousarray(np.broadcast_to(u, (len(u), self.nodes, u.shape[2])))


@dataclass(frozen=True, eq=False)
class Block:
    """Some saved nodes: step counts k, coordinates, momenta.

    The first `good` of them are solved, with `residual` the worst among them; `failed` is that of the next one. Scenes
    with contacts also say when the nodes are (`t`), what holds from there on (`phase`) and what happened before them;
    compiled runs also count their iterations.
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


@per_system
def _rollout(system: System, rule: Rule, nodes: int, every: int) -> ca.Function:
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


def run(system: System, rule: Rule, task: Task) -> Iterator[Block]:
    """The run, block after block; it ends with the first block that is not wholly good."""
    stepper = plan(system, rule).build(system, rule)
    n, h, c = system.structure.n, np.array([task.h]), task.c
    t0 = np.array([task.t0 + task.h * task.first])
    typical = np.abs(task.u).max(axis=(0, 1), initial=0.0)
    scale = call(scale_function(system), task.q0, task.p0, typical, t0, h, c)[0]
    x = call(stepper.start, task.q0, task.p0, task.controls(task.first, 1), t0, h, c)[0]
    k = task.first
    largest = LARGEST_BLOCK if x.size < LARGE_STATE else LARGEST_BLOCK // 10
    for count, every in _grid(task.steps - task.first, task.save_every, largest):
        total = count * every
        times = task.t0 + task.h * np.arange(k, k + total)
        function = _rollout(system, rule, count, every)
        states = call(function, x, task.controls(k, total), times, h, c, scale)[0].reshape(count, -1)
        finite = np.isfinite(states).all(axis=1) & (states[:, -1] <= RESIDUAL_LIMIT)
        good = count if finite.all() else int(np.argmin(finite))
        q, p = states[:, :n], states[:, 2 * n : 3 * n]
        residual = float(states[good - 1, -1]) if good else 0.0
        failed = 0.0 if good == count else _size(states[good])
        yield Block(k + every * np.arange(1, count + 1), q[:good], p[:good], residual, good, failed)
        if good < count:
            return
        scale = _rescaled(scale, q, p, abs(task.h) * every)
        x, k = states[-1].copy(), k + total
        x[-1] = 0.0


def _size(state: np.ndarray) -> float:
    """Residual of a state that failed: NaN where the state itself is not finite."""
    return float(state[-1]) if np.isfinite(state).all() else float("nan")


def _grid(steps: int, every: int, largest: int) -> Iterator[tuple[int, int]]:
    """Blocks (nodes, steps between nodes); a shorter last interval where `every` does not divide `steps`."""
    while largest > 1 and largest * every > MOST_STEPS_IN_BLOCK:
        largest //= 10
    for count in blocks(steps // every, largest):
        yield count, every
    if steps % every:
        yield 1, steps % every


def _rescaled(scale: np.ndarray, q: np.ndarray, p: np.ndarray, apart: float) -> np.ndarray:
    """Typical sizes of velocities and momenta as the last block (nodes, n) showed them; see `scale_function`."""
    n = q.shape[-1]
    speeds = np.abs(np.diff(q, axis=-2)).max(axis=-2, initial=0.0) / apart
    new = np.concatenate([speeds, np.abs(p).max(axis=-2, initial=0.0)], axis=-1)
    new = np.maximum(new, 0.1 * scale)
    root = np.sqrt(scale[..., n:] / scale[..., :n])  # of the inertia
    least = SMALLEST * (new[..., :n] * root).max(axis=-1, keepdims=True)
    return np.maximum(new, np.concatenate([least / root, least * root], axis=-1))

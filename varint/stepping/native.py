"""The compiled loops, handed on block by block; loaded with the first run that is compiled."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from time import perf_counter

import numpy as np

from varint.compiled.cache import CompileError
from varint.compiled.explicit import explicit_kernel
from varint.compiled.gauss import gauss_form, gauss_kernel
from varint.compiled.graph import NotCompilable
from varint.compiled.kernel import DONE, NOT_CONVERGED, Kernel
from varint.compiled.kernel import run as compiled_run
from varint.compiled.newton import CLOSED, newton_kernel
from varint.rules import MOST_STAGES, Rule, gauss
from varint.stepping.backend import UNKNOWN
from varint.stepping.run import Block, Position, Task, run
from varint.system import System, per_system

NODES_IN_BLOCK = 200_000  # of a compiled run between two looks at it
STEPS_IN_BLOCK = 2_000_000
PATIENCE = 0.2  # seconds that Ctrl-C may wait for a block
CAUTION = 1e-7  # seconds of an operation, for the first block; in truth it takes a hundredth to a tenth of it
NOTHING = np.empty(0)
PILOT = 1000  # steps at most after which fixed-point iteration must have shown that it contracts
QUICK = 12  # unknowns of Newton's method that compile in two seconds; time grows with their third power
COMPILING = 1e-3  # seconds of the compiler for an unknown cubed
POOR = 30  # iterations a step beyond which Newton's method is cheaper


@per_system
def kernel_of(system: System, rule: Rule) -> Kernel:
    """The compiled loop of a system and a rule.

    Kick and drift where they exist; all stages at once by fixed-point iteration for Gauss rules, which beats Newton's
    method by far except for the midpoint rule in few coordinates (double pendulum: 0.35 against 0.16 µs a step); else
    Newton's method.
    """
    s = system.structure
    if rule.kicks and s.explicit:
        return explicit_kernel(system, rule)
    if _has_stages(system, rule) and not s.linear and not (rule == gauss(1) and s.n <= CLOSED):
        return gauss_kernel(system, rule)
    return newton_kernel(system, rule)


def _has_stages(system: System, rule: Rule) -> bool:
    return rule == gauss(min(len(rule.nodes), MOST_STAGES)) and bool(gauss_form(system))


def native_blocks(
    system: System, rule: Rule, task: Task, kernel: Kernel, at: Position | None = None
) -> Iterator[Block]:
    """The compiled run block by block; where fixed-point iteration hardly contracts Newton's method takes over."""
    k, carry = (task.first, None) if at is None else (at.k, at.carry)
    q, p = (task.q0, task.p0) if at is None else (at.x[: len(at.x) // 2], at.x[len(at.x) // 2 :])
    taken_over = at is not None and at.by_newton
    if taken_over and carry is None:
        yield from _by_newton(system, rule, task._replace(q0=q, p0=p, first=k))
        return
    if taken_over:
        kernel = newton_kernel(system, rule)
    by_stages = kernel.opening is None and not rule.kicks
    piloted = by_stages and at is None
    most = max(int(PATIENCE / (CAUTION * max(kernel.operations * kernel.nodes, 1))), 1)
    most = min(PILOT, most) if piloted else most
    while k < task.steps:
        steps, every = _piece(k, task.steps, task.save_every, most)
        u, began = task.controls(k, steps) if kernel.controls else None, perf_counter()
        part = compiled_run(
            kernel, q, p, task.c,
            t0=task.t0, h=task.h, steps=steps, save_every=every, u=u, first=k, carry=carry, level=task.level,
        )  # fmt: skip
        per_step = max((perf_counter() - began) / max(part.steps, 1), 1e-12)
        poor = piloted and k == task.first and part.iterations > POOR * steps
        rows, x, k = part.rows[1:], part.last[: 2 * kernel.n].copy(), k + part.steps
        good, wanted = len(rows), steps // every
        if part.status == NOT_CONVERGED:
            wanted = good
        elif part.status != DONE:
            wanted = max(wanted, good + 1)
        started = k - part.steps
        counts = np.arange(started + every, started + every * wanted + 1, every)
        after = Position(x, NOTHING, NOTHING, k, 0, None if poor else part.carry, poor or taken_over)
        failed = 0.0 if part.status in (DONE, NOT_CONVERGED) else float("nan")
        after_it = None if part.status == NOT_CONVERGED else after
        q_rows, p_rows = rows[:, 0], rows[:, 1]
        yield Block(counts, q_rows, p_rows, 0.0, good, failed, None, None, (), part.iterations, after_it)
        if part.status == NOT_CONVERGED or (poor and part.status == DONE):
            if k < task.steps:
                q, p = np.split(x, 2)
                yield from _by_newton(system, rule, task._replace(q0=q, p0=p, first=k), by_stages)
            return
        if part.status != DONE:
            return
        carry = part.carry
        most = max(min(10 * most, int(PATIENCE / per_step)), 1)


def one_step(kernel: Kernel, task: Task, t: float, q: np.ndarray, p: np.ndarray, h: float) -> np.ndarray | None:
    """(q, p, v) after one step of its own size, (3, n); None where the iteration does not converge."""
    part = compiled_run(kernel, q, p, task.c, t0=t, h=h, steps=1)
    return part.rows[1] if part.status == DONE else None


def _by_newton(system: System, rule: Rule, task: Task, compiled: bool = True) -> Iterator[Block]:
    """The rest of a run on which an iteration failed: by the compiled Newton's method, then the interpreted one."""
    kernel, unknowns = None, system.structure.n * rule.degree
    if compiled and (unknowns <= QUICK or task.steps * unknowns * UNKNOWN > COMPILING * unknowns**3):
        with suppress(NotCompilable, CompileError):
            kernel = newton_kernel(system, rule)
    if kernel is None:
        yield from run(system, rule, task)
        return
    for block in native_blocks(system, rule, task, kernel):
        at = block.after
        if at is not None and at.carry is not None:  # not handed on to the interpreted one
            block = block._replace(after=at._replace(by_newton=True))
        yield block


def _piece(k: int, steps: int, every: int, most: int) -> tuple[int, int]:
    """(steps, save_every) of the next call after k steps: whole intervals, or at most what is left of one.

    How long a piece is shows in nothing, for a compiled run goes on as if it had not stopped.
    """
    left, inside = steps - k, k % every
    most = min(most, STEPS_IN_BLOCK, NODES_IN_BLOCK * every)
    if inside or min(left, most) < every:
        gap = min(every - inside, left)
        return min(gap, most), gap
    return min(left, most) // every * every, every

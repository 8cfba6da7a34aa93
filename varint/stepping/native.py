"""The compiled loops, handed on block by block; loaded with the first run that is compiled."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace

import numpy as np

from varint.compiled.cache import CompileError
from varint.compiled.explicit import explicit_kernel
from varint.compiled.gauss import gauss_form, gauss_kernel
from varint.compiled.graph import NotCompilable
from varint.compiled.kernel import DONE, NOT_CONVERGED, Kernel
from varint.compiled.kernel import run as compiled_run
from varint.compiled.newton import CLOSED, newton_kernel
from varint.rules import MOST_STAGES, Rule, gauss
from varint.stepping.run import Block, Position, Task, run
from varint.system import System, per_system

NODES_IN_BLOCK = 200_000  # of a compiled run between two looks at it
STEPS_IN_BLOCK = 2_000_000
NOTHING = np.empty(0)
PILOT = 1000  # steps after which fixed-point iteration must have shown that it contracts
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
        yield from _by_newton(system, rule, replace(task, q0=q, p0=p, first=k))
        return
    if taken_over:
        kernel = newton_kernel(system, rule)
    by_stages = kernel.opening is None and not rule.kicks
    for steps, every in _pieces(task.steps - k, task.save_every, by_stages and carry is None):
        u = task.controls(k, steps) if kernel.controls else None
        part = compiled_run(
            kernel, q, p, task.c,
            t0=task.t0, h=task.h, steps=steps, save_every=every, u=u, first=k, carry=carry, level=task.level,
        )  # fmt: skip
        rows = part.rows[1:]
        good, wanted = len(rows), -(-steps // every)
        if part.status == NOT_CONVERGED:
            wanted = good
        counts = np.arange(k + every, k + every * wanted + 1, every)
        if part.status == DONE:
            k, carry, x = k + steps, part.carry, part.last[: 2 * kernel.n]
            poor = by_stages and part.iterations > POOR * steps
            after = Position(x, NOTHING, NOTHING, k, 0, None if poor else carry, poor or taken_over)
            yield Block(counts, rows[:, 0], rows[:, 1], 0.0, good, iterations=part.iterations, after=after)
            if not poor:
                continue
        else:
            yield Block(counts, rows[:, 0], rows[:, 1], 0.0, good, float("nan"), iterations=part.iterations)
            if part.status != NOT_CONVERGED:
                return
            k += every * good
            x = part.rows[-1, :2].ravel()
        if k < task.steps:
            q, p = np.split(x, 2)
            yield from _by_newton(system, rule, replace(task, q0=q, p0=p, first=k), by_stages)
        return


def one_step(kernel: Kernel, task: Task, t: float, q: np.ndarray, p: np.ndarray, h: float) -> np.ndarray | None:
    """(q, p, v) after one step of its own size, (3, n); None where the iteration does not converge."""
    part = compiled_run(kernel, q, p, task.c, t0=t, h=h, steps=1)
    return part.rows[1] if part.status == DONE else None


def _by_newton(system: System, rule: Rule, task: Task, compiled: bool = True) -> Iterator[Block]:
    """The rest of a run on which an iteration failed: by the compiled Newton's method, then the interpreted one."""
    kernel = None
    if compiled:
        with suppress(NotCompilable, CompileError):
            kernel = newton_kernel(system, rule)
    if kernel is None:
        yield from run(system, rule, task)
        return
    for block in native_blocks(system, rule, task, kernel):
        at = block.after
        if at is not None and at.carry is not None:  # not handed on to the interpreted one
            block = replace(block, after=replace(at, by_newton=True))
        yield block


def _pieces(steps: int, every: int, pilot: bool) -> Iterator[tuple[int, int]]:
    """(steps, save_every) of each call; a shorter last interval where `every` does not divide `steps`.

    With a pilot the first piece is short: it shows whether the iteration contracts.
    """
    size = max(1, min(NODES_IN_BLOCK, STEPS_IN_BLOCK // every)) * every
    whole = steps // every * every
    first = min(whole, -(-PILOT // every) * every) if pilot and whole > PILOT else 0
    if first:
        yield first, every
    for done in range(first, whole, size):
        yield min(size, whole - done), every
    if steps % every:
        yield steps % every, steps % every

"""The compiled loops, handed on block by block; loaded with the first run that is compiled."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from varint.compiled.explicit import explicit_kernel
from varint.compiled.gauss import gauss_form, gauss_kernel
from varint.compiled.graph import NotCompilable
from varint.compiled.kernel import DONE, NOT_CONVERGED, Kernel
from varint.compiled.kernel import run as compiled_run
from varint.rules import MOST_STAGES, Rule, gauss
from varint.stepping.run import Block, Task, run
from varint.system import System

NODES_IN_BLOCK = 200_000  # of a compiled run between two looks at it
STEPS_IN_BLOCK = 2_000_000


def kernel_of(system: System, rule: Rule) -> Kernel:
    """The compiled loop of a system and a rule."""
    if rule.kicks and system.structure.explicit:
        return explicit_kernel(system, rule)
    if rule == gauss(min(len(rule.nodes), MOST_STAGES)) and gauss_form(system):
        return gauss_kernel(system, rule)
    raise NotCompilable(
        f"there is no compiled loop for {rule} on this scene: compositions need a separable scene with constant mass, "
        'gauss(s) a regular one without constraints and quadratic in the velocities; use backend="interpreted"'
    )


def native_blocks(system: System, rule: Rule, task: Task, kernel: Kernel) -> Iterator[Block]:
    """The compiled run block by block; Newton's method takes over where fixed-point iteration fails."""
    k, carry = task.first, None
    q, p = task.q0, task.p0
    c = np.ascontiguousarray(task.c)
    for steps, every in _pieces(task.steps - task.first, task.save_every):
        u = task.controls(k, steps) if kernel.controls else None
        part = compiled_run(
            kernel,
            q,
            p,
            c,
            t0=task.t0,
            h=task.h,
            steps=steps,
            save_every=every,
            u=u,
            first=k,
            carry=carry,
            level=task.level,
        )
        rows = part.rows[1:]
        good, wanted = len(rows), -(-steps // every)
        if part.status == NOT_CONVERGED:
            wanted = good
        if wanted:
            failed = 0.0 if part.status == DONE else float("nan")
            counts = k + every * np.arange(1, wanted + 1)
            yield Block(counts, rows[:, 0], rows[:, 1], 0.0, good, failed, iterations=part.iterations)
        if part.status == NOT_CONVERGED:
            q, p = part.rows[-1, :2]
            yield from run(system, rule, replace(task, q0=q.copy(), p0=p.copy(), first=k + every * good))
            return
        if part.status != DONE:
            return
        k, carry = k + steps, part.carry


def _pieces(steps: int, every: int) -> Iterator[tuple[int, int]]:
    """(steps, save_every) of each call; a shorter last interval where `every` does not divide `steps`."""
    size = max(1, min(NODES_IN_BLOCK, STEPS_IN_BLOCK // every)) * every
    whole = steps // every * every
    for done in range(0, whole, size):
        yield min(size, whole - done), every
    if steps % every:
        yield steps % every, steps % every

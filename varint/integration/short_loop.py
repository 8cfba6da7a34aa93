"""Compiled runs without a look at them on the way: as few calls of their loop as may be."""

from __future__ import annotations

import numpy as np

from varint.codegen.arguments import DONE
from varint.codegen.kernel import Kernel, LoopResult
from varint.codegen.kernel import run_loop as compiled_run
from varint.integration.compiled_loop import (
    PATIENCE,
    POOR,
    first_piece,
    most_after,
    next_piece,
    scheme_of,
)
from varint.integration.gears import BY_STAGES, gears_with, kernel_after, newton
from varint.integration.problem import InitialValueProblem
from varint.rules.rule import Rule
from varint.scene.system import System


def run_at_once(
    system: System,
    rule: Rule,
    problem: InitialValueProblem,
    kernel: Kernel,
    looks: tuple[np.ndarray, int] | None = None,
) -> LoopResult | None:
    """The compiled run from the problem's first step on without a look at it on the way; None where
    its iteration contracts so poorly that another loop should go on, or saved nodes lie further
    apart than the first steps.
    """
    scheme = newton() if kernel.opening else scheme_of(system, rule)
    piloted, gears = scheme is BY_STAGES, gears_with(system, rule, scheme, kernel)
    steps, every, most = problem.steps, problem.save_every, first_piece(kernel, piloted)
    parts: list[LoopResult] = []
    first = k = problem.first
    carry = None
    while k < steps:
        count = next_piece(k, steps, every, most)[0]
        if count % every:
            return None
        part = _piece(kernel, problem, k, count, carry, looks)
        parts.append(part)
        per_step = max(part.seconds / count, 1e-12)
        if gears:
            kernel = kernel_after(gears, part.seconds, per_step * (steps - k - count))
        if piloted and k == first and part.iterations > min(POOR, problem.most) * count:
            return None
        if part.status != DONE:
            break
        k, carry = k + count, part.carry
        most = most_after(most, per_step, gears, PATIENCE)
    if len(parts) == 1:
        return parts[0]
    return parts[-1]._replace(
        rows=np.concatenate([parts[0].rows, *[part.rows[1:] for part in parts[1:]]]),
        iterations=sum([part.iterations for part in parts]),
        residual=max([part.residual for part in parts]),
        seconds=sum([part.seconds for part in parts]),
        seen=np.concatenate([part.seen for part in parts]),
    )


def is_short(kernel: Kernel, steps: int) -> bool:
    """Whether so many steps are over before anyone could watch them."""
    return steps <= first_piece(kernel, False)


def _piece(
    kernel: Kernel,
    problem: InitialValueProblem,
    first: int,
    steps: int,
    carry: np.ndarray | None = None,
    looks: tuple[np.ndarray, int] | None = None,
) -> LoopResult:
    """Some steps of a run in one call of its loop."""
    return compiled_run(
        kernel,
        problem.q0,
        problem.p0,
        problem.c,
        t0=problem.t0,
        h=problem.h,
        steps=steps,
        save_every=problem.save_every,
        u=problem.controls(first, steps) if kernel.controls else None,
        first=first,
        carry=carry,
        level=problem.level,
        most=problem.most,
        looks=looks,
    )

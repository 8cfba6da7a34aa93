"""Compiled runs that are over before anyone could look at them: one call of their loop, or two."""

from __future__ import annotations

import numpy as np

from varint.codegen.arguments import DONE
from varint.codegen.kernel import Kernel, LoopResult
from varint.codegen.kernel import run_loop as compiled_run
from varint.integration.compiled_loop import POOR, first_piece, next_piece, scheme_of
from varint.integration.gears import BY_STAGES, gears_with, kernel_after, newton
from varint.integration.problem import InitialValueProblem
from varint.rules.rule import Rule
from varint.scene.system import System


def run_at_once(
    system: System, rule: Rule, problem: InitialValueProblem, kernel: Kernel
) -> LoopResult | None:
    """The compiled run in one call, where it is that short; None where it is not, or where its
    iteration contracts so poorly that another loop should go on.
    """
    scheme = newton() if kernel.opening else scheme_of(system, rule)
    piloted = scheme is BY_STAGES
    steps, every = problem.steps, problem.save_every
    if steps % every or steps > first_piece(kernel, False):
        return None
    first = next_piece(0, steps, every, first_piece(kernel, piloted))[0]
    if first % every:
        return None
    found = _piece(kernel, problem, 0, first)
    gears = gears_with(system, rule, scheme, kernel)
    poor = piloted and found.iterations > POOR * first
    if found.status == DONE and first < steps and not poor:
        rest = _piece(kernel, problem, first, steps - first, found.carry)
        found = rest._replace(
            rows=np.concatenate([found.rows, rest.rows[1:]]),
            iterations=found.iterations + rest.iterations,
            residual=max(found.residual, rest.residual),
            seconds=found.seconds + rest.seconds,
        )
    if gears:
        kernel_after(gears, found.seconds, 0.0)
    return None if poor else found


def _piece(
    kernel: Kernel,
    problem: InitialValueProblem,
    first: int,
    steps: int,
    carry: np.ndarray | None = None,
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
    )

"""The compiled loops, handed on block by block; loaded with the first run that is compiled."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import replace

import numpy as np

from varint.codegen.arguments import DONE, NOT_CONVERGED
from varint.codegen.cache import CompileError
from varint.codegen.frozen import no_whole_derivatives, stiff_tree
from varint.codegen.graph import NotCompilable, kernel_per_system
from varint.codegen.kernel import Kernel, LoopResult
from varint.codegen.kernel import run_loop as compiled_run
from varint.discrete.scales import rounding_sizes
from varint.integration.cost import ARRANGED, is_solved_at_once, newton_repays, rescues
from varint.integration.gears import (
    BY_STAGES,
    EXPLICIT,
    Gears,
    compiled_kernel,
    gears_of,
    gears_with,
    kernel_after,
    kernel_now,
    native_loop,
    newton,
    scheme_of,
)
from varint.integration.interpreted_loop import interpreted_blocks
from varint.integration.problem import InitialValueProblem
from varint.integration.state import NodeBlock, Passed, RunState
from varint.numerics.progress import notice
from varint.rules.rule import Rule
from varint.scene.system import System

NODES_IN_BLOCK = 200_000  # of a compiled run between two looks at it
STEPS_IN_BLOCK = 2_000_000
PATIENCE = 0.2  # seconds that Ctrl-C may wait for a block
# and for which the low gear goes on before it looks for the other one that is in the making
AT_WORK = 0.01
# seconds of an operation, for the first block; in truth it takes a hundredth to a tenth of it
CAUTION = 1e-7
NOTHING = np.empty(0)
Opening = Callable[..., np.ndarray]  # (q0, p0, u, t, h, c) → what a compiled loop begins with
PILOT = 1000  # steps at most after which fixed-point iteration must have shown that it contracts
POOR = 30  # iterations a step beyond which Newton's method is cheaper


def kernel_in_gear(system: System, rule: Rule) -> Kernel | None:
    """The loop that is there at once; None where the scene has no such loop."""
    gears = gears_of(system, rule, scheme_of(system, rule))
    return kernel_now(gears) if gears else None


def native_kernel(system: System, rule: Rule) -> Kernel:
    """The loop for which nothing is compiled.

    Raises
    ------
    NotCompilable, CompileError
        If there is none.
    """
    return native_loop(system, rule, scheme_of(system, rule))


@kernel_per_system
def kernel_of(system: System, rule: Rule) -> Kernel:
    """The compiled loop of a system and a rule."""
    with notice(f"compiling {rule} for this scene (once; it is kept)"):
        return compiled_kernel(system, rule, scheme_of(system, rule))


def compiled_blocks(
    system: System,
    rule: Rule,
    problem: InitialValueProblem,
    kernel: Kernel,
    at: RunState | None = None,
) -> Iterator[NodeBlock]:
    """The compiled run block by block; where fixed-point iteration hardly contracts Newton's
    method takes over.
    """
    k, carry = (problem.first, None) if at is None else (at.k, at.carry)
    q, p = (
        (problem.q0, problem.p0) if at is None else (at.x[: len(at.x) // 2], at.x[len(at.x) // 2 :])
    )
    taken_over = at is not None and at.by_newton
    if taken_over and carry is None:
        yield from _by_newton(system, rule, problem._replace(q0=q, p0=p, first=k))
        return
    if taken_over:
        kernel = _newton_in_gear(system, rule) or newton().compiled(system, rule)
    scheme, cautious = newton() if kernel.opening else scheme_of(system, rule), False
    by_stages = scheme is BY_STAGES
    no_other_way = scheme is EXPLICIT or no_whole_derivatives(system)
    stiff = by_stages and stiff_tree(system)
    gears = gears_with(system, rule, scheme, kernel)
    piloted = by_stages and at is None and not no_other_way and problem.rescued
    most = first_piece(kernel, piloted)
    while k < problem.steps:
        steps, every = next_piece(k, problem.steps, problem.save_every, most)
        u = problem.controls(k, steps) if kernel.controls else None
        part = compiled_run(
            kernel,
            q,
            p,
            problem.c,
            t0=problem.t0,
            h=problem.h,
            steps=steps,
            save_every=every,
            u=u,
            first=k,
            carry=carry,
            level=problem.level,
        )
        per_step = max(part.seconds / max(part.steps, 1), 1e-12)
        poor = piloted and k == problem.first and part.iterations > POOR * steps
        rows, x, k = part.rows[1:], part.last[: 2 * kernel.n].copy(), k + part.steps
        good, wanted = len(rows), steps // every
        # compositions have no other way, and whole derivatives of large machines take minutes;
        # else, where an iteration fails or overflows, Newton's method or the
        # interpreted loop may not
        ways = not no_other_way or (stiff and _newton_in_gear(system, rule) is not None)
        rescued = problem.rescued or (kernel.opening and rescues(system, rule, problem.steps - k))
        goes_on = bool(part.status != DONE and ways and rescued)
        if goes_on or (part.status == DONE and part.steps < steps):
            wanted = good
        elif part.status != DONE:
            wanted = max(wanted, good + 1)
        started = k - part.steps
        counts = np.arange(started + every, started + every * wanted + 1, every)
        after = RunState(
            x, NOTHING, NOTHING, k, 0, None if poor else part.carry, poor or taken_over
        )
        failed = float("nan")
        if part.status == DONE or goes_on:
            failed = 0.0
        elif part.status == NOT_CONVERGED:
            failed = part.failed
        after_it = None if goes_on else after
        q_rows, p_rows = rows[:, 0], rows[:, 1]
        yield NodeBlock(
            counts,
            q_rows,
            p_rows,
            part.residual,
            good,
            failed,
            iterations=part.iterations,
            after=after_it,
            v=rows[:, 2],
            passed=_passed(kernel, part),
        )
        if part.status == NOT_CONVERGED and kernel.opening and part.steps:
            # once more from there, with sizes looked up anew
            cautious, kernel = True, _above_rounding(system, kernel)
            (q, p), carry, taken_over = np.split(x, 2), None, True
            continue
        if goes_on or (poor and part.status == DONE):
            if k < problem.steps:
                q, p = np.split(x, 2)
                yield from _by_newton(
                    system, rule, problem._replace(q0=q, p0=p, first=k), by_stages
                )
            return
        if part.status != DONE:
            return
        carry = part.carry
        if gears:
            kernel = kernel_after(gears, part.seconds, per_step * (problem.steps - k))
            kernel = _above_rounding(system, kernel) if cautious else kernel
        most = most_after(most, per_step, gears, PATIENCE)


def _passed(kernel: Kernel, part: LoopResult) -> Passed | None:
    """The last nodes of a part of a run of a scene that may fold, and what was noted."""
    nodes, size = kernel.note
    if not nodes:
        return None
    lately = part.carry[-nodes * size :].reshape(nodes, size)
    lately = lately[np.argsort(lately[:, 0])]
    lately = lately[lately[:, 0] >= 0]
    k, _, q, p, _ = np.split(lately, np.cumsum([1, 1, kernel.n, kernel.n]), axis=1)
    return Passed(k[:, 0].astype(int), q, p, part.notes)


def first_piece(kernel: Kernel, piloted: bool) -> int:
    """Steps of the first call at most."""
    most = max(int(PATIENCE / (CAUTION * max(kernel.operations * kernel.nodes, 1))), 1)
    return min(PILOT, most) if piloted else most


def _above_rounding(system: System, kernel: Kernel) -> Kernel:
    """The same Newton loop, beginning with sizes not below the round-off of the terms that add
    up.
    """
    opening = kernel.opening
    assert opening is not None
    none = np.zeros(system.structure.controls)

    def told(
        q0: np.ndarray,
        p0: np.ndarray,
        u: np.ndarray | None,
        t: np.ndarray,
        h: np.ndarray,
        c: np.ndarray,
    ) -> np.ndarray:
        begin = opening(q0, p0, u, t, h, c)
        used = none if u is None else np.atleast_1d(u).reshape(-1, len(none))[0].copy()
        for row, q, p, at, size in zip(begin, q0, p0, t, h, strict=True):
            least = rounding_sizes(system, q.copy(), p.copy(), used, at[None], size[None], c)
            row[: least.size] = np.maximum(row[: least.size], least)
        return begin

    return replace(kernel, opening=told)


def one_step(
    kernel: Kernel, problem: InitialValueProblem, t: float, q: np.ndarray, p: np.ndarray, h: float
) -> np.ndarray | None:
    """(q, p, v) after one step of its own size, (3, n); None where the iteration does not
    converge.
    """
    part = compiled_run(kernel, q, p, problem.c, t0=t, h=h, steps=1)
    return part.rows[1] if part.status == DONE else None


def _by_newton(
    system: System, rule: Rule, problem: InitialValueProblem, compiled: bool = True
) -> Iterator[NodeBlock]:
    """The rest of a run on which an iteration failed: by the compiled Newton's method, then the
    interpreted one.
    """
    if system.structure.linear and not is_solved_at_once(system, rule, ARRANGED):
        compiled = False
    kernel = _newton_in_gear(system, rule) if compiled else None
    steps = problem.steps - problem.first
    if compiled and kernel is None and newton_repays(system, rule, steps):
        with suppress(NotCompilable, CompileError), notice(f"compiling Newton's method, {rule}"):
            kernel = newton().compiled(system, rule)
    if kernel is None:
        yield from interpreted_blocks(system, rule, problem)
        return
    for block in compiled_blocks(system, rule, problem, kernel):
        at = block.after
        if at is not None and at.carry is not None:  # not handed on to the interpreted one
            block = block._replace(after=at._replace(by_newton=True))
        yield block


def _newton_in_gear(system: System, rule: Rule) -> Kernel | None:
    """Newton's method, as far as it is there at once."""
    gears = gears_of(system, rule, newton())
    return kernel_now(gears) if gears else None


def most_after(most: int, per_step: float, gears: Gears | None, patience: float) -> int:
    """Steps of the next call at most, after one of so many at most, each of so many seconds, where
    one waits no longer.
    """
    waits = gears is not None and gears.work is not None
    return max(min(10 * most, int((min(AT_WORK, patience) if waits else patience) / per_step)), 1)


def next_piece(k: int, steps: int, every: int, most: int) -> tuple[int, int]:
    """(steps, save_every) of the next call after k steps: whole intervals, or at most what is left
    of one.

    How long a piece is shows in nothing, for a compiled run goes on as if it had not stopped.
    """
    left, inside = steps - k, k % every
    most = min(most, STEPS_IN_BLOCK, NODES_IN_BLOCK * every)
    if inside or min(left, most) < every:
        gap = min(every - inside, left)
        return min(gap, most), gap
    return min(left, most) // every * every, every

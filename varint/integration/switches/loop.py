"""Steps of one smooth piece: in one call of the loop in C, or as any other run where it fails."""

from __future__ import annotations

from contextlib import suppress
from typing import NamedTuple

import numpy as np

from varint.codegen.cache import CompileError
from varint.codegen.gauss import gauss_kernel
from varint.codegen.graph import NotCompilable
from varint.codegen.kernel import Kernel, run_loop, take_part
from varint.codegen.native import native_gauss
from varint.discrete.legendre import velocity_function
from varint.integration.backend import blocks_of
from varint.integration.compiled_loop import kernel_in_gear
from varint.integration.compiled_loop import kernel_of as compiled_kernel
from varint.integration.problem import InitialValueProblem
from varint.numerics.arrays import over_columns
from varint.rules.rule import Rule
from varint.scene.system import System


class Loop(NamedTuple):
    """What steps: a scene by a rule, its loop in C, its parameters, and what the loop is told
    besides where the piece begins: typical sizes and velocities, or nothing.
    """

    system: System
    rule: Rule
    kernel: Kernel
    c: np.ndarray
    told: np.ndarray


def kernel_of(system: System, rule: Rule, backend: str = "auto") -> Kernel | None:
    """The loop in C of a smooth piece: all stages at once, of linear scenes too, for steps are
    short and Newton's method takes long to prepare. None where there is none.
    """
    if system.structure.linear:
        with suppress(NotCompilable, CompileError):
            return (gauss_kernel if backend == "compiled" else native_gauss)(system, rule)
    if backend == "compiled":
        return compiled_kernel(system, rule)
    return kernel_in_gear(system, rule)


class Grid(NamedTuple):
    """So many steps of size h from node `first` on, node 0 being at t0."""

    t0: float
    h: float
    steps: int
    first: int = 0


class Part(NamedTuple):
    """(q, p, v) at the nodes, (steps + 1, 3, n), how they were found, what leads on, and whether
    these are all.
    """

    rows: np.ndarray
    iterations: int
    residual: float
    carry: np.ndarray | None
    whole: bool = True


def loop_steps(
    loop: Loop, q: np.ndarray, p: np.ndarray, grid: Grid, carry: np.ndarray | None = None
) -> Part:
    """The steps of a grid, as far as they are solved: beyond its end a branch may be no scene."""
    t0, h, steps, first = grid
    part = run_loop(
        loop.kernel,
        q,
        p,
        loop.c,
        t0=t0,
        h=h,
        steps=steps,
        first=first,
        carry=carry,
    )
    finite = np.isfinite(part.rows).all(axis=(1, 2))
    rows = part.rows if finite.all() else part.rows[: int(np.argmin(finite))]
    return Part(rows, part.iterations, part.residual, part.carry, len(rows) > steps)


def one_part(
    loop: Loop, start: np.ndarray, t: float, h: float, told: np.ndarray
) -> np.ndarray | None:
    """(q, p, v) a step of its own size after a state, (3, n); None where it is not solved. `told`
    is what the loop is told besides there.
    """
    found = take_part(loop.kernel, start[:2], loop.c, t, h, told)
    if found is not None or not h:
        return found
    part = other_steps(loop, start[0], start[1], Grid(t, h, 1))
    return None if part is None else part.rows[-1]


def other_steps(loop: Loop, q: np.ndarray, p: np.ndarray, grid: Grid) -> Part | None:
    """The same steps as those of any run, by Newton's method and with other sizes where one
    fails; None where that does not help.
    """
    t0, h, steps, first = grid
    n, nodes = len(q), len(loop.rule.nodes)
    whole = np.empty((steps + first, 1, 0))
    problem = InitialValueProblem(q, p, t0, h, steps + first, 1, whole, loop.c, nodes, first=first)
    rows, iterations, residual = [np.stack([q, p])[None]], 0, 0.0
    for block in blocks_of(loop.system, loop.rule, problem, loop.kernel):
        if block.good < len(block.k):
            return None
        rows.append(np.stack([block.q, block.p], axis=1))
        iterations, residual = iterations + block.iterations, max(residual, block.residual)
    states = np.concatenate(rows)
    t = t0 + h * np.arange(first, first + len(states))
    v = over_columns(
        velocity_function(loop.system), states[:, 0], states[:, 1], t[:, None], loop.c
    )[0]
    return Part(np.concatenate([states, v.reshape(-1, 1, n)], axis=1), iterations, residual, None)

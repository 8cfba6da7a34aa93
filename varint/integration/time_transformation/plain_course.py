"""Runs in fictitious time until a physical one as numbers alone, without what a trajectory is made
of around each, where nothing is watched on the way.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from time import perf_counter
from typing import NamedTuple

import numpy as np

from varint.codegen.arguments import DONE
from varint.codegen.kernel import Kernel, LoopResult, run_loop
from varint.discrete.legendre import velocity_function
from varint.integration.backend import kernel_for
from varint.integration.compiled_loop import POOR, first_piece, scheme_of
from varint.integration.gears import BY_STAGES, gears_with, kernel_after
from varint.integration.problem import InitialValueProblem
from varint.integration.time_transformation.physical_end import (
    PATIENCE,
    located_end,
    lost_level,
    next_steps,
    nodes_around,
    steps_ahead,
    with_end,
)
from varint.integration.time_transformation.physical_time import in_physical_time
from varint.integration.time_transformation.transformed_run import Prepared, run_prepared
from varint.integration.trajectories import Run, motion_of
from varint.numerics.arrays import over_columns
from varint.results.trajectory import Trajectory


class PhysicalRun(NamedTuple):
    """Nodes of a run at physical times, (N + 1,) and (N + 1, n), and what makes its trajectory."""

    t: np.ndarray
    q: np.ndarray
    p: np.ndarray
    motion: Callable[[], Trajectory]


class Inner(NamedTuple):
    """Nodes in fictitious time."""

    t: np.ndarray
    q: np.ndarray
    p: np.ndarray
    k: np.ndarray


def physical_run(prepared: Prepared, problem: InitialValueProblem) -> PhysicalRun:
    """`run_prepared`, the same numbers.

    Raises
    ------
    ConvergenceError, InputError
        Those of `run_prepared`.
    """
    found = _plain(prepared, problem)
    if found is not None:
        return found
    motion = run_prepared(prepared, problem)
    return PhysicalRun(motion.t, motion.q, motion.p, lambda: motion)


def velocities(prepared: Prepared, nodes: PhysicalRun, some: np.ndarray) -> np.ndarray:
    """Physical ones at some nodes."""
    system = prepared.system
    c = prepared.problem.c[: system.c.numel()]
    at = nodes.q[some], nodes.p[some], nodes.t[some, None], c
    return over_columns(velocity_function(system), *at)[0]


def _plain(prepared: Prepared, problem: InitialValueProblem) -> PhysicalRun | None:
    """The run by its loop alone; None where it is another one, or comes to no good end."""
    system, scene, chosen, _, t0, total, stop, watches, options, _ = prepared
    began, s = perf_counter(), scene.system.structure
    if total is None or stop or watches or options.progress or options.save_every != 1:
        return None
    if s.constraints or s.nonholonomic or s.contacts or s.controls or scene.system.rays:
        return None
    kernel = kernel_for(scene.system, chosen.rule, problem, options.backend)
    if kernel is None or kernel.opening or kernel.note[0]:
        return None
    run = Run(scene.system, chosen, problem, [], iter(()), kernel, began)
    parts = _parts(run, kernel, total)
    if parts is None:
        return None
    first = np.stack((problem.q0, problem.p0, problem.p0))[None]  # of the last nobody asks
    rows = np.concatenate([first, *[part.rows[1:] for part in parts]])
    count = len(rows) - len(parts[-1].rows) + 1  # nodes before the last part
    count += int(np.argmax(_beyond(rows[count:, 0, -1], total))) + 1
    k = np.arange(count)
    t = problem.h * k
    t += problem.t0
    inner = Inner(t, rows[:count, 0].copy(), rows[:count, 1].copy(), k)
    if lost_level(scene, scene.system, inner, problem.c):
        return None
    kept, near = nodes_around(inner, total)
    ended = Inner(*with_end(inner, slice(kept), located_end(run, near, total)))

    def motion() -> Trajectory:
        work = sum([part.iterations for part in parts]), max([part.residual for part in parts])
        whole = motion_of(run, (inner.k, inner.t, inner.q, inner.p), work)
        return in_physical_time(system, t0, replace(whole, **ended._asdict()))

    n = system.structure.n
    return PhysicalRun(t0 + ended.q[:, n], ended.q[:, :n], ended.p[:, :n], motion)


def _parts(run: Run, kernel: Kernel, total: float) -> list[LoopResult] | None:
    """The pieces of `blocks_until`, the last of which passes the end; None where it is none that a
    loop alone makes.
    """
    system, rule, problem = run.system, run.plan.rule, run.problem
    scheme = scheme_of(system, rule)
    gears, longest = gears_with(system, rule, scheme, kernel), first_piece(kernel, False)
    parts: list[LoopResult] = []
    done, ahead, carry = 0, float(problem.steps), None
    while True:
        count = next_steps(ahead, done, 1)
        if count > longest or done > PATIENCE * (problem.steps + count):
            return None
        part = run_loop(
            kernel,
            problem.q0,
            problem.p0,
            problem.c,
            t0=problem.t0,
            h=problem.h,
            steps=count,
            first=done,
            carry=carry,
            level=problem.level,
        )
        parts.append(part)
        if not done and scheme is BY_STAGES and part.iterations > POOR * count:
            return None
        if _beyond(part.rows[1:, 0, -1], total).any():
            return parts
        if part.status != DONE:
            return None
        done, carry = done + count, part.carry
        clock = float(part.rows[-1, 0, -1])
        if clock / problem.h <= 0:
            return None
        ahead = steps_ahead(total, clock, done)
        if gears:
            kernel = kernel_after(gears, part.seconds, part.seconds / count * ahead)


def _beyond(clock: np.ndarray, total: float) -> np.ndarray:
    """At which nodes the duration is over."""
    return clock >= total if total > 0 else clock <= total

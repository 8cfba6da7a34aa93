"""Runs in fictitious time until a physical one as numbers alone, without what a trajectory is made
of around each, where nothing is watched on the way.
"""

from __future__ import annotations

from collections.abc import Callable
from time import perf_counter
from typing import NamedTuple

import numpy as np

from varint.codegen.kernel import address_of
from varint.codegen.until import physical_nodes
from varint.discrete.legendre import velocity_function
from varint.integration.problem import InitialValueProblem
from varint.integration.time_transformation.inner_run import (
    BACKENDS,
    called_on,
    inner_motion,
    until_end,
)
from varint.integration.time_transformation.physical_time import in_physical_time
from varint.integration.time_transformation.transformed_run import Prepared, run_prepared
from varint.numerics.arrays import over_columns
from varint.results.trajectory import Trajectory


class PhysicalRun(NamedTuple):
    """Nodes of a run at physical times, (N + 1,) and (N + 1, n), and what makes its trajectory."""

    t: np.ndarray
    q: np.ndarray
    p: np.ndarray
    motion: Callable[[], Trajectory]


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
    """The run by one call of the core; None where it is another one, or comes to no good end."""
    system, scene, chosen, _, t0, total, stop, watches, options, _ = prepared
    began, s = perf_counter(), scene.system.structure
    if total is None or stop or watches or options.progress or options.save_every != 1:
        return None
    if options.backend not in BACKENDS:
        return None
    if s.constraints or s.nonholonomic or s.contacts or s.controls or scene.system.rays:
        return None
    called = called_on(scene.system, scene, chosen.rule)
    x, c, h = np.concatenate((problem.q0, problem.p0)), problem.c, problem.h
    at = address_of(x), address_of(c)
    found = until_end(
        called,
        scene.system,
        at,
        h,
        problem.level,
        (t0, total),
        float(problem.steps),
        float(c[-2]),
        1,
        options.backend,
    )
    if found is None:
        return None
    seconds = perf_counter() - began
    until, kernel = found

    def motion() -> Trajectory:
        inner = inner_motion(called, scene.system, h, c, until, kernel, seconds)
        return in_physical_time(system, t0, inner)

    _, t, q, p = physical_nodes(until)
    return PhysicalRun(t, q, p, motion)

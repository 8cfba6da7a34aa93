"""Motions at the times that were asked for, in one call of the core: of runs by whole steps that
nothing holds, whose nodes lie less than a step apart.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from time import perf_counter

import numpy as np

from varint.codegen.cache import CompileError
from varint.codegen.graph import NotCompilable
from varint.codegen.kernel import Kernel
from varint.codegen.times import states_at_times
from varint.integration.compiled_loop import kernel_in_gear, kernel_of
from varint.integration.damped_motions import by_lagrangian
from varint.integration.gears import kernel_after
from varint.integration.many_times import within_now
from varint.results.records import changed
from varint.results.trajectory import Trajectory


def only_at_by_core(motion: Trajectory, times: np.ndarray) -> Trajectory | None:
    """The motion with these times as its nodes; None where another way is to be taken."""
    found = None if motion.sizes is not None else states_by_core(motion, times)
    if found is None:
        return None
    q, p, k = found
    return changed(motion, t=times, q=q, p=p, k=k, active_set=None, solution=None, closure=None)


def states_by_core(
    motion: Trajectory, times: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
    """q, p and whole steps before each time; None where another way is to be taken."""
    system = motion.system
    if motion.active_set is not None or system.rays:
        return None
    if motion.dense_output is not None or system.structure.controls or not motion.rule:
        return None
    if motion.functions.at_once is None:
        return None
    kernel = kernel_in_gear(system, motion.rule) or _compiled_for(motion)
    if kernel is None:
        return None
    nodes, sizes = (motion.t, motion.q, motion.p, motion.k), motion.sizes
    if not all(x.flags.c_contiguous for x in (*nodes, times)) or motion.k.dtype != np.int64:
        return None
    if sizes is not None and not (sizes.flags.c_contiguous and motion.k[-1] <= len(sizes)):
        return None
    steps, looking = within_now(system, motion.rule, len(times))
    now, found = perf_counter(), None
    with suppress(CompileError):
        found = states_at_times(kernel, nodes, motion.c, (motion.h, 0.0), times, steps, sizes)
    if looking:
        kernel_after(looking, perf_counter() - now, 0.0)
    if found is None and sizes is not None and system.kinetics is not None:
        found = _by_lagrangian_alone(motion, nodes, times)
    return found


def _by_lagrangian_alone(
    motion: Trajectory, nodes: Sequence[np.ndarray], times: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
    """The same by the loop that makes motions of machines beside stiff dampers."""
    t, q, p, k = nodes
    assert motion.rule is not None
    kernel, whole = kernel_in_gear(by_lagrangian(motion.system), motion.rule), (motion.h, 0.0)
    if kernel is None:
        return None
    with suppress(CompileError):
        return states_at_times(kernel, (t, q, p, k), motion.c, whole, times, sizes=motion.sizes)
    return None


def _compiled_for(motion: Trajectory) -> Kernel | None:
    """The loop that made a motion, where it had to be compiled first."""
    if not str(motion.stats.get("backend")).startswith("compiled"):
        return None
    with suppress(NotCompilable, CompileError):
        return kernel_of(motion.system, motion.rule)
    return None

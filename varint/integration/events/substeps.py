"""The motion within a step: a shorter step of the same rule from the node before, of many steps at
once.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from varint.integration.events.surroundings import nodes_around
from varint.integration.step_function import guided_step_function
from varint.numerics.arrays import over_columns
from varint.results.dense_output import node_tolerance, step_controls, steps_ahead
from varint.results.trajectory import Trajectory

if TYPE_CHECKING:
    from varint.codegen.kernel import Kernel

States = tuple[np.ndarray, np.ndarray, np.ndarray]
# (motion, nodes, times) → q, v and p at times within the steps from these nodes
Substeps = Callable[[Trajectory, np.ndarray, np.ndarray], States]


def substeps_of(kernel: Kernel | None) -> Substeps:
    """By the compiled loop of a run, where there is one."""
    return interpreted_substeps if kernel is None else partial(_compiled_substeps, kernel)


def interpreted_substeps(motion: Trajectory, node: np.ndarray, t: np.ndarray) -> States:
    """q, v and p at times after the nodes."""
    part = motion[node]
    found = _guided_substeps(motion, part, node, t)
    if found is None:
        states = [part.q.copy(), part.p.copy(), part.k.copy()]
        for _ in steps_ahead(part, np.arange(len(node)), t - part.t, states):
            continue
        found = states[0], states[1]
    q, p = found
    return q, replace(part, t=t, q=q, p=p).v, p


def _guided_substeps(
    motion: Trajectory, part: Trajectory, node: np.ndarray, t: np.ndarray
) -> tuple[np.ndarray, np.ndarray] | None:
    """q and p at times after the nodes of a part, by iterations that start at what the nodes around
    tell; None where they have no such start, or there is more than a part of one step to go.
    """
    size, close = t - part.t, node_tolerance(motion)
    ahead = size / motion.h
    if motion.active_set is not None or motion.sizes is not None or motion.system.rays:
        return None
    if not len(node) or not ((ahead > close) & (ahead < 1 - close)).all():
        return None
    step = guided_step_function(motion.system, motion.rule)
    around = None if step is None else nodes_around(motion, node)
    if step is None or around is None:
        return None
    ways = [around.motion(part.t + tau * size)[0] - part.q for tau in motion.rule.points[1:]]
    means = np.hstack(ways) / size[:, None]
    u = step_controls(motion, part.k, ahead, part.t)
    found = over_columns(step, part.q, part.p, u, motion.c, part.t[:, None], size[:, None], means)
    return found[0], found[1]


def _compiled_substeps(
    kernel: Kernel, motion: Trajectory, node: np.ndarray, t: np.ndarray
) -> States:
    """The same by compiled code, but for steps that it cannot take."""
    if motion.active_set is not None:  # other rows may hold by now
        return interpreted_substeps(motion, node, t)
    from varint.codegen.kernel import take_parts

    q, p, begin, k = motion.q[node], motion.p[node], motion.t[node], motion.k[node]
    size = t - begin
    u = step_controls(motion, k, size / motion.h, begin)
    rows, good = take_parts(kernel, q, p, motion.c, t=begin, h=size, u=u)
    q, p, v = rows.transpose(1, 0, 2).copy()
    other = np.flatnonzero(~good | (np.abs(size / motion.h) <= node_tolerance(motion)))
    if len(other):
        q[other], v[other], p[other] = interpreted_substeps(motion, node[other], t[other])
    return q, v, p

"""Dense output of a path that leans on its bounds: there it is the path itself, not a motion."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from varint.boundary.iterate import point_times
from varint.discrete.lagrangian import point_function
from varint.numerics.arrays import over_columns
from varint.results.dense_output import node_tolerance, states_at
from varint.results.trajectory import Trajectory
from varint.rules.polynomials import lagrange_table, lagrange_values


def at_times(motion: Trajectory, times: np.ndarray) -> Trajectory:
    """The trajectory with nodes at the times: where a step leans on a bound, on the polynomial
    through its control points, p = ∂L/∂v there; elsewhere by steps from the node before.
    """
    q, p, k, _ = states_at(motion, times)
    path, tau = motion.solution, point_times(motion.rule)
    degree = len(tau) - 1
    grid = path.t[::degree]
    step = np.clip(np.searchsorted(grid, times, side="right") - 1, 0, len(grid) - 2)
    size = grid[step + 1] - grid[step]
    share = (times - grid[step]) / size
    points = step[:, None] * degree + np.arange(degree + 1)
    close = node_tolerance(motion)
    between = path.touches[points].any(axis=(1, 2)) & (share > close) & (share < 1 - close)
    found = replace(motion, t=times, q=q, p=p, k=k, closure=None)
    if not between.any():
        return found
    table, near = lagrange_values(tau, share[between])[:, None], path.points[points[between]]
    q[between] = (table @ near)[:, 0]
    slopes = lagrange_table(motion.rule.points, motion.rule.points, 1) @ near
    v = (table @ slopes)[:, 0] / size[between, None]
    u = np.zeros((len(v), motion.system.structure.controls))
    _, p[between], *_ = over_columns(
        point_function(motion.system), q[between], v, u, times[between, None], motion.c
    )
    return found

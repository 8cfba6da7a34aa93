"""A path that leans on its bounds: between its nodes, and its action. There it is the path itself,
not a motion.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from varint.discrete.lagrangian import point_function
from varint.numerics.arrays import over_columns
from varint.results.dense_output import node_tolerance, states_at
from varint.results.records import require_order, whole_of
from varint.results.trajectory import Trajectory
from varint.rules.polynomials import lagrange_table, lagrange_values


def at_times(motion: Trajectory, times: np.ndarray) -> Trajectory:
    """The trajectory with nodes at the times: where a step leans on a bound, on the polynomial
    through its control points, p = ∂L/∂v there; elsewhere by steps from the node before.
    """
    q, p, k, _ = states_at(motion, times)
    grid = _grid(motion)
    step = _steps_at(grid, times)
    share, close = (times - grid[step]) / np.diff(grid)[step], node_tolerance(motion)
    leaning = motion.solution.touches[_points_of(motion, step)].any(axis=(1, 2))
    between = leaning & (share > close) & (share < 1 - close)
    found = replace(motion, t=times, q=q, p=p, k=k, closure=None, whole=whole_of(motion))
    if between.any():
        q[between], _, p[between] = _on_path(motion, times[between], step[between])
    return found


def action_of(motion: Trajectory) -> float:
    """Σ h Σ_i b_i L(q_i, v_i, t_i) along the polynomials through the control points, over the steps
    between the motion's nodes and the parts of steps at them.
    """
    require_order(motion)
    rule, grid = motion.rule, _grid(motion)
    inner = grid[(grid > motion.t[0]) & (grid < motion.t[-1])]
    ends = np.unique(np.concatenate((motion.t, inner)))
    begin, h = ends[:-1, None], np.diff(ends)[:, None]
    times = (begin + h * np.array(rule.nodes)).ravel()
    step = np.repeat(_steps_at(grid, (begin + h / 2).ravel()), len(rule.nodes))
    lagrangian = _on_path(motion, times, step)[1].reshape(len(h), -1)
    return float((h * lagrangian * np.array(rule.weights)).sum())


def _on_path(
    motion: Trajectory, times: np.ndarray, step: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """q, L and p = ∂L/∂v at the times, each within a step, on its polynomial."""
    grid, points = _grid(motion), motion.rule.points
    size = np.diff(grid)[step, None]
    share = (times - grid[step]) / size[:, 0]
    near = motion.solution.points[_points_of(motion, step)]
    table = lagrange_values(np.array(points), share)[:, None]
    q, v = (table @ near)[:, 0], (table @ (lagrange_table(points, points, 1) @ near))[:, 0] / size
    u = np.zeros((len(v), motion.system.structure.controls))
    found = over_columns(point_function(motion.system), q, v, u, times[:, None], motion.c)
    return q, found[0][:, 0], found[1]


def _grid(motion: Trajectory) -> np.ndarray:
    """Times at which the steps of the whole path begin and end."""
    return motion.solution.t[:: len(motion.rule.points) - 1]


def _steps_at(grid: np.ndarray, times: np.ndarray) -> np.ndarray:
    return np.clip(np.searchsorted(grid, times, side="right") - 1, 0, len(grid) - 2)


def _points_of(motion: Trajectory, step: np.ndarray) -> np.ndarray:
    """Which control points belong to the steps, (len(step), degree + 1)."""
    degree = len(motion.rule.points) - 1
    return step[:, None] * degree + np.arange(degree + 1)

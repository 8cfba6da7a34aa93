"""The action of a motion whose steps are steps of a fictitious time τ, dt = σ dτ."""

from __future__ import annotations

import numpy as np

from varint.discrete.lagrangian import point_function
from varint.numerics.arrays import over_columns
from varint.results.records import require_order
from varint.results.trajectory import Trajectory
from varint.rules.rule import gauss


def action_of(motion: Trajectory, inner: Trajectory) -> float:
    """Σ h Σ_i b_i L(q, q'/t', t) t' over the steps of τ, (q, t)(τ) the polynomials through the
    control points of the rule, or of Gauss's of its order, which shorter steps lead to.

    The action is stationary at the motion: what polynomials err by counts squared. Solving the
    steps once more, as elsewhere, would take second derivatives of σ, which overflow where lengths
    are nanometres in metres, and the time's momentum, whose size is no energy of the scene.
    """
    require_order(motion)
    rule = inner.rule if inner.rule.points else gauss((inner.rule.order + 1) // 2)
    points, n = rule.points, motion.q.shape[1]
    begin, h = _steps(inner)
    ends, within = np.append(begin, inner.t[-1]), begin[:, None] + h[:, None] * points[1:-1]
    there = inner.at(np.unique(np.concatenate((ends, within.ravel()))))
    grid = begin[:, None] + h[:, None] * np.array(points)
    grid[:-1, -1], grid[-1, -1] = begin[1:], inner.t[-1]
    path = there.q[np.searchsorted(there.t, grid)]
    q = (rule.basis @ path).reshape(-1, path.shape[2])
    v = (rule.slopes @ path / h[:, None, None]).reshape(q.shape)
    t, rate = motion.t[0] + q[:, -1:] - inner.q[0, -1], v[:, -1:]
    u = np.zeros((len(q), motion.system.structure.controls))
    along = over_columns(point_function(motion.system), q[:, :n], v[:, :n] / rate, u, t, motion.c)
    values = (along[0] * rate).reshape(len(h), -1)
    return float((h[:, None] * values * np.array(rule.weights)).sum())


def _steps(inner: Trajectory) -> tuple[np.ndarray, np.ndarray]:
    """Where steps of about the run's size begin, from node to node, and how long they are."""
    apart = np.diff(inner.t)
    size = abs(inner.h) if inner.sizes is None else np.abs(inner.sizes).min()
    parts = np.maximum(np.rint(np.abs(apart) / size), 1).astype(int)
    h = np.repeat(apart / parts, parts)
    since = np.arange(len(h)) - np.repeat(np.cumsum(parts) - parts, parts)
    return np.repeat(inner.t[:-1], parts) + since * h, h

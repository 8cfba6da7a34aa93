"""Scenes with contacts that several tests share."""

from __future__ import annotations

import casadi as ca
import numpy as np

import varint as vi

G = 9.81


def ball(restitution: float = 1.0) -> vi.System:
    q, v = vi.coordinates("y")
    return vi.System(q, v, v**2 / 2 - G * q, contact=q, restitution=restitution)


def disc_on_table(gravity: float = 0.0, restitution=1.0) -> vi.System:
    """A point in the box 0 ≤ x ≤ 1, 0 ≤ y."""
    q, v = vi.coordinates("x", "y")
    walls = ca.vertcat(q[0], 1 - q[0], q[1])
    return vi.System(
        q, v, ca.sumsqr(v) / 2 - gravity * q[1], contact=walls, restitution=restitution
    )


def times(motion: vi.Trajectory) -> np.ndarray:
    return np.array([event.time for event in motion.events])

"""Zeros that a motion comes to at impacts which turn it back, as a gap has them that is watched:
last digits of the value tell nothing of its sign there.
"""

from __future__ import annotations

import numpy as np

from varint.integration.events.roots import Points
from varint.results.dense_output import node_tolerance
from varint.results.trajectory import Trajectory

ROUND_OFF = 1e-12  # of a step, and of where a motion is: what it is late by is round-off


def touches(motion: Trajectory, come: Points, leave: Points) -> np.ndarray:
    """Whether the expression is zero where the motion comes to nodes and leaves them to the side
    from which it came.
    """
    with np.errstate(invalid="ignore"):  # rates that are not known
        turned = (come.rate != leave.rate) & (come.rate * leave.rate <= 0)
        found: np.ndarray = turned & (np.abs(come.value) <= _late(motion, come) * np.abs(come.rate))
    return found


def beside(motion: Trajectory, zeros: Points, touched: Points) -> Points:
    """Those zeros that are not those which the motion touches."""
    order = np.argsort(touched.t, kind="stable")
    times, late = touched.t[order], _late(motion, touched)[order]
    behind = np.searchsorted(times, zeros.t)
    near = np.zeros(len(zeros.t), dtype=bool)
    for k in (behind - 1, behind):
        k = np.clip(k, 0, len(times) - 1)
        near |= np.abs(zeros.t - times[k]) <= 2 * late[k]
    return zeros.at(~near)


def _late(motion: Trajectory, x: Points) -> np.ndarray:
    """By how much time round-off of coordinates and times misplaces what happens at such states."""
    far, fast = np.abs(x.q).max(axis=1), np.abs(x.v).max(axis=1)
    own = np.divide(far, fast, out=np.zeros(len(far)), where=fast > 0)
    late: np.ndarray = node_tolerance(motion) * abs(motion.h) + ROUND_OFF * (abs(motion.h) + own)
    return late

"""Contacts that are touched without a blow: a neighbouring motion is hit there or passes, so that
there is no derivative.
"""

from __future__ import annotations

from collections.abc import Mapping

import casadi as ca
import numpy as np

from varint.errors import ConvergenceError
from varint.integration.events.roots import find_root
from varint.numerics.arrays import call, over_columns
from varint.results.records import Event
from varint.results.trajectory import Trajectory
from varint.scene.memory import per_system
from varint.scene.system import System

LOW = 0.05  # of the way that a gap closes and opens in a step: as low by the cubic, it is looked at
TOUCHED = 1e-9  # of that way: a least gap this small is none
GRAZES = "the motion grazes there, and a neighbouring one may miss the event altogether"


def grazing(step: int, time: float, why: str = GRAZES) -> ConvergenceError:
    """What is to be said where a motion has no derivative."""
    return ConvergenceError(
        f"the event at t={time:g} (step {step}) has no derivative: {why}",
        step=step,
        time=time,
        residual=float("nan"),
        cause=why,
    )


def require_no_touch(motion: Trajectory, events: Mapping[int, tuple[Event, ...]]) -> None:
    """Refuse a run in which a gap comes down to zero and opens again without an impact.

    Raises
    ------
    ConvergenceError
        At the first such place.
    """
    coming = motion.v.copy()
    for node, there in events.items():
        coming[node] = there[0].v_before
    function, t = _gaps(motion.system), motion.t[:, None]
    gap, after = over_columns(function, motion.q, motion.v, t, motion.c)
    before = over_columns(function, motion.q, coming, t, motion.c)[1]
    size = np.diff(motion.t)[:, None]
    ways = -after[:-1] * size, before[1:] * size  # that a gap closes, and opens again
    low = np.minimum(gap[:-1] - ways[0] / 2, gap[1:] - ways[1] / 2)
    down = (ways[0] > 0) & (ways[1] >= 0) & (low <= LOW * (ways[0] + ways[1]))
    open_ = gap[:-1] > TOUCHED * (ways[0] + ways[1])  # one that held has just let go
    for node, contact in np.argwhere(down & open_ & ~_held(motion)[:-1]).tolist():
        rates = float(after[node, contact]), float(before[node + 1, contact])
        time = _turning(motion, function, contact, node, rates)
        least = _at(motion, function, time)[0][contact]
        if least <= TOUCHED * (ways[0] + ways[1])[node, contact]:
            raise grazing(int(motion.k[node] - motion.k[0]), time)


def _held(motion: Trajectory) -> np.ndarray:
    """Which contacts hold behind each node, (N + 1, contacts)."""
    assert motion.active_set is not None
    table = np.zeros((len(motion.active_sets), motion.system.structure.contacts), dtype=bool)
    for row, active_set in zip(table, motion.active_sets, strict=True):
        row[list(active_set.holding)] = True
    return table[motion.active_set]


def _turning(
    motion: Trajectory, function: ca.Function, contact: int, node: int, rates: tuple[float, float]
) -> float:
    """When a gap is least between two nodes, where its rates are those."""
    begin, end = motion.t[node : node + 2].tolist()
    if rates[1] == 0:
        return end

    def rate_at(ahead: float) -> float:
        return float(_at(motion, function, begin + ahead)[1][contact])

    return begin + find_root(rate_at, 0.0, end - begin, *rates)


def _at(motion: Trajectory, function: ca.Function, time: float) -> list[np.ndarray]:
    state = motion.at(time)
    return call(function, state.q, state.v, np.array([time]), motion.c)


@per_system
def _gaps(system: System) -> ca.Function:
    """(q, v, t, c) → gaps and their rates."""
    s = system
    rate = ca.jtimes(s.contact, s.q, s.v) + ca.jacobian(s.contact, s.t)
    both = [ca.densify(s.contact), ca.densify(rate)]
    return ca.Function("gaps", [s.q, s.v, s.t, s.c], both, {"cse": True})

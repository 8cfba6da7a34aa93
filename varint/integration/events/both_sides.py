"""Impacts along a motion: both states there, and the steps of each active set between them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np

from varint.codegen.rows import RowFunction
from varint.integration.events.roots import Points
from varint.results.records import Event
from varint.results.trajectory import Trajectory


class Before(NamedTuple):
    """In which v and p a motion comes to nodes where it jumps, (J, 2n), and of every node which of
    these rows, or −1; no numbers where it jumps nowhere.
    """

    states: np.ndarray
    row: np.ndarray


def states_before(motion: Trajectory, impacts: Mapping[int, Event]) -> Before:
    """Those at impacts."""
    n = motion.q.shape[1]
    if not impacts:
        return Before(np.empty((0, 2 * n)), np.empty(0, int))
    row = np.full(len(motion), -1)
    row[list(impacts)] = np.arange(len(impacts))
    states = [(*impact.v_before, *impact.p_before) for impact in impacts.values()]
    return Before(np.array(states), row)


def steps_by_active_set(motion: Trajectory) -> Iterator[tuple[int, np.ndarray]]:
    """Each active set that has steps, and from which nodes to the next these lead (M − 1,)."""
    assert motion.active_set is not None
    lasts, active_set = motion.t[1:] != motion.t[:-1], motion.active_set[:-1]
    for i in range(len(motion.active_sets)):
        steps = lasts & (active_set == i)
        if steps.any():
            yield i, steps


def jumping_nodes(values: RowFunction, motion: Trajectory, before: Before) -> tuple[Points, Points]:
    """The states in which the motion comes to nodes and leaves them, where they may differ: at
    impacts, and at nodes of the same time. `values`: (q, v, t) → value and rate of an expression.
    """
    t, q, v, p = motion.t, motion.q, motion.v, motion.p
    still = np.append(False, t[1:] == t[:-1])
    struck = still.copy()
    struck[1:] |= (before.row[1:] >= 0) if len(before.row) else False
    at, n = np.flatnonzero(struck), q.shape[1]
    count, hit = len(at), ~still[at]
    both = np.append(np.where(hit, at, at - 1), at)
    t, q, v, p = t[both], q[both], v[both], p[both]
    if hit.any():
        v[:count][hit], p[:count][hit] = np.split(before.states[before.row[at[hit]]], [n], axis=1)
    value, rate = values.values(motion.c, q, v, t[:, None])[0].T.copy()
    found = Points(np.append(at - 1, at), t, q, v, p, value, rate)
    return found.at(slice(0, count)), found.at(slice(count, None))

"""A motion node by node with both states at impacts, so that it is smooth from each to the next."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np

from varint.results.records import Event
from varint.results.trajectory import Trajectory


class Sides(NamedTuple):
    """States of a motion, in the order of time: the nodes they are of, times, q, v and p, and from
    which of them to the next (M − 1,) there is a step of the motion.
    """

    node: np.ndarray
    t: np.ndarray
    q: np.ndarray
    v: np.ndarray
    p: np.ndarray
    step: np.ndarray


def both_sides(motion: Trajectory, impacts: Mapping[int, Event]) -> Sides:
    """All nodes, those of impacts twice: as the motion comes to them, and as it leaves them."""
    nodes = np.arange(len(motion))
    if not impacts:
        return Sides(nodes, motion.t, motion.q, motion.v, motion.p, np.diff(motion.t) != 0)
    struck = np.array(sorted(impacts))
    node = np.insert(nodes, struck, struck)
    states = motion.t, motion.q, motion.v, motion.p
    t, q, v, p = (np.take(x, node, axis=0) for x in states)  # a fifth of the time of x[node]
    come = struck + np.arange(len(struck))
    v[come] = [impacts[i].v_before for i in struck]
    p[come] = [impacts[i].p_before for i in struck]
    return Sides(node, t, q, v, p, np.diff(t) != 0)


def by_active_set(motion: Trajectory, sides: Sides) -> Iterator[tuple[int, Sides]]:
    """The states around the steps of each active set, and its number."""
    assert motion.active_set is not None
    of = motion.active_set[sides.node[:-1]]
    for i in range(len(motion.active_sets)):
        taken = np.append(sides.step & (of == i), False)
        if not taken.any():
            continue
        if (taken[:-1] == sides.step).all():
            yield i, sides
            return
        some = np.flatnonzero(taken | np.roll(taken, 1))
        node, t, q, v, p = (np.take(x, some, axis=0) for x in sides[:5])
        yield i, Sides(node, t, q, v, p, taken[some[:-1]])

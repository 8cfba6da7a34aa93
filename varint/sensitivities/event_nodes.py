"""At which nodes of a run blows, stops and detachments happen."""

from __future__ import annotations

import numpy as np

from varint.integration.trajectories import ABRUPT
from varint.results.records import Event
from varint.results.trajectory import Trajectory

INSTANT = 1e-12  # of a step: what takes no longer takes no time
NEAR = 4  # nodes before the time of an event, of which one is its own: that of a stop is when all
# bounces are over


def events_at_nodes(motion: Trajectory) -> dict[int, tuple[Event, ...]] | None:
    """Impacts, stops and detachments by the node that is the state behind them, in their order;
    None where such a node is missing.
    """
    forward = 1.0 if motion.h > 0 else -1.0
    times, groups = forward * motion.t, dict[int, list[Event]]()
    for event in motion.events:
        time = forward * event.time
        if event.kind not in ABRUPT or not times[0] <= time <= times[-1]:
            continue
        node = int(np.searchsorted(times, time, side="right")) - 1
        near = [i for i in range(node, max(node - NEAR, -1), -1) if tuple(motion.q[i]) == event.q]
        if not near:
            return None
        groups.setdefault(int(np.searchsorted(times, times[near[0]])), []).append(event)
    found = {}
    for first, events in groups.items():
        in_turn, last = _in_turn(events), int(np.searchsorted(times, times[first], side="right"))
        behind = [i for i in range(first, last) if tuple(motion.p[i]) == in_turn[-1].p_after]
        if not behind:
            return None
        found[behind[0]] = in_turn
    return found


def _in_turn(events: list[Event]) -> tuple[Event, ...]:
    """Events of one instant, each going on from the momenta that the one before it left."""
    behind = {event.p_after for event in events if event.p_after != event.p_before}
    starts = [event for event in events if event.p_before not in behind] or events
    found, left = [starts[0]], list(events)
    left.remove(starts[0])
    while left:
        following = [event for event in left if event.p_before == found[-1].p_after] or left
        found.append(following[0])
        left.remove(following[0])
    return tuple(found)


def without_arrivals(motion: Trajectory) -> Trajectory:
    """Without the nodes before a blow that falls on the end of a step: the step ends with it. From
    one side of the node to the other the discrete motion changes by the rule's error; this lies
    between.
    """
    at = np.array(sorted(events_at_nodes(motion) or {}), dtype=int)
    at = at[at > 1]
    before = at[np.abs(motion.t[at] - motion.t[at - 1]) <= INSTANT * abs(motion.h)] - 1
    before = before[~np.isin(before, at)]
    return motion if not len(before) else motion[np.delete(np.arange(len(motion)), before)]

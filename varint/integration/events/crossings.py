"""Zero crossings along a trajectory, none lost within a step, located with the rule's own
accuracy.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from varint.discrete.lagrangian import energy_function
from varint.errors import InputError
from varint.integration.events.enclosures import enclosure_function
from varint.integration.events.isolation import CrossingSearch, is_wanted, isolate, points_at
from varint.integration.events.roots import Points, join_points
from varint.integration.state import NodeBlock
from varint.numerics.arrays import over_columns
from varint.results.records import Event
from varint.results.trajectory import Trajectory
from varint.scene.expressions import in_own_symbols
from varint.scene.system import System

IMPACTS = ("impact", "stop")  # events at which velocities jump
ROUND_OFF = 1e-12  # of the value before a jump: so near to zero is zero after it


@dataclass(frozen=True, eq=False)
class Watch:
    """An expression whose zeros are wanted: those where it rises (+1), falls (−1), or both (0)."""

    name: str
    expression: Any
    direction: int


def parse_watch(what: str, wanted: Any) -> Watch:
    """`expression` or `(expression, direction)` as the user gave it."""
    expression, direction = (
        wanted if isinstance(wanted, tuple) and len(wanted) == 2 else (wanted, 0)
    )
    if direction not in (-1, 0, 1):
        raise InputError(
            f"the direction of {what} must be +1 (rising), -1 (falling) or 0 (both), got "
            f"{direction!r}"
        )
    if not isinstance(expression, ca.SX) or expression.numel() != 1:
        raise InputError(
            f"{what} must be one SX expression, or (expression, direction), got {wanted!r}"
        )
    return Watch(what, expression, direction)


def parse_watches(events: Any) -> list[Watch]:
    """The expressions of `events`, a dictionary by name or None."""
    if events is None:
        return []
    if not isinstance(events, Mapping):
        raise InputError(
            f"events must be a dictionary of names and expressions, got {type(events).__name__}"
        )
    return [parse_watch(name, wanted) for name, wanted in events.items()]


class Crossings(NamedTuple):
    """Zeros in the order of time: the states on both sides, and which are jumps at the node after
    their interval.
    """

    before: Points
    after: Points
    jump: np.ndarray


def crossing_search(system: System, watch: Watch) -> CrossingSearch:
    """The search for the zeros of a watched expression in motions of the system."""
    s, expression = system, in_own_symbols(watch.expression, system)
    rate = ca.SX(np.nan)
    if not ca.depends_on(expression, ca.vertcat(s.v, s.control)):
        rate = ca.jtimes(expression, s.q, s.v) + ca.jacobian(expression, s.t)
    both = ca.densify(ca.vertcat(expression, rate))
    values = ca.Function("values", [s.q, s.v, s.t, s.control, s.c], [both], {"cse": True})
    return CrossingSearch(watch.name, watch.direction, values, enclosure_function(s, expression))


def find_crossings(
    search: CrossingSearch, motion: Trajectory, impacts: Mapping[int, Event]
) -> Crossings:
    """The zeros of a watched expression along a motion with impacts at some of its nodes.

    A zero at the first node does not count; a zero at a later node does, and so does a change of
    sign by an impact, at its time. A pole is no zero.
    """
    start, end = _ends(search, motion, impacts)
    before, after = isolate(search, motion, start, end)
    jumps = _jumps(start, end)
    jumps = jumps[is_wanted(search, np.sign(end.value[jumps]))]
    before = join_points(before, end.at(jumps))
    after = join_points(after, start.at(jumps + 1))
    jump = np.arange(len(before.t)) >= len(before.t) - len(jumps)
    order = np.lexsort((jump, before.t * np.sign(motion.h)))
    return Crossings(before.at(order), after.at(order), jump[order])


def impacts_in(blocks: Iterable[NodeBlock]) -> dict[int, Event]:
    """The first impact at each node that has one, by the node's number in these blocks; a block
    with impacts has but this one node.
    """
    found, first = {}, 0
    for block in blocks:
        impact = next((event for event in block.events if event.kind in IMPACTS), None)
        if impact is not None and block.good:
            found[first] = impact
        first += block.good
    return {i: impact for i, impact in found.items() if i}


def _ends(
    search: CrossingSearch, motion: Trajectory, impacts: Mapping[int, Event]
) -> tuple[Points, Points]:
    """All nodes as the motion leaves them; all but the first as it comes to them."""
    count = len(motion)
    node = np.arange(count)
    begin = points_at(search, motion, node, motion.t, motion.q, motion.v, motion.p)
    v, p = motion.v[1:].copy(), motion.p[1:].copy()
    for i, impact in impacts.items():
        v[i - 1], p[i - 1] = impact.v_before, impact.p_before
    end = points_at(search, motion, node[:-1], motion.t[1:].copy(), motion.q[1:].copy(), v, p)
    none = motion.t[1:] == motion.t[:-1]  # nothing happens between them
    if none.any():
        same = begin.at(slice(0, -1))
        which = np.flatnonzero(none)
        for kept, new in zip(end, same, strict=True):
            kept[which] = new[which]
    return begin, end


def _jumps(start: Points, end: Points) -> np.ndarray:
    """Intervals after which an impact changes the sign, or ends at zero."""
    before, after = end.value, start.value[1:]
    jumps = (before * after < 0) | ((before != 0) & (np.abs(after) <= ROUND_OFF * np.abs(before)))
    return np.flatnonzero(jumps & (before != after))


def events_at(search: CrossingSearch, motion: Trajectory, found: Crossings) -> list[Event]:
    """The zeros of a watched expression as records."""
    if not len(found.jump):
        return []
    energies = [
        over_columns(energy_function(motion.system), x.q, x.v, x.t[:, None], motion.c)[0][:, 0]
        for x in (found.before, found.after)
    ]
    before, after = found.before, found.after
    columns: Sequence[Any] = [
        a.tolist() for a in (before.t, *energies, before.q, before.v, before.p, after.v, after.p)
    ]
    return [
        Event(t, search.name, None, 0.0, e0, e1, *map(tuple, states))
        for t, e0, e1, *states in zip(*columns, strict=True)
    ]


def log_crossings(
    searches: Sequence[CrossingSearch], motion: Trajectory, impacts: Mapping[int, Event]
) -> list[Event]:
    """The zeros of all watched expressions along a motion with impacts at some of its nodes."""
    return [
        event
        for search in searches
        for event in events_at(search, motion, find_crossings(search, motion, impacts))
    ]

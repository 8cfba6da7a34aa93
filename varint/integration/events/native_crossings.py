"""Zeros of watched expressions by the loops in C that made the motion, where there are such."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from varint.codegen.cache import CompileError
from varint.codegen.crossings import Nodes, Numbers, locate_zeros
from varint.codegen.kernel import Kernel
from varint.discrete.constraints import ActiveSet
from varint.integration.events.both_sides import Sides, both_sides, by_active_set
from varint.integration.events.crossings import Crossings, events_at, find_crossings, in_time
from varint.integration.events.isolation import (
    HALVINGS,
    MOST_PIECES,
    CrossingSearch,
    is_wanted,
    points_at,
)
from varint.integration.events.roots import GUESSES, LOCATED, POLE, SECANTS, Points, join_points
from varint.integration.events.substeps import substeps_of
from varint.numerics.limits import ROOT_ITERATIONS
from varint.results.dense_output import node_tolerance, step_controls
from varint.results.records import Event
from varint.results.trajectory import Trajectory

NUMBERS = Numbers(HALVINGS, MOST_PIECES, ROOT_ITERATIONS, SECANTS, GUESSES, LOCATED, POLE)
LoopIn = Callable[[ActiveSet], Kernel | None]


def crossings_by(
    kernel: Kernel | None,
    search: CrossingSearch,
    motion: Trajectory,
    impacts: Mapping[int, Event],
    loop_in: LoopIn | None = None,
) -> Crossings:
    """`find_crossings`, in C where there is a loop: of the scene, or of what holds."""
    sides = both_sides(motion, impacts)
    found = _zeros(kernel, search, motion, sides, loop_in)
    if found is None:
        return find_crossings(search, motion, impacts, substeps_of(kernel))
    zeros = join_points(*found) if len(found) != 1 else found[0]
    jumping = zeros.at(slice(0)), zeros.at(slice(0))
    if not sides.step.all():
        jumping = _jumping(search, motion, sides)
    return in_time(search, motion, zeros, *jumping)


def _zeros(
    kernel: Kernel | None,
    search: CrossingSearch,
    motion: Trajectory,
    sides: Sides,
    loop_in: LoopIn | None,
) -> list[Points] | None:
    """All zeros that are wanted, in parts; None where another search is needed."""
    s = motion.system
    if s.rays or motion.u.shape[1] > 1:
        return None
    if motion.active_set is not None and loop_in is not None:
        parts = by_active_set(motion, sides)
        legs = [(loop_in(motion.active_sets[i]), part) for i, part in parts]
    else:
        legs = [(None if s.structure.contacts or motion.active_sets else kernel, sides)]
    functions = search.as_data() if legs and all(loop for loop, _ in legs) else None
    if functions is None:
        return None
    found, close = [], node_tolerance(motion) * abs(motion.h)
    for loop, (node, t, q, v, p, step) in legs:
        assert loop is not None
        u = step_controls(motion, motion.k[node], np.ones(len(node)))  # held
        nodes = Nodes(t, q, v, p, u, motion.h, motion.c, close, step)
        try:
            zeros = locate_zeros(loop, *functions, nodes, NUMBERS)
        except CompileError:
            return None
        if zeros is None:
            return None
        each, side, *states = zeros
        t, value, rate, q, v, p = states
        wanted = is_wanted(search, side)
        found.append(Points(node[each], t, q, v, p, value, rate).at(wanted))
    return found


def _jumping(search: CrossingSearch, motion: Trajectory, sides: Sides) -> tuple[Points, Points]:
    """The states in which the motion comes to nodes and leaves them, where they may differ."""
    node, pair = sides.node, np.flatnonzero(~sides.step)
    last = np.append(node[1:] != node[:-1], True)  # of those of a node
    pair = pair[last[pair + 1]]
    before, after = (
        points_at(search, motion, of, *(x[some] for x in sides[1:5]))
        for of, some in ((node[pair + 1] - 1, pair), (node[pair + 1], pair + 1))
    )
    return before, after


def log_crossings(
    searches: Sequence[CrossingSearch],
    motion: Trajectory,
    impacts: Mapping[int, Event],
    kernel: Kernel | None,
    loop_in: LoopIn | None = None,
) -> list[Event]:
    """The zeros of all watched expressions along a motion with impacts at some of its nodes."""
    return [
        event
        for search in searches
        for event in events_at(
            search, motion, crossings_by(kernel, search, motion, impacts, loop_in)
        )
    ]

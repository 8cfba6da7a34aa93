"""Zeros of watched expressions by the loops in C that made the motion, where there are such."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from varint.codegen.cache import CompileError
from varint.codegen.crossings import Nodes, Numbers, locate_zeros
from varint.codegen.kernel import Kernel
from varint.discrete.constraints import ActiveSet
from varint.integration.events.both_sides import (
    Before,
    jumping_nodes,
    states_before,
    steps_by_active_set,
)
from varint.integration.events.crossings import Crossings, events_at, find_crossings, in_time
from varint.integration.events.isolation import (
    DEEPEST,
    HALVINGS,
    MOST_PIECES,
    SHALLOW,
    CrossingSearch,
    is_wanted,
)
from varint.integration.events.roots import GUESSES, LOCATED, POLE, SECANTS, Points, join_points
from varint.integration.events.substeps import substeps_of
from varint.numerics.limits import ROOT_ITERATIONS
from varint.results.dense_output import node_tolerance, step_controls
from varint.results.records import Event
from varint.results.trajectory import Trajectory

_WAYS = HALVINGS, DEEPEST, MOST_PIECES, ROOT_ITERATIONS, SECANTS, GUESSES
NUMBERS = Numbers(*_WAYS, LOCATED, POLE, SHALLOW)
LoopIn = Callable[[ActiveSet], Kernel | None]


def crossings_by(
    kernel: Kernel | None,
    search: CrossingSearch,
    motion: Trajectory,
    impacts: Mapping[int, Event],
    loop_in: LoopIn | None = None,
) -> Crossings:
    """`find_crossings`, in C where there is a loop: of the scene, or of what holds."""
    before = states_before(motion, impacts)
    found = _zeros(kernel, search, motion, before, loop_in)
    if found is None:
        return find_crossings(search, motion, impacts, substeps_of(kernel))
    zeros = join_points(*found) if len(found) != 1 else found[0]
    come = leave = zeros.at(slice(0))
    functions = search.as_data()
    if functions is not None and motion.active_set is not None:
        come, leave = jumping_nodes(functions[0], motion, before)
    return in_time(search, motion, zeros, come, leave)


def _zeros(
    kernel: Kernel | None,
    search: CrossingSearch,
    motion: Trajectory,
    before: Before,
    loop_in: LoopIn | None,
    some: np.ndarray | None = None,
) -> list[Points] | None:
    """All zeros that are wanted, in parts; None where another search is needed. `some`: the only
    steps that are of the motion.
    """
    s = motion.system
    if s.rays or motion.u.shape[1] > 1 or motion.sizes is not None:
        return None
    if motion.active_set is not None and loop_in is not None:
        parts = steps_by_active_set(motion)
        legs = [(loop_in(motion.active_sets[i]), steps) for i, steps in parts]
    else:
        steps = motion.t[1:] != motion.t[:-1] if some is None else some
        legs = [(None if s.structure.contacts or motion.active_sets else kernel, steps)]
    functions = search.as_data() if legs and all(loop for loop, _ in legs) else None
    if functions is None:
        return None
    found, close = [], node_tolerance(motion) * abs(motion.h)
    t, q, v, p = motion.t, motion.q, motion.v, motion.p
    u = step_controls(motion, motion.k, np.ones(len(motion)))  # held
    for loop, steps in legs:
        assert loop is not None
        nodes = Nodes(t, q, v, p, u, motion.h, motion.c, close, steps, before.states, before.row)
        try:
            z = locate_zeros(loop, *functions, nodes, NUMBERS)
        except CompileError:
            return None
        if z is None:
            return None
        each = Points(z.node, z.t, z.q, z.v, z.p, z.value, z.rate)
        found.append(each.at(is_wanted(search, z.side)))
    return found


def zeros_in_steps(
    kernel: Kernel | None, search: CrossingSearch, motion: Trajectory, steps: np.ndarray
) -> Points | None:
    """The zeros within some steps, (M − 1,) of bool, between nodes that are of several motions, in
    C; None where another search is needed.
    """
    found = _zeros(kernel, search, motion, states_before(motion, {}), None, steps)
    return None if found is None else join_points(*found) if len(found) != 1 else found[0]


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

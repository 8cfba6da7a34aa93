"""Zeros of watched expressions by the loop in C that made the motion, where there is one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from varint.codegen.cache import CompileError
from varint.codegen.crossings import Nodes, Numbers, Zeros, locate_zeros
from varint.codegen.kernel import Kernel
from varint.integration.events.crossings import Crossings, events_at, find_crossings
from varint.integration.events.isolation import (
    HALVINGS,
    MOST_PIECES,
    CrossingSearch,
    is_wanted,
)
from varint.integration.events.roots import GUESSES, LOCATED, POLE, SECANTS, Points
from varint.integration.events.substeps import substeps_of
from varint.numerics.limits import ROOT_ITERATIONS
from varint.results.dense_output import node_tolerance, step_controls
from varint.results.records import Event
from varint.results.trajectory import Trajectory

NUMBERS = Numbers(HALVINGS, MOST_PIECES, ROOT_ITERATIONS, SECANTS, GUESSES, LOCATED, POLE)


def crossings_by(
    kernel: Kernel | None,
    search: CrossingSearch,
    motion: Trajectory,
    impacts: Mapping[int, Event],
) -> Crossings:
    """`find_crossings`, in C where the motion is smooth between its nodes."""
    zeros = None if kernel is None else _zeros(kernel, search, motion)
    if zeros is None:
        return find_crossings(search, motion, impacts, substeps_of(kernel))
    found = Points(zeros.node, zeros.t, zeros.q, zeros.v, zeros.p, zeros.value, zeros.rate)
    wanted = np.flatnonzero(is_wanted(search, zeros.side))
    order = wanted[np.argsort(zeros.t[wanted] * np.sign(motion.h), kind="stable")]
    found = found.at(order)
    return Crossings(found, found, np.zeros(len(order), dtype=bool))


def _zeros(kernel: Kernel, search: CrossingSearch, motion: Trajectory) -> Zeros | None:
    """All zeros; None where another search is needed."""
    s = motion.system
    if s.structure.contacts or s.rays or motion.active_set is not None or motion.u.shape[1] > 1:
        return None
    functions = search.as_data()
    if functions is None:
        return None
    close = node_tolerance(motion) * abs(motion.h)
    u = step_controls(motion, motion.k, np.ones(len(motion)))  # held
    nodes = Nodes(motion.t, motion.q, motion.v, motion.p, u, motion.h, motion.c, close)
    try:
        return locate_zeros(kernel, *functions, nodes, NUMBERS)
    except CompileError:
        return None


def log_crossings(
    searches: Sequence[CrossingSearch],
    motion: Trajectory,
    impacts: Mapping[int, Event],
    kernel: Kernel | None,
) -> list[Event]:
    """The zeros of all watched expressions along a motion with impacts at some of its nodes."""
    return [
        event
        for search in searches
        for event in events_at(search, motion, crossings_by(kernel, search, motion, impacts))
    ]

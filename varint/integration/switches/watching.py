"""Zeros of watched expressions along a motion from switch to switch, those by impacts included."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from varint.integration.events.crossings import (
    IMPACTS,
    Watch,
    crossing_search,
    events_at,
    find_crossings,
)
from varint.integration.events.native_crossings import crossings_by, log_crossings
from varint.integration.switches.course import Course, Piece, kernel_in
from varint.integration.switches.joined import piece_motion
from varint.integration.trajectories import cut_at, in_order
from varint.results.records import Event
from varint.results.trajectory import Trajectory


def cut_piece(course: Course, last: Sequence[Piece], piece: Piece, stop: Watch) -> Piece | None:
    """The piece until an expression crosses zero, at its first node where an impact between the
    `last` one and it makes that; None where it does not.
    """
    if _by_impact(course, last, piece, stop):
        return piece._replace(t=piece.t[:1], states=piece.states[:1])
    motion = piece_motion(course, piece)
    kernel = kernel_in(course, piece.branch)
    end = crossings_by(kernel, crossing_search(motion.system, stop), motion, {})
    if not len(end.jump):
        return None
    cut = cut_at(motion, 0, end)
    return piece._replace(t=cut.t, states=np.stack([cut.q, cut.p, cut.v], axis=1))


def with_events(
    course: Course, pieces: Sequence[Piece], motion: Trajectory, watches: Sequence[Watch]
) -> Trajectory:
    """The motion with the zeros of watched expressions."""
    noted: list[Event] = []
    for i, piece in enumerate(pieces if watches else ()):
        for watch in watches:
            noted += _by_impact(course, pieces[max(i - 1, 0) : i], piece, watch)
        if len(piece.t) > 1:
            part = piece_motion(course, piece)
            searches = [crossing_search(part.system, watch) for watch in watches]
            noted += log_crossings(searches, part, {}, kernel_in(course, piece.branch))
    every = in_order([*motion.events, *noted], motion.h)
    return replace(motion, events=every) if watches else motion


def _by_impact(course: Course, last: Sequence[Piece], piece: Piece, watch: Watch) -> list[Event]:
    """The change of an expression's sign by the impacts at which a piece begins."""
    impacts = [event for event in piece.events if event.kind in IMPACTS]
    if not last or not impacts:
        return []
    motion = piece_motion(course, piece)
    states = np.stack([last[-1].states[-1], piece.states[0]])
    both = replace(
        motion,
        system=course.system,
        c=course.problem.c,
        u=np.tile(piece.branch.controls, (1, 1, 1)),
        t=piece.t[[0, 0]],
        q=states[:, 0],
        p=states[:, 1],
        k=np.array([0, 0]),
    )
    both.__dict__["v"] = np.ascontiguousarray(states[:, 2])
    search = crossing_search(course.system, watch)
    return events_at(search, both, find_crossings(search, both, {1: impacts[0]}))

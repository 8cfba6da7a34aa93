"""Zeros of watched expressions along a motion from switch to switch, those by impacts included."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from varint.integration.events.crossings import (
    IMPACTS,
    Crossings,
    Watch,
    crossing_search,
    events_at,
    find_crossings,
)
from varint.integration.events.native_crossings import (
    crossings_by,
    log_crossings,
    zeros_in_steps,
)
from varint.integration.events.roots import Points
from varint.integration.switches.branch import Branch
from varint.integration.switches.course import Course, Piece, kernel_in
from varint.integration.switches.joined import piece_motion, pieces_motion
from varint.integration.trajectories import cut_at, in_order
from varint.results.records import Event
from varint.results.trajectory import Trajectory


def _cut_piece(course: Course, last: Sequence[Piece], piece: Piece, stop: Watch) -> Piece | None:
    """The piece until an expression crosses zero, at its first node where an impact between the
    `last` one and it makes that; None where it does not.
    """
    if _by_impact(course, last, piece, stop):
        return piece._replace(t=piece.t[:1], states=piece.states[:1], every=None)
    motion = piece_motion(course, piece)
    kernel = kernel_in(course, piece.branch)
    end = crossings_by(kernel, crossing_search(motion.system, stop), motion, {})
    if not len(end.jump):
        return None
    cut = cut_at(motion, 0, end)
    states = np.stack([cut.q, cut.p, cut.v], axis=1)
    every = None if piece.every is None else (cut.t, states)
    return piece._replace(t=cut.t, states=states, every=every)


def cut_among(
    course: Course, before: Sequence[Piece], pieces: Sequence[Piece], stop: Watch
) -> list[Piece] | None:
    """Pieces that follow the last one `before` them, until an expression crosses zero; None where
    it does not.
    """
    for i in sorted(_near_stop(course, pieces, stop)):
        last = pieces[i - 1 : i] if i else before
        cut = _cut_piece(course, last, pieces[i], stop)
        if cut is not None:
            return [*pieces[:i], cut]
    return None


def _near_stop(course: Course, pieces: Sequence[Piece], stop: Watch) -> set[int]:
    """Those of some pieces in which an expression crosses zero, or an impact may have made it."""
    found = {i for i, piece in enumerate(pieces) if piece.events}
    for some, _, zeros in _zeros_by_branch(course, pieces, stop):
        lengths = [len(pieces[i].nodes[0]) for i in some]
        found.update(some if zeros is None else np.repeat(some, lengths)[zeros.node].tolist())
    return found


def _zeros_by_branch(
    course: Course, pieces: Sequence[Piece], watch: Watch
) -> Iterator[tuple[list[int], Trajectory, Points | None]]:
    """Of each branch its pieces, as one motion, and the zeros of an expression in them; None where
    they are to be looked for one by one.
    """
    groups: dict[Branch, list[int]] = {}
    for i, piece in enumerate(pieces):
        if len(piece.t) > 1:
            groups.setdefault(piece.branch, []).append(i)
    for branch, some in groups.items():
        part, steps = pieces_motion(course, [pieces[i] for i in some])
        search = crossing_search(part.system, watch)
        yield some, part, zeros_in_steps(kernel_in(course, branch), search, part, steps)


def with_events(
    course: Course, pieces: Sequence[Piece], motion: Trajectory, watches: Sequence[Watch]
) -> Trajectory:
    """The motion with the zeros of watched expressions."""
    noted: list[Event] = []
    for watch in watches:
        for i, piece in enumerate(pieces):
            noted += _by_impact(course, pieces[max(i - 1, 0) : i], piece, watch)
        for some, part, zeros in _zeros_by_branch(course, pieces, watch):
            search = crossing_search(part.system, watch)
            if zeros is not None:
                noted += events_at(search, part, Crossings(zeros, zeros, zeros.t != zeros.t))
                continue
            for i in some:
                one, kernel = piece_motion(course, pieces[i]), kernel_in(course, pieces[i].branch)
                noted += log_crossings([search], one, {}, kernel)
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

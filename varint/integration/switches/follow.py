"""A motion from switch to switch: smooth pieces, the last step of each of which ends where the
scene changes branch.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

from varint.integration.switches.branch import Branch
from varint.integration.switches.corner import past_corner
from varint.integration.switches.course import Course, Piece
from varint.integration.switches.meetings import Meetings
from varint.integration.switches.next_branch import first_branch, next_branch
from varint.integration.switches.passage import CROWDED, EDGE, Found, Passage
from varint.integration.switches.piece import (
    BORDER,
    MOST_NODES,
    next_piece,
    of_one_unit,
    unit_of,
)
from varint.integration.switches.timetable import timed
from varint.integration.switches.touching import held_scene, scene_in
from varint.integration.switches.zeno import ARCS, rest_after
from varint.results.records import State

SHORTEN, SHORTER = 4.0, 12  # a unit by so much, so often, whose first piece cannot be followed
MOST_PIECES = 50_000
CROWD = 60  # so many pieces, one after the other, that are CROWDED


def follow(course: Course, parts: int) -> Iterator[list[Piece] | None]:
    """The pieces of the motion with so many steps a unit, some at a time; None at the end where it
    is not known how it goes on, or the steps are too large.
    """
    problem, system, times = course.problem, course.system, course.timetable.times
    begin, total = problem.t0, problem.h
    clocks = timed(system).places
    q, p, t, row, short, nodes = problem.q0, problem.p0, begin, 0, 0, 0
    lately: list[Piece] = []
    passed_by: list[int] = []
    branch, contacts, passage = first_branch(course), Meetings(course), Passage(course, parts)
    if branch is not None and branch.active_set is not None:
        branch, first = contacts.begin(branch)
        p = first.p
    made = 0
    while made < MOST_PIECES:
        scene = branch and scene_in(system, branch)
        if branch is None or scene is None or short == CROWD or nodes > MOST_NODES:
            break
        until = float(times[row]) if row < len(times) else begin + total
        start = State(t, q, q, p)
        soon, unit = contacts.flight(start, branch, until)
        count = None
        if course.grid is not None and (soon == until or unit >= abs(course.grid)):
            soon, count = _to_grid(course, t, until)
        found = passage.take(branch, start, soon, MOST_PIECES - made)
        found = found or _one_piece(course, branch, start, soon, parts, unit, count)
        if found is None:
            break
        *passed, (piece, crossed) = found
        if passed:
            nodes += sum(len(x.nodes[0]) for x, _ in passed)
            short = 0
            lately = [*lately, *(x for x, _ in passed[-ARCS:])][-ARCS:]
            passed_by = [*passed_by, *(x[0] for _, x in passed[-ARCS:] if x)][-ARCS:]
        made, branch = made + len(found), piece.branch
        at_edge = abs(until - piece.t[-1]) <= EDGE * max(abs(until), abs(total))
        if at_edge:
            piece.t[-1] = piece.nodes[0][-1] = until
        piece = piece._replace(events=contacts.noted())
        yield [*(x for x, _ in passed), piece]
        if crossed is None or crossed[0] < 0:
            lately, passed_by = [], []
        else:
            lately, passed_by = [*lately, piece][-ARCS:], [*passed_by, crossed[0]][-ARCS:]
            size = contacts.extent.far
            rest = rest_after(course, lately, passed_by, size) if row == len(times) else None
            if rest is not None:
                yield [rest]
                return
        short = short + 1 if abs(piece.t[-1] - piece.t[0]) < CROWDED * abs(total) else 0
        nodes += len(piece.nodes[0])
        t, (q, p, v) = float(piece.t[-1]), piece.states[-1]
        contacts.extent.add(piece.states[:, 0], piece.states[:, 2])
        if crossed is None and soon != until:
            continue
        if at_edge and row == len(times):
            return
        state, before = State(t, q, v, p), branch
        if crossed is not None and crossed[0] < 0:
            branch, state = contacts.meet(state, branch, -1 - crossed[0])
            p = state.p
            if branch is None or not at_edge:
                continue
        values, known, at_zero = list(branch.values), list(clocks), list(branch.sliding)
        acting = branch.controls
        if at_edge:
            if crossed is not None and crossed[0] >= 0 and crossed[0] not in at_zero:
                at_zero.append(crossed[0])
            row += 1
            acting = tuple(course.timetable.controls[row].tolist())
            for j, x in zip(clocks, course.timetable.values[row].tolist(), strict=True):
                values[j] = x
        elif crossed is not None and crossed[0] in branch.sliding:
            values[crossed[0]] = crossed[1]
            known.append(crossed[0])
        elif crossed is not None:
            at_zero.append(crossed[0])
        branch = branch._replace(values=tuple(values), controls=acting)
        known += contacts.ties(branch)
        branch = next_branch(course, state, branch, at_zero, known)
        way = math.copysign(1.0, total)
        held = held_scene(system, before.active_set)
        corner = branch and past_corner(held, state, problem.c, way, before, branch)
        q, p, branch = corner or (q, p, None)
        if branch is not None:
            branch, state = contacts.after_switch(State(t, q, state.v, p), branch)
            p = state.p
    yield None


def _one_piece(
    course: Course,
    branch: Branch,
    start: State,
    until: float,
    parts: int,
    shortest: float,
    count: int | None,
) -> Found | None:
    """As `next_piece`, with a shorter unit where a branch is new and its first piece fails."""
    scene = scene_in(course.system, branch)
    assert scene is not None
    found = next_piece(course, scene, branch, start, until, parts, shortest, count)
    for _ in range(SHORTER):
        alike = of_one_unit(branch)
        if found is not None or alike in course.known or alike not in course.units:
            break
        course.units[alike] /= SHORTEN
        found = next_piece(course, scene, branch, start, until, parts, shortest, count)
    return found and [found]


def _to_grid(course: Course, t: float, until: float) -> tuple[float, int]:
    """Until when to go on in steps of a given size, and in how many: to the next node of the grid,
    and from there by whole steps.
    """
    begin, h = course.problem.t0, course.grid
    assert h is not None
    close = EDGE * max(abs(begin), abs(course.problem.h)) / abs(h) + BORDER
    done, end = (t - begin) / h, (until - begin) / h
    if abs(done - round(done)) > close:
        soon = begin + h * math.ceil(done)
        return (until, 1) if math.ceil(done) >= end - close else (soon, 1)
    whole = round(end) if abs(end - round(end)) <= close else math.floor(end)
    count = whole - round(done)
    if count < 1 or abs(end - whole) <= close:
        return until, max(count, 1)
    return begin + h * whole, count


def first_unit(course: Course) -> float | None:
    """The unit of time at the start; None where it is not known on which branch it is."""
    branch, problem = first_branch(course), course.problem
    scene = branch and scene_in(course.system, branch)
    if branch is None or scene is None:
        return None
    return unit_of(course, branch, State(problem.t0, problem.q0, problem.q0, problem.p0))

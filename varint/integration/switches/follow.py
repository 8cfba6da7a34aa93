"""A motion from switch to switch: smooth pieces, the last step of each of which ends where the
scene changes branch.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from varint.codegen.kernel import Kernel
from varint.discrete.legendre import velocity_function
from varint.integration.switches.branch import (
    Branch,
    BranchScene,
    branch_scene,
)
from varint.integration.switches.corner import past_corner
from varint.integration.switches.course import Course, Piece, which_moves
from varint.integration.switches.crossing import Crossing, Nodes, NoWayIn, first_crossing
from varint.integration.switches.decision import (
    all_parameters,
)
from varint.integration.switches.drive import drive_frequency, fastest_small_motion
from varint.integration.switches.loop import Grid, Loop, Part, kernel_of, loop_steps, other_steps
from varint.integration.switches.meetings import Meetings
from varint.integration.switches.next_branch import first_branch, next_branch
from varint.integration.switches.timetable import timed
from varint.integration.switches.touching import held_scene, scene_in
from varint.integration.switches.zeno import ARCS, rest_after
from varint.numerics.arrays import call
from varint.results.records import State
from varint.scene.system import System

ANGLE = 4.0  # radians of the fastest small motion in a unit, which has as many steps as asked for
UNITS = 4  # in the duration at least
SHORTEN, SHORTER = 4.0, 12  # a unit by so much, so often, whose first piece cannot be followed
LEAST_UNIT = 1 / 16  # of a unit, after a piece that is shorter
LONGER = 4.0  # units, a piece of which makes them longer again
FIRST, MOST_IN_BLOCK = 16, 4096  # steps of a block, after each of which switches are looked for
MOST_PIECES, MOST_NODES = 50_000, 20_000_000
CROWD, CROWDED = 60, 1e-10  # so many pieces, one after the other, as short as this of the duration
EDGE = 4 * np.finfo(float).eps  # of time: a switch this near to the end of a row is there
BORDER = 1e-6  # of a unit: so much more than whole ones is whole ones


def follow(course: Course, parts: int) -> Iterator[Piece | None]:
    """The pieces of the motion with so many steps a unit; None at the end where it is not known how
    it goes on, or the steps are too large.
    """
    problem, system, times = course.problem, course.system, course.timetable.times
    begin, total = problem.t0, problem.h
    clocks = timed(system).places
    q, p, t, row, short, nodes = problem.q0, problem.p0, begin, 0, 0, 0
    lately: list[Piece] = []
    passed_by: list[int] = []
    branch, contacts = first_branch(course), Meetings(course)
    if branch is not None and branch.active_set is not None:
        branch, first = contacts.begin(branch)
        p = first.p
    for _ in range(MOST_PIECES):
        scene = branch and scene_in(system, branch)
        if branch is None or scene is None or short == CROWD or nodes > MOST_NODES:
            break
        until = float(times[row]) if row < len(times) else begin + total
        start = State(t, q, q, p)
        soon, unit = contacts.flight(start, branch, until)
        count = None
        if course.grid is not None and (soon == until or unit >= abs(course.grid)):
            soon, count = _to_grid(course, t, until)
        found = _piece(course, scene, branch, start, soon, parts, unit, count)
        for _ in range(SHORTER):
            alike = _alike(branch)
            if found is not None or alike in course.known or alike not in course.units:
                break
            course.units[alike] /= SHORTEN
            found = _piece(course, scene, branch, start, soon, parts, unit, count)
        if found is None:
            break
        piece, crossed = found
        at_edge = abs(until - piece.t[-1]) <= EDGE * max(abs(until), abs(total))
        if at_edge:
            piece.t[-1] = until
        piece = piece._replace(events=contacts.noted())
        yield piece
        if crossed is None or crossed[0] < 0:
            lately, passed_by = [], []
        else:
            lately, passed_by = [*lately, piece][-ARCS:], [*passed_by, crossed[0]][-ARCS:]
            rest = rest_after(course, lately, passed_by) if row == len(times) else None
            if rest is not None:
                yield rest
                return
        short = short + 1 if abs(piece.t[-1] - t) < CROWDED * abs(total) else 0
        nodes += len(piece.t)
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
        passed = branch and past_corner(held, state, problem.c, way, before, branch)
        q, p, branch = passed or (q, p, None)
        if branch is not None:
            branch, state = contacts.after_switch(State(t, q, state.v, p), branch)
            p = state.p
    yield None


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
    return _unit(course, branch, State(problem.t0, problem.q0, problem.q0, problem.p0))


def _piece(
    course: Course,
    scene: BranchScene,
    branch: Branch,
    start: State,
    until: float,
    parts: int,
    shortest: float,
    count: int | None,
) -> tuple[Piece, tuple[int, float] | None] | None:
    """The piece from a state until a time or a switch, and which switch that is; None where its
    steps are too large or do not enter the branch. A unit is no longer than `shortest`, and the
    number of steps may be given.
    """
    c, span = all_parameters(course.problem.c, branch), until - start.t
    kernel = _kernel(course, scene, branch)
    if kernel is None:
        return None
    unit = min(_unit(course, branch, start), shortest)
    if not abs(span) / unit * parts < MOST_NODES:
        return None
    steps = count or parts * max(math.ceil(abs(span) / unit - BORDER), 1)
    loop = Loop(scene.system, course.rule, kernel, c)
    h, k, carry, size = span / steps, 0, None, FIRST
    q, p = start.q, start.p
    times, iterations, residual = [np.array([start.t])], 0, 0.0
    states: list[np.ndarray] = []
    while k < steps:
        some = min(size, steps - k)
        t = start.t + h * np.arange(k, k + some + 1)
        if k + some == steps:
            t[-1] = until
        block = _block(scene, loop, (q, p), Grid(start.t, h, some, k), carry, t)
        if block is None:
            return None
        part, found = block
        if not states:
            states.append(part.rows[:1])
        iterations += part.iterations
        residual = max(residual, part.residual)
        if found is not None:
            last = found.step + 1
            times += [t[1:last], np.array([found.t])]
            states += [part.rows[1:last], found.state[None]]
            break
        times.append(t[1:])
        states.append(part.rows[1:])
        k, carry, size = k + some, part.carry, min(4 * size, MOST_IN_BLOCK)
        q, p = part.rows[-1, :2]
    alike = _alike(branch)
    # the next piece on this branch is as long, more or less
    if found is not None and unit != shortest:
        length, most = abs(found.t - start.t), course.known.setdefault(alike, unit)
        if most == unit or length > LONGER * unit:
            course.units[alike] = min(most, max(length, most * LEAST_UNIT))
    nodes = _with_unit_rays(course.system, np.concatenate(states))
    piece = Piece(branch, h, steps, np.concatenate(times), nodes, iterations, residual)
    return piece, None if found is None else scene.watched[found.margin]


def _with_unit_rays(system: System, states: np.ndarray) -> np.ndarray:
    """The same states (q, p, v), (N, 3, n), of unit quaternions."""
    for group in system.rays:
        at = list(group)
        q, p, v = (states[:, i, at] for i in range(3))
        length = np.linalg.norm(q, axis=-1, keepdims=True)
        states[:, :, at] = np.stack([q / length, p * length, v / length], axis=1)
    return states


def _block(
    scene: BranchScene,
    loop: Loop,
    start: tuple[np.ndarray, np.ndarray],
    grid: Grid,
    carry: np.ndarray | None,
    t: np.ndarray,
) -> tuple[Part, Crossing | None] | None:
    """Some steps of a piece, and the switch in them: steps after it need not be possible. None
    where those before it are not, or the motion does not enter the branch.
    """
    part: Part | None = loop_steps(loop, *start, grid, carry)
    assert part is not None
    try:
        count = len(part.rows)
        found = first_crossing(scene, loop, Nodes(t[:count], part.rows, grid.first == 0))
        if found is None and not part.whole:
            part = other_steps(loop, *start, grid)
            found = part and first_crossing(scene, loop, Nodes(t, part.rows, grid.first == 0))
    except NoWayIn:
        return None
    return None if part is None else (part, found)


def _kernel(course: Course, scene: BranchScene, branch: Branch) -> Kernel | None:
    which = which_moves(branch)
    if which not in course.kernels:
        course.kernels[which] = kernel_of(scene.system, course.rule, course.backend)
    return course.kernels[which]


def _alike(branch: Branch) -> Branch:
    """What stands for all branches that differ by their controls alone."""
    return branch._replace(controls=()) if branch.controls else branch


def _unit(course: Course, branch: Branch, start: State) -> float:
    """Time in which the fastest small motion turns by `ANGLE`, or a part of the duration."""
    alike = _alike(branch)
    if alike not in course.units:
        system = held_scene(course.system, branch.active_set)
        scene = branch_scene(system)
        assert scene is not None
        c, total = all_parameters(course.problem.c, branch), course.problem.h
        v = call(velocity_function(scene.system), start.q, start.p, np.array([start.t]), c)[0]
        # what holds the motion slows it down
        fastest = fastest_small_motion(scene.system, start._replace(v=v), c)
        drive = drive_frequency(course.system, start._replace(v=v, t=course.problem.t0), c, total)
        fastest = max(fastest, drive)
        most = abs(total) / UNITS
        course.units[alike] = min(most, ANGLE / fastest) if fastest > 0 else most
    return course.units[alike]

"""Many pieces of a motion in one call of C: from switch to switch, as long as it is clear on which
branch it goes on and that branch has been met before.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from varint.codegen.cache import CompileError
from varint.codegen.kernel import Kernel
from varint.codegen.rows import RowFunction, row_function_or_none
from varint.codegen.switches import (
    CLOCK,
    COUNTS,
    SLIDABLE,
    STRAIGHT,
    Mode,
    Numbers,
    Switched,
    pass_switches,
    switched,
)
from varint.integration.switches import crossing
from varint.integration.switches.branch import Branch, branch_scene, passed_straight, slidable
from varint.integration.switches.corner import NO_JUMP, may_jump
from varint.integration.switches.course import Course, Piece, kernel_in
from varint.integration.switches.decision import all_parameters
from varint.integration.switches.fractional import halvings
from varint.integration.switches.frozen import frozen_scene
from varint.integration.switches.halved import velocity_at
from varint.integration.switches.next_branch import AT_ZERO
from varint.integration.switches.piece import (
    BORDER,
    FIRST,
    LEAST_UNIT,
    LONGER,
    MOST_IN_BLOCK,
    MOST_NODES,
    of_one_unit,
)
from varint.integration.switches.timetable import timed
from varint.numerics.limits import ROOT_ITERATIONS
from varint.results.records import State
from varint.scene.memory import per_system
from varint.scene.system import System

CROWDED = 1e-10  # of the duration: pieces as short as this are looked at one by one
EDGE = 4 * np.finfo(float).eps  # of time: a switch this near to the end of a row is there
FIRST_PASSED, MOST_PASSED = 16, 1024  # pieces of a call
ROOM = 2**14  # numbers of each kind at their nodes
FEWEST = 1024  # nodes that have room

Found = list[tuple[Piece, tuple[int, float] | None]]  # pieces, and which switch each ends at


@dataclass(eq=False)
class Passage:
    """What is handed over in every call of a run.

    Attributes
    ----------
    course : Course
    parts : int
        Steps of a unit of time.
    seen : int
        Branches of `course.known` when the table was made.
    most : int
        Pieces of the next call: few at first, for the motion may end before.
    table : Switched or None
        That of the branches that can be passed so.
    places : dict
        Where in it each of them is.
    """

    course: Course
    parts: int
    seen: int = 0
    most: int = FIRST_PASSED
    table: Switched | None = None
    places: dict[Branch, int] = field(default_factory=dict)

    def take(self, branch: Branch, start: State, until: float, most: int) -> Found | None:
        """Up to so many pieces from a state on, until a time or a switch behind which it is not
        clear how the motion goes on; None where not even one is passed so.
        """
        course = self.course
        if len(course.known) != self.seen and course.grid is None:
            self.seen = len(course.known)
            self.table, self.places = _table(course)
        place = self.places.get(of_one_unit(branch))
        if self.table is None or place is None:
            return None
        table, m = self.table, len(branch.values)
        if branch.controls:
            table.c[:, -m - len(branch.controls) : -m] = branch.controls
        table.branches[:, 1] = [course.units[x] for x in self.places]
        v, scene = start.v, branch_scene(course.system, branch.sliding)
        if scene is not None and halvings(course, branch):
            v = velocity_at(scene.system, start, table.c[place])
        passed = pass_switches(
            table,
            place,
            start.t,
            start.q,
            start.p,
            v,
            until=until,
            total=course.problem.h,
            parts=self.parts,
            most=min(most, self.most),
            room=max(ROOM // len(start.q), FEWEST),
            most_nodes=MOST_NODES,
        )
        self.most = min(4 * self.most, MOST_PASSED)
        course.units.update(zip(self.places, table.branches[:, 1].tolist(), strict=True))
        branches = [x._replace(controls=branch.controls) for x in self.places]
        watched = [table.modes[int(i)].watched for i in table.branches[:, 0]]
        found: Found = []
        for piece in passed.pieces.tolist():
            which, h, steps, first, nodes, iterations, residual, margin, lead, trail = piece
            i, some = int(which), slice(int(first), int(first + nodes))
            t, states = passed.t[some], passed.states[some]
            every = (t, states) if lead or trail else None
            if every is not None:
                even = np.r_[0, int(lead) + 1 : len(t) - 1 - int(trail), len(t) - 1]
                t, states = t[even], states[even]
            how = int(steps), t, states, int(iterations), residual
            one = Piece(branches[i], h, *how, every=every)
            found.append((one, watched[i][int(margin)] if margin >= 0 else None))
        return found or None


def _table(course: Course) -> tuple[Switched | None, dict[Branch, int]]:
    """The branches on which a piece has ended at a switch, and where they are in the table."""
    system, modes = course.system, dict[tuple[int, ...], Mode]()
    kept: list[Branch] = []
    for branch in course.known:
        simple = branch.active_set is None and len(branch.sliding) < 2
        if simple and (branch.sliding in modes or _add_mode(course, branch, modes)):
            kept.append(branch)
    lagrangian = _lagrangian_rows(system) if may_jump(system) else None
    if not kept or system.rays or (lagrangian is None and may_jump(system)):
        return None, {}
    acting = (0.0,) * system.structure.controls
    c = np.array([all_parameters(course.problem.c, x._replace(controls=acting)) for x in kept])
    order = list(modes)
    heads = [
        [order.index(x.sliding), course.units[x], course.known[x], halvings(course, x)]
        for x in kept
    ]
    try:
        table = switched(
            tuple(modes.values()),
            np.array(heads, dtype=float),
            np.ascontiguousarray(c, dtype=float),
            lagrangian,
            _kinds(system),
            crossing.AMONG.ravel().copy(),
            NUMBERS,
        )
    except CompileError:
        return None, {}
    return table, {x: i for i, x in enumerate(kept)}


def _add_mode(course: Course, branch: Branch, modes: dict[tuple[int, ...], Mode]) -> bool:
    """Whether what moves on a branch can be handed over; it is then in the table of modes."""
    scene = branch_scene(course.system, branch.sliding)
    kernel: Kernel | None = kernel_in(course, branch)
    if scene is None or kernel is None:
        return False
    margins, ahead = scene.margin_rows, scene.ahead_rows
    if margins is None or ahead is None:
        return False
    held = branch.sliding[0] if branch.sliding else -1
    modes[branch.sliding] = Mode(kernel, margins, ahead, scene.watched, held)
    return True


@per_system
def _kinds(system: System) -> np.ndarray:
    """What each switch is, as c/switches_core.c has it."""
    frozen = frozen_scene(system)
    assert frozen is not None
    kinds = COUNTS * frozen.counts.astype(np.int64)
    several = (SLIDABLE, slidable), (STRAIGHT, passed_straight)
    for kind, places in (*((x, of(system)) for x, of in several), (CLOCK, timed(system).places)):
        kinds[list(places)] += kind
    return kinds


@per_system
def _lagrangian_rows(system: System) -> RowFunction | None:
    """(q, v, t) → L of a branch."""
    frozen = frozen_scene(system)
    assert frozen is not None
    s = frozen.system
    return row_function_or_none("lagrangian", [s.q, s.v, s.t], s.c, [s.lagrangian])


NUMBERS = Numbers(
    first=FIRST,
    most_in_block=MOST_IN_BLOCK,
    roots=ROOT_ITERATIONS,
    turns=crossing.TURNS,
    surely=crossing.SURELY,
    located=crossing.LOCATED,
    close=crossing.CLOSE,
    dip=crossing.DIP,
    inside=crossing.INSIDE,
    least_unit=LEAST_UNIT,
    longer=LONGER,
    edge=EDGE,
    border=BORDER,
    crowded=CROWDED,
    at_zero=AT_ZERO,
    no_jump=NO_JUMP,
)

"""Motions that come to rest in ever shorter arcs: infinitely many switches before one instant.

A ball under dry friction in the potential of a kink swings in arcs each of which takes the same
part of the time of the one before; their sum ends the motion (Zeno). There it stays, if of the
forces of all branches that meet some pull one way and some the other (Filippov, Differential
Equations with Discontinuous Righthand Sides, 1988, §4). Under a damper arcs shrink by ever less,
and never end; they count no more once they are far smaller than what is asked for.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product

import casadi as ca
import numpy as np

from varint.integration.switches.accelerations import push_without_force
from varint.integration.switches.branch import Branch, branch_scene
from varint.integration.switches.course import Course, Piece
from varint.integration.switches.decision import all_parameters
from varint.numerics.arrays import call
from varint.scene.memory import per_system
from varint.scene.system import System

ARCS = 8  # that must be shorter and shorter
SHRINKS = 0.98  # each by this at least, or all of them together would
NOTHING = 1e-11  # of the duration: what is left of all arcs to come
SMALL = 0.8  # of what is asked for: arcs that shrink for ever, which the estimate counts
MOST_TOGETHER = 4  # switches, in 2⁴ branches


def rest_after(
    course: Course, pieces: Sequence[Piece], crossed: Sequence[int], size: float
) -> Piece | None:
    """The rest of a motion of one coordinate, of a `size` so far, whose arcs have become too short
    to count, at the switches that it crossed between them; None where it goes on.
    """
    system = course.system
    end = course.problem.t0 + course.problem.h
    if len(pieces) < ARCS or system.structure.n > 1 or not system.structure.autonomous:
        return None
    ends = pieces[-ARCS : 2 - ARCS], pieces[-2:]
    # arcs to both sides may differ: those two apart are of one kind
    first, last = (sum(abs(float(x.t[-1] - x.t[0])) for x in two) for two in ends)
    if not first > 0:
        return None
    ratio = (last / first) ** (1 / (ARCS - 2))
    left = last / max(1 - ratio**2, 1e-3)
    fast, slow = (max(float(np.abs(x.states[:, 2]).max()) for x in two) for two in ends)
    shrink = max(ratio, slow / fast)  # what is shorter need not be slower
    if shrink < SHRINKS:
        rests = left <= NOTHING * abs(course.problem.h)
    else:
        rests = shrink < 1 and width_of(pieces) <= SMALL * course.tol * size
    if not rests:
        return None
    together = sorted(set(crossed[-ARCS:]))
    if len(together) > MOST_TOGETHER or not _stays(course, pieces[-1], together):
        return None
    if shrink >= SHRINKS:
        course.left = max(course.left, width_of(pieces) / size)
    before = pieces[-1]
    values = np.array(before.branch.values)
    values[together] = 0.0
    branch = before.branch._replace(values=tuple(values.tolist()), sliding=tuple(together))
    q, t = before.states[-1, 0], np.array([before.t[-1], end])
    p = call(_at_rest(system), q, all_parameters(course.problem.c, branch))[1]
    states = np.stack([q, p, np.zeros_like(q)])[None].repeat(2, axis=0)
    return Piece(branch, float(t[1] - t[0]), 1, t, states, 0, 0.0)


def width_of(arcs: Sequence[Piece]) -> float:
    """How far the last arcs lead, from a switch and back to it: a quarter of their largest speed
    times their time, as a throw does.
    """
    return max(float(np.abs(x.states[:, 2]).max() * abs(x.t[-1] - x.t[0])) / 4 for x in arcs)


def _stays(course: Course, piece: Piece, together: Sequence[int]) -> bool:
    """Whether forces of the branches that meet pull both ways."""
    pushes = []
    for sides in product((-1.0, 1.0), repeat=len(together)):
        values = np.array(piece.branch.values)
        values[list(together)] = sides
        branch: Branch = piece.branch._replace(values=tuple(values.tolist()), sliding=())
        c = all_parameters(course.problem.c, branch)
        pushes.append(float(call(_at_rest(course.system), piece.states[-1, 0], c)[0][0]))
    return min(pushes) < 0 < max(pushes)


@per_system
def _at_rest(system: System) -> ca.Function:
    """(q, c) → the push on what is at rest, and its momentum."""
    scene = branch_scene(system)
    assert scene is not None
    s = scene.system
    still = [ca.substitute(x, s.v, 0 * s.v) for x in (push_without_force(s) + s.force, s.momentum)]
    outputs = [ca.densify(ca.substitute(x, s.t, 0)) for x in still]
    return ca.Function("rest", [s.q, s.c], outputs, {"cse": True})

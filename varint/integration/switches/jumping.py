"""When a motion goes over switches, and which of them let its accelerations jump."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import casadi as ca
import numpy as np

from varint.codegen.mechanics import force
from varint.integration.switches.course import Course, Piece
from varint.integration.switches.decision import all_parameters
from varint.integration.switches.frozen import frozen_scene
from varint.numerics.arrays import call
from varint.scene.memory import per_system
from varint.scene.system import System

JUMP = 1e-9  # of the forces: less is round-off of the place of a switch


def switching_times(pieces: Sequence[Piece]) -> list[float]:
    """When pieces begin whose branch, whatever contacts hold, is another one."""
    return [float(x.t[0]) for before, x in pairwise(pieces) if _switches(before, x)]


def _switches(before: Piece, piece: Piece) -> bool:
    one, other = (x.branch._replace(active_set=None) for x in (before, piece))
    return one != other


def jumping_times(course: Course, pieces: Sequence[Piece]) -> list[float]:
    """Those of them at which what switches lets accelerations jump: not where forces are as large
    on both sides, nor where an impact turned the velocities that they are signs of.
    """
    found = []
    for before, x in pairwise(pieces):
        if not _switches(before, x):
            continue
        held = before.branch.sliding or x.branch.sliding
        if not held and (x.events or not _jumps(course, before, x)):
            continue
        found.append(float(x.t[0]))
    return found


def _jumps(course: Course, before: Piece, piece: Piece) -> bool:
    """Whether the forces of two branches differ where the one goes over to the other."""
    q, _, v = before.states[-1]
    at = q.copy(), v.copy(), before.t[-1:].copy()
    one, other = (
        call(_force_function(course.system), *at, all_parameters(course.problem.c, x.branch))[0]
        for x in (before, piece)
    )
    usual = np.abs([one, other]).max(initial=0.0)
    return bool(np.abs(one - other).max(initial=0.0) > JUMP * usual)


@per_system
def _force_function(system: System) -> ca.Function:
    """(q, v, t, c) → ∂L/∂q + F of a branch."""
    frozen = frozen_scene(system)
    assert frozen is not None
    s = frozen.system
    return ca.Function("force", [s.q, s.v, s.t, s.c], [ca.densify(force(s))], {"cse": True})


def unwritten(course: Course, piece: Piece) -> bool:
    """Whether the scene as it is written is another one than that of a piece, at nodes of its
    steps: switches hold the motion, or a node lies on a switch, where sign(0) is neither side.
    """
    if piece.branch.sliding:
        return True
    if course.rule.nodes[0] > 0:
        return False
    for i in (0, -1):
        q, _, v = piece.states[i]
        at, u = (q.copy(), v.copy()), np.array(piece.branch.controls)
        t = np.array([piece.t[i]])
        here = call(
            _force_function(course.system), *at, t, all_parameters(course.problem.c, piece.branch)
        )[0]
        written = call(_written_function(course.system), *at, u, t, course.problem.c)[0]
        if not np.abs(here - written).max() <= JUMP * np.abs([here, written]).max():
            return True
    return False


@per_system
def _written_function(system: System) -> ca.Function:
    """(q, v, u, t, c) → ∂L/∂q + F as it is written."""
    s = system
    inputs = [s.q, s.v, s.control, s.t, s.c]
    return ca.Function("written", inputs, [ca.densify(force(s))], {"cse": True})

"""When a motion goes over switches, and which of them let its accelerations jump."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import chain, pairwise

import casadi as ca
import numpy as np

from varint.codegen.mechanics import force
from varint.integration.switches.branch import Branch
from varint.integration.switches.course import Course, Piece
from varint.integration.switches.decision import all_parameters
from varint.integration.switches.frozen import frozen_scene
from varint.numerics.arrays import call, over_columns
from varint.scene.memory import per_system
from varint.scene.system import System

JUMP = 1e-9  # of the forces: less is round-off of the place of a switch


def switching_times(pieces: Sequence[Piece]) -> list[float]:
    """When pieces begin whose branch, whatever contacts hold, is another one."""
    return [float(x.t[0]) for before, x in pairwise(pieces) if _switches(before, x)]


def _switches(before: Piece, piece: Piece) -> bool:
    one, other = before.branch, piece.branch
    if one.active_set is None:
        return one != other
    return one._replace(active_set=None) != other._replace(active_set=None)


def jumping_times(course: Course, pieces: Sequence[Piece]) -> list[float]:
    """Those of them at which what switches lets accelerations jump: not where forces are as large
    on both sides, nor where an impact turned the velocities that they are signs of.
    """
    both = [x for x in pairwise(pieces) if _switches(*x)]
    jumps = np.array([bool(a.branch.sliding or b.branch.sliding) for a, b in both], dtype=bool)
    free = [i for i, (_, x) in enumerate(both) if not (jumps[i] or x.events)]
    jumps[free] = _jumps(course, [both[i] for i in free])
    return [float(x.t[0]) for (_, x), jump in zip(both, jumps, strict=True) if jump]


def _jumps(course: Course, both: Sequence[tuple[Piece, Piece]]) -> np.ndarray:
    """Whether the forces of two branches differ where the one goes over to the other, each."""
    if not both:
        return np.empty(0, dtype=bool)
    states = np.array([x.states[-1] for x, _ in both])
    at = states[:, 0], states[:, 2], np.array([x.t[-1:] for x, _ in both])
    known: dict[Branch, np.ndarray] = {}
    for x in chain.from_iterable(both):
        if x.branch not in known:
            known[x.branch] = all_parameters(course.problem.c, x.branch)
    function = _force_function(course.system)
    one, other = (
        over_columns(function, *at, np.array([known[x[i].branch] for x in both]))[0] for i in (0, 1)
    )
    usual = np.abs([one, other]).max(axis=(0, 2), initial=0.0)
    return np.asarray(np.abs(one - other).max(axis=1, initial=0.0) > JUMP * usual)


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

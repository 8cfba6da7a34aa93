"""What holds a machine together besides its tree: rows g(q) = 0 of loops."""

from __future__ import annotations

import casadi as ca

from varint.errors import InputError
from varint.multibody.data import Loop, Machine, Placement
from varint.multibody.frames import fixed_frames
from varint.multibody.kinematics import Motions
from varint.multibody.tree import Tree

OPEN = 1e-9  # of a row that is the same for all coordinates: so far from zero it never closes


def constraint_rows(machine: Machine, tree: Tree, motions: Motions) -> ca.SX:
    """The rows of the loops in the order in which they were made.

    Raises
    ------
    InputError
        If a loop is open whatever the coordinates are.
    """
    rows: list[ca.SX] = []
    loops = list(machine.loops.values())
    frames = fixed_frames(tree, motions, [end for loop in loops for end in (loop.a, loop.b)])
    for loop, (a, _), (b, _) in zip(loops, frames[::2], frames[1::2], strict=True):
        rows += [row for row in loop_rows(loop, a, b) if _holds(loop, row, machine)]
    return ca.vertcat(ca.SX(0, 1), *rows)


def loop_rows(loop: Loop, a: Placement, b: Placement) -> list[ca.SX]:
    """g(q) of a loop between the frames a and b."""
    gap = ca.SX(b.position) - ca.SX(a.position)
    x, y, z = ca.horzsplit(ca.SX(a.rotation))
    if loop.kind == "distance":
        return [ca.sumsqr(gap) - loop.length**2]
    if loop.kind == "line":
        return [ca.dot(x, gap), ca.dot(y, gap)]
    if loop.kind == "plane":
        return [ca.dot(z, gap)]
    rows = ca.vertsplit(gap)
    across = ca.SX(b.rotation)
    if loop.kind == "axis":
        rows += [ca.dot(x, across[:, 2]), ca.dot(y, across[:, 2])]
    if loop.kind == "weld":
        # twice the sine of the angle between them, along its axis
        rows += [
            ca.dot(y, across[:, 2]) - ca.dot(z, across[:, 1]),
            ca.dot(z, across[:, 0]) - ca.dot(x, across[:, 2]),
            ca.dot(x, across[:, 1]) - ca.dot(y, across[:, 0]),
        ]
    return rows


def _holds(loop: Loop, row: ca.SX, machine: Machine) -> bool:
    """Whether a row restricts the coordinates."""
    if ca.depends_on(row, machine.q):
        return True
    if row.is_constant() and abs(float(row)) > OPEN:
        raise InputError(
            f"loop {loop.name!r} ({loop.kind} between {loop.a.body!r} and {loop.b.body!r}) is open "
            f"by {float(row):.3g} whatever the coordinates are; check where its frames stand"
        )
    return False

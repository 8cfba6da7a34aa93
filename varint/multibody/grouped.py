"""Inertias reduced to what each joint can feel: what moves as the parent does is the parent's.

A needle along the axis about which a link turns, its mass, its first moment along the axis and
one moment of inertia, moves as the parent does however the link turns; a link that slides turns as
its parent does; a point where a link turns in every direction stays with the parent. T and the
weight's potential are the same functions of q and v (but for a constant), with fewer numbers: a
link that turns about an axis keeps no mass and seven numbers of ten.

M. Gautier & W. Khalil, Direct calculation of minimum set of inertial parameters of serial robots,
IEEE Trans. Robotics and Automation 6 (1990) 368.
"""

from __future__ import annotations

import casadi as ca

from varint.multibody.data import Placement
from varint.multibody.tree import GROUND, Inertial, Link, Tree, steiner


def grouped(tree: Tree) -> list[Inertial]:
    """The links' inertias with all handed on to the parents that moves as these do."""
    kept = list(tree.inertials)
    for i in reversed(range(len(tree.links))):
        link = tree.links[i]
        needle = _with_parent(link, kept[i])
        kept[i] = Inertial(*(a - b for a, b in zip(kept[i], needle, strict=True)))
        if link.parent != GROUND:
            there = _placed(needle, link.place)
            pairs = zip(kept[link.parent], there, strict=True)
            kept[link.parent] = Inertial(*(a + b for a, b in pairs))
    return kept


def _with_parent(link: Link, own: Inertial) -> Inertial:
    """The part of a link's inertia that moves as its parent does."""
    nothing = Inertial(ca.SX(0), ca.SX.zeros(3), ca.SX.zeros(3, 3))
    if link.motion == "revolute":
        across = ca.diag(ca.vertcat(1, 1, 0)) * own.inertia[1, 1]
        return Inertial(own.mass, ca.vertcat(0, 0, own.moment[2]), across)
    if link.motion == "spherical":
        return nothing._replace(mass=own.mass)
    return nothing._replace(inertia=own.inertia)


def _placed(own: Inertial, place: Placement) -> Inertial:
    """An inertia about and along a frame, about and along the one that the frame is placed in."""
    r, turn = place
    moment = ca.mtimes(turn, own.moment)
    pair = ca.mtimes(r, moment.T)
    turned = ca.mtimes(ca.mtimes(turn, own.inertia), turn.T)
    moved = 2 * ca.dot(r, moment) * ca.SX.eye(3) - pair - pair.T + own.mass * steiner(r)
    return Inertial(own.mass, moment + own.mass * r, turned + moved)

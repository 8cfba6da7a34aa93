"""Joints that move nothing: what has no inertia cannot be told how it accelerates."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import casadi as ca
import numpy as np

from varint.errors import InputError
from varint.multibody.data import Body, Joint, Machine
from varint.multibody.joints import QUATERNION_AT
from varint.multibody.tree import Tree

NEEDLE = 1e-13  # smallest principal moment of what has none about an axis, relative to the largest


def refuse_weightless(machine: Machine, tree: Tree, matrix: ca.SX) -> None:
    """Does every joint move something that has inertia, whatever the pose? Bodies without mass
    between others are welcome, and so are those that a loop holds.

    Parameters
    ----------
    matrix : SX (n, n)
        The mass matrix.

    Raises
    ------
    InputError
        Naming the joint and the bodies that it carries.
    """
    held = {anchor.body for loop in machine.loops.values() for anchor in (loop.a, loop.b)}
    for joint, still in zip(machine.moving, _without(machine, matrix), strict=True):
        names = carried_by(joint, machine.joints)
        if held & set(names):
            continue
        what = names if len(names) > 1 else repr(names[0])
        weightless = all(_has_none(machine.bodies[name]) for name in names)
        if still or (weightless and joint.kind in QUATERNION_AT):
            massless = all(ca.SX(machine.bodies[name].mass).is_zero() for name in names)
            lacking = "mass" if massless else "inertia about its axis"
            raise InputError(
                f"joint {joint.name!r} moves {what} without "
                f"{'mass and inertia' if weightless else lacking}, so that nothing tells how it "
                "accelerates: give the body its mass and inertia (in a file its <inertial>), make "
                "the joint a fixed one, or give it the inertia of a rotor, "
                "passive=Passive(armature=…)"
            )
        if joint.kind in QUATERNION_AT and _is_needle(tree, joint):
            raise InputError(
                f"joint {joint.name!r} turns {what} about every axis, and about one of them it has "
                "no inertia, as a needle has none about its own: give it a small moment there, or "
                "hang it on two hinges, model.universal(…)"
            )


def carried_by(joint: Joint, joints: Mapping[str, Joint]) -> list[str]:
    """The bodies behind a joint, its own first."""
    names = [joint.child]
    for name in names:
        names.extend(other.child for other in joints.values() if other.parent == name)
    return names


def _without(machine: Machine, matrix: ca.SX) -> Iterator[bool]:
    """Whether the mass matrix has an empty diagonal entry for a joint."""
    first = 0
    for joint in machine.moving:
        size = joint.v.numel()
        yield any(matrix[i, i].is_zero() for i in range(first, first + size))
        first += size


def _has_none(body: Body) -> bool:
    return ca.SX(body.mass).is_zero() and ca.SX(body.inertia).is_zero()


def _is_needle(tree: Tree, joint: Joint) -> bool:
    """Whether what a ball or free joint turns is one link whose moments are numbers, one of them
    zero; of a free body about its centre of mass.
    """
    at = next(
        i for i, x in enumerate(tree.links) if x.joint == joint.name and x.motion == "spherical"
    )
    inertial = tree.inertials[at]
    if any(link.parent == at for link in tree.links) or any(map(ca.symvar, inertial)):
        return False
    mass, moment, inertia = (np.array(ca.evalf(x)) for x in inertial)
    if joint.kind == "free":
        inertia = inertia - (moment.T @ moment * np.eye(3) - moment @ moment.T) / mass
    moments = np.linalg.eigvalsh(inertia)
    return bool(moments[0] <= NEEDLE * moments[-1])

"""The tree of joints as links with one elementary motion each, their frames along the axes.

A link's frame is chosen with its third axis along its joint's, so that turning costs four
multiplications a vector; what is fixed together is one link with one inertia. All of this is
arithmetic of constants: nothing of it is left in the equations of motion.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from varint.errors import InputError
from varint.multibody.data import WORLD, Body, Joint, Placement
from varint.multibody.quantities import compose, inverse, plus, product
from varint.multibody.rotations import frame_along

GROUND = -1  # the number of the link that does not move
NOWHERE = Placement(np.zeros(3), np.eye(3))


class Link(NamedTuple):
    """A link and the elementary motion that leads to it.

    Attributes
    ----------
    joint : str
    motion : str
        "revolute" or "prismatic" (about, along the third axis), "translation" (three
        coordinates), "spherical" (unit quaternion).
    parent : int
        Its place among the links; −1 the ground.
    place : Placement
        Of the joint's frame in the parent link's.
    first, size : int
        Which of the joint's coordinates move it.
    """

    joint: str
    motion: str
    parent: int
    place: Placement
    first: int
    size: int


class Inertial(NamedTuple):
    """Mass, first moment m c and inertia about the origin, in a link's axes."""

    mass: Any
    moment: Any
    inertia: Any


class Tree(NamedTuple):
    """Links with parents before children, what they weigh, and where each body is.

    Attributes
    ----------
    links : tuple of Link
    inertials : tuple of Inertial
    bodies : dict
        Name → (number of its link, `Placement` in the link).
    """

    links: tuple[Link, ...]
    inertials: tuple[Inertial, ...]
    bodies: Mapping[str, tuple[int, Placement]]


def tree_of(bodies: Mapping[str, Body], joints: Iterable[Joint]) -> Tree:
    """The tree that the joints make of the bodies.

    Raises
    ------
    InputError
        If bodies hang on nothing that leads to the ground.
    """
    waiting = list(joints)
    links: list[Link] = []
    places: dict[str, tuple[int, Placement]] = {WORLD: (GROUND, NOWHERE)}
    while waiting:
        ready = [joint for joint in waiting if joint.parent in places]
        if not ready:
            break
        for joint in ready:
            link, place = places[joint.parent]
            place = compose(place, joint.placement)
            for motion, axes, first, count in elementary_motions(joint):
                links.append(Link(joint.name, motion, link, _along(place, axes), first, count))
                link, place = len(links) - 1, Placement(np.zeros(3), axes.T)
            places[joint.child] = link, compose(place, inverse(joint.child_placement))
        waiting = [joint for joint in waiting if joint.child not in places]
    if loose := [name for name in bodies if name not in places]:
        raise InputError(
            f"bodies {loose} hang on nothing: give each one joint that leads to the ground, "
            "model.free(model, body) where it floats"
        )
    inertials = [Inertial(0.0, np.zeros(3), np.zeros((3, 3)))] * len(links)
    for name, body in bodies.items():
        link, place = places[name]
        if link != GROUND:
            inertials[link] = Inertial(*map(plus, inertials[link], _inertial(body, place)))
    return Tree(
        tuple(link._replace(place=Placement(*map(ca.SX, link.place))) for link in links),
        tuple(Inertial(*map(ca.SX, inertial)) for inertial in inertials),
        places,
    )


def elementary_motions(joint: Joint) -> list[tuple[str, np.ndarray, int, int]]:
    """(motion, axes whose third it goes along, first coordinate, number of coordinates) one after
    the other.
    """
    if joint.kind in ("revolute", "prismatic"):
        return [(joint.kind, frame_along(joint.axes[0]), 0, 1)]
    if joint.kind == "universal":
        return [("revolute", frame_along(axis), i, 1) for i, axis in enumerate(joint.axes)]
    if joint.kind == "planar":
        normal, x = joint.axes
        y = np.cross(normal, x)
        ways = (("prismatic", x), ("prismatic", y), ("revolute", normal))
        return [(motion, frame_along(axis), i, 1) for i, (motion, axis) in enumerate(ways)]
    if joint.kind == "spherical":
        return [("spherical", np.eye(3), 0, 4)]
    if joint.kind == "free":
        return [("translation", np.eye(3), 0, 3), ("spherical", np.eye(3), 3, 4)]
    return []


def _along(place: Placement, axes: np.ndarray) -> Placement:
    return Placement(place.position, product(place.rotation, axes))


def _inertial(body: Body, place: Placement) -> Inertial:
    """A body's inertia about its link's origin, in the link's axes (Steiner)."""
    com = plus(place.position, product(place.rotation, body.com))
    inertia = product(product(place.rotation, body.inertia), place.rotation.T)
    moment = body.mass * com
    return Inertial(body.mass, moment, plus(inertia, body.mass * steiner(com)))


def steiner(x: Any) -> Any:
    """|x|² 1 − x xᵀ."""
    if isinstance(x, ca.SX):
        return ca.sumsqr(x) * ca.SX.eye(3) - ca.mtimes(x, x.T)
    return x @ x * np.eye(3) - np.outer(x, x)

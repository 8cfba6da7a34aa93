"""L of a machine by recursion over its tree: a fixed number of operations for each link."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import casadi as ca

from varint.multibody.data import Joint
from varint.multibody.elementary import for_each_link
from varint.multibody.kinematics import Motions, Twist, coordinates_of, shift, turned_back, twists
from varint.multibody.tree import GROUND, Inertial, Link, Tree


def kinetic_energy(tree: Tree, motions: Motions) -> ca.SX:
    """Σ ½ m |v|² + v·(ω × m c) + ½ ω·I ω, in each link's own axes about its origin."""
    total = ca.SX(0)
    for link, twist, inertial in zip(
        tree.links, twists(tree.links, motions), tree.inertials, strict=True
    ):
        total += _link_energy(link, coordinates_of(link, motions)[0], twist, inertial)
    return total


@for_each_link(Twist, Inertial, gives=ca.SX)
def _link_energy(link: Link, q: ca.SX, twist: Twist, inertial: Inertial) -> ca.SX:
    (omega, v), (mass, moment, inertia) = twist, inertial
    swept = ca.cross(omega, moment)
    return ca.dot(v, mass * v / 2 + swept) + ca.dot(omega, ca.mtimes(inertia, omega)) / 2


def gravity_potential(tree: Tree, motions: Motions, gravity: Any) -> ca.SX:
    """−Σ m g·x of the centres of mass; g is carried along into each link's axes, g·x with it."""
    total, downs, depths = ca.SX(0), list[ca.SX](), list[ca.SX]()
    for link, inertial in zip(tree.links, tree.inertials, strict=True):
        q, _ = coordinates_of(link, motions)
        grounded = link.parent == GROUND
        outer = ca.SX(gravity) if grounded else downs[link.parent]
        depth = ca.SX(0) if grounded else depths[link.parent]
        down = turned_back(link, q, outer)
        depth += ca.dot(outer, link.place.position) + ca.dot(down, shift(link, q))
        total -= inertial.mass * depth + ca.dot(down, inertial.moment)
        downs.append(down)
        depths.append(depth)
    return total


def joint_energies(joints: Mapping[str, Joint], motions: Motions) -> ca.SX:
    """Rotors' kinetic energy ½ a q̇² less the springs' ½ k (q − rest)²."""
    total = ca.SX(0)
    for joint in joints.values():
        q, v = motions[joint.name]
        passive = joint.passive
        total += ca.sumsqr(v) * passive.armature / 2
        total -= ca.sumsqr(q - passive.rest) * passive.stiffness / 2
    return total

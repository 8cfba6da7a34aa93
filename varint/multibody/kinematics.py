"""Where links are and how fast, by recursion from the ground to the tips.

Velocities in each link's own axes cost a fixed number of operations a link; places in space are
for frames, loops and springs alone.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import casadi as ca

from varint.multibody.data import Placement
from varint.multibody.elementary import for_each_link
from varint.multibody.quantities import compose
from varint.multibody.rotations import ray_matrix
from varint.multibody.tree import GROUND, Link

# expressions of a joint's coordinates and of their rates
Motions = Mapping[str, tuple[ca.SX, ca.SX]]


class Twist(NamedTuple):
    """Angular velocity and velocity of the origin of a frame, along its own axes, (3,) each."""

    omega: ca.SX
    v: ca.SX


STILL = Twist(ca.SX.zeros(3), ca.SX.zeros(3))


def coordinates_of(link: Link, motions: Motions) -> tuple[ca.SX, ca.SX]:
    """The coordinates that move a link, and their rates."""
    q, v = motions[link.joint]
    part = slice(link.first, link.first + link.size)
    return q[part], v[part]


@for_each_link(ca.SX, gives=ca.SX)
def turned_back(link: Link, q: ca.SX, x: ca.SX) -> ca.SX:
    """A vector of the parent link in the link's own axes."""
    x = ca.mtimes(link.place.rotation.T, x)
    if link.motion == "revolute":
        c, s = ca.cos(q), ca.sin(q)
        return ca.vertcat(c * x[0] + s * x[1], c * x[1] - s * x[0], x[2])
    if link.motion == "spherical":
        return ca.mtimes(ray_matrix(q).T, x)
    return x


@for_each_link(ca.SX, gives=ca.SX)
def turned(link: Link, q: ca.SX, x: ca.SX) -> ca.SX:
    """A vector of the link in its parent's axes."""
    if link.motion == "revolute":
        c, s = ca.cos(q), ca.sin(q)
        x = ca.vertcat(c * x[0] - s * x[1], s * x[0] + c * x[1], x[2])
    elif link.motion == "spherical":
        x = ca.mtimes(ray_matrix(q), x)
    return ca.mtimes(link.place.rotation, x)


def shift(link: Link, q: ca.SX) -> ca.SX:
    """From where the link's origin is at q = 0 to where it is, in its own axes."""
    if link.motion == "prismatic":
        return ca.vertcat(0, 0, q)
    if link.motion == "translation":
        return q
    return ca.SX.zeros(3)


def relative_twist(link: Link, q: ca.SX, v: ca.SX) -> Twist:
    """Of a link in its parent, along the link's axes."""
    none = ca.SX.zeros(3)
    if link.motion == "revolute":
        return Twist(ca.vertcat(0, 0, v), none)
    if link.motion == "prismatic":
        return Twist(none, ca.vertcat(0, 0, v))
    if link.motion == "translation":
        return Twist(none, v)
    return Twist(body_rates(q, v), none)


def body_rates(q: ca.SX, v: ca.SX) -> ca.SX:
    """Angular velocity ω = 2 Im(q̄ q̇)/|q|² (3,) along the body's axes of a quaternion of any
    length.
    """
    (w, x, y, z), (a, b, c, d) = ca.vertsplit(q), ca.vertsplit(v)
    return (2 / ca.sumsqr(q)) * ca.vertcat(
        w * b - x * a - y * d + z * c,
        w * c - y * a - z * b + x * d,
        w * d - z * a - x * c + y * b,
    )


@for_each_link(Twist, Twist, gives=Twist)
def moved(link: Link, q: ca.SX, outer: Twist, own: Twist) -> Twist:
    """The twist of a link whose parent has the twist `outer`, its own in the parent being `own`."""
    omega = turned_back(link, q, outer.omega)
    v = turned_back(link, q, outer.v + ca.cross(outer.omega, link.place.position))
    return Twist(omega + own.omega, v + ca.cross(omega, shift(link, q)) + own.v)


def twists(links: Sequence[Link], motions: Motions) -> list[Twist]:
    """Of every link, along its own axes."""
    found: list[Twist] = []
    for link in links:
        q, v = coordinates_of(link, motions)
        outer = STILL if link.parent == GROUND else found[link.parent]
        found.append(moved(link, q, outer, relative_twist(link, q, v)))
    return found


def places(links: Sequence[Link], motions: Motions) -> list[Placement]:
    """Of every link in space."""
    found: list[Placement] = []
    for link in links:
        q, _ = coordinates_of(link, motions)
        start = link.place if link.parent == GROUND else compose(found[link.parent], link.place)
        rotation = ca.SX(start.rotation)
        if link.motion == "revolute":
            c, s = ca.cos(q), ca.sin(q)
            x, y, z = ca.horzsplit(rotation)
            rotation = ca.horzcat(c * x + s * y, c * y - s * x, z)
        elif link.motion == "spherical":
            rotation = ca.mtimes(rotation, ray_matrix(q))
        position = ca.SX(start.position) + ca.mtimes(rotation, shift(link, q))
        found.append(Placement(position, rotation))
    return found

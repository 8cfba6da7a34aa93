"""Inertias of links and subtrees in the axes of links, and what carries them to the parent."""

from __future__ import annotations

from typing import NamedTuple

import casadi as ca

from varint.multibody.elementary import for_each_link
from varint.multibody.kinematics import shift, turned
from varint.multibody.rotations import ray_matrix
from varint.multibody.tree import Inertial, Link


class Inertia(NamedTuple):
    """½ ω·J ω + ω·H v + ½ v·M v of a link or a subtree, about its origin, (3, 3) each."""

    J: ca.SX
    H: ca.SX
    M: ca.SX


class Momentum(NamedTuple):
    """Angular momentum about an origin, and momentum, (3,) each; or a torque and a force."""

    spin: ca.SX
    push: ca.SX


NO_MOMENTUM = Momentum(ca.SX.zeros(3), ca.SX.zeros(3))


def rigid(inertial: Inertial) -> Inertia:
    """Of a rigid body: ω·H v = v·(ω × m c)."""
    mass, moment, inertia = inertial
    return Inertia(inertia, ca.skew(moment), mass * ca.SX.eye(3))


def times(own: Inertia, omega: ca.SX, v: ca.SX) -> Momentum:
    """The momentum that an inertia has at a twist."""
    return Momentum(
        ca.mtimes(own.J, omega) + ca.mtimes(own.H, v),
        ca.mtimes(own.H.T, omega) + ca.mtimes(own.M, v),
    )


def together(a: Inertia, b: Inertia) -> Inertia:
    """The sum of two inertias about one origin."""
    return Inertia(a.J + b.J, a.H + b.H, a.M + b.M)


@for_each_link(Inertia, gives=Inertia)
def outward(link: Link, q: ca.SX, own: Inertia) -> Inertia:
    """An inertia about a link's own origin and axes, about and along its parent's."""
    if link.motion in ("prismatic", "translation"):
        own = _shifted(own, shift(link, q))
    turn = link.place.rotation
    if link.motion == "revolute":
        c, s = ca.cos(q), ca.sin(q)
        own = Inertia(_spun(own.J, c, s, True), _spun(own.H, c, s, False), _spun(own.M, c, s, True))
    elif link.motion == "spherical":
        turn = ca.mtimes(turn, ray_matrix(q))
    own = Inertia(
        _congruent(turn, own.J), ca.mtimes(ca.mtimes(turn, own.H), turn.T), _congruent(turn, own.M)
    )
    return _shifted(own, link.place.position)


@for_each_link(Momentum, gives=Momentum)
def carried(link: Link, q: ca.SX, own: Momentum) -> Momentum:
    """The same of a momentum or a force."""
    spin, push = own
    if link.motion in ("prismatic", "translation"):
        spin = spin + ca.cross(shift(link, q), push)
    spin, push = turned(link, q, spin), turned(link, q, push)
    return Momentum(spin + ca.cross(link.place.position, push), push)


def mirrored(rows: list[list[ca.SX]]) -> ca.SX:
    """A symmetric matrix from its upper triangle."""
    return ca.blockcat([[rows[min(i, j)][abs(i - j)] for j in range(3)] for i in range(3)])


def _shifted(own: Inertia, r: ca.SX) -> Inertia:
    """About an origin from which the old one is at r."""
    across = ca.skew(r)
    coupling = own.H + ca.mtimes(across, own.M)
    turning, lifted = ca.mtimes(across, own.H.T), ca.mtimes(coupling, across)
    rows = [[own.J[i, j] + turning[i, j] - lifted[i, j] for j in range(i, 3)] for i in range(3)]
    return Inertia(mirrored(rows), coupling, own.M)


def _spun(a: ca.SX, c: ca.SX, s: ca.SX, symmetric: bool) -> ca.SX:
    """R A Rᵀ for the rotation R about the third axis, cos = c, sin = s.

    The upper block [a b; d e] becomes [a − s w, c w − d; c w − b, e + s w] with
    w = s (a − e) + c (b + d).
    """
    b, d = a[0, 1], a[0, 1] if symmetric else a[1, 0]
    w = s * (a[0, 0] - a[1, 1]) + (2 * c * b if symmetric else c * (b + d))
    right = [c * a[0, 2] - s * a[1, 2], s * a[0, 2] + c * a[1, 2]]
    below = right if symmetric else [c * a[2, 0] - s * a[2, 1], s * a[2, 0] + c * a[2, 1]]
    across = c * w - d
    return ca.blockcat(
        [
            [a[0, 0] - s * w, across, right[0]],
            [across if symmetric else c * w - b, a[1, 1] + s * w, right[1]],
            [below[0], below[1], a[2, 2]],
        ]
    )


def _congruent(turn: ca.SX, a: ca.SX) -> ca.SX:
    """E A Eᵀ of a symmetric A."""
    half = ca.mtimes(turn, a)
    return mirrored([[ca.dot(half[i, :].T, turn[j, :].T) for j in range(i, 3)] for i in range(3)])

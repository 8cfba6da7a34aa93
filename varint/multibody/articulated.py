"""v from p = M(q) v by articulated bodies: a number of operations linear in the links.

From the tips to the ground every link hands its parent the inertia that the parent feels, its own
joint free to give way; from the ground to the tips the velocities follow. M itself is never formed.

R. Featherstone, Rigid Body Dynamics Algorithms, Springer 2008, §7.2, with momenta in place of
forces: what is there f = I a + b is here the momentum I v + b of a subtree.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import casadi as ca

from varint.multibody.kinematics import Motions, Twist, coordinates_of, moved, shift
from varint.multibody.tree import GROUND, Inertial, Link, Tree

HINGES = ("revolute", "prismatic")  # motions that one number describes


class Inertia(NamedTuple):
    """½ ω·J ω + ω·H v + ½ v·M v of a link or a subtree, about its origin, (3, 3) each."""

    J: ca.SX
    H: ca.SX
    M: ca.SX


class Momentum(NamedTuple):
    """Angular momentum about the origin, and momentum, (3,) each."""

    spin: ca.SX
    push: ca.SX


class _Given(NamedTuple):
    """What a link's joint gives way by: the column U of inertia, its pivot D, and p − S·b."""

    spin: ca.SX
    push: ca.SX
    pivot: ca.SX
    free: ca.SX


def has_only_hinges(tree: Tree) -> bool:
    """Whether every link moves by one number of its own."""
    return all(link.motion in HINGES for link in tree.links)


def velocity_of_momentum(
    tree: Tree, motions: Motions, momenta: dict[str, ca.SX], armatures: dict[str, Any]
) -> dict[str, ca.SX]:
    """Rates of every joint's coordinates with p = M(q) v.

    Parameters
    ----------
    tree : Tree
        With links of one coordinate alone.
    motions : dict
        Coordinates of the joints by name; their rates are not looked at.
    momenta : dict
        p of the joints by name.
    armatures : dict
        Inertia of the joints' rotors by name.
    """
    links = tree.links
    inertias = [_rigid(inertial) for inertial in tree.inertials]
    biases = [Momentum(ca.SX.zeros(3), ca.SX.zeros(3))] * len(links)
    given: list[_Given] = []
    for i in reversed(range(len(links))):
        link, own, bias = links[i], inertias[i], biases[i]
        q, _ = coordinates_of(link, motions)
        spins = link.motion == "revolute"
        spin, push = (own.J[:, 2], own.H[2, :].T) if spins else (own.H[:, 2], own.M[:, 2])
        pivot = (spin if spins else push)[2] + armatures[link.joint]
        free = momenta[link.joint][link.first] - (bias.spin if spins else bias.push)[2]
        given.append(_Given(spin, push, pivot, free))
        if link.parent != GROUND:
            inertia, rest = _without(given[-1], own, bias)
            inertias[link.parent] = _sum(inertias[link.parent], _outward(link, q, inertia))
            carried = _carried(link, q, rest)
            biases[link.parent] = Momentum(
                *map(sum, zip(biases[link.parent], carried, strict=True))
            )
    return _rates(links, motions, given[::-1])


def _rates(links: tuple[Link, ...], motions: Motions, given: list[_Given]) -> dict[str, ca.SX]:
    still = Twist(ca.SX.zeros(3), ca.SX.zeros(3))
    found: list[Twist] = []
    rates: dict[str, list[ca.SX]] = {}
    for link, (spin, push, pivot, free) in zip(links, given, strict=True):
        q, _ = coordinates_of(link, motions)
        if link.parent == GROUND:
            twist, rate = still, free / pivot
        else:
            twist = moved(link, q, found[link.parent], still)
            rate = (free - ca.dot(spin, twist.omega) - ca.dot(push, twist.v)) / pivot
        along = ca.vertcat(0, 0, rate)
        found.append(
            Twist(twist.omega + along, twist.v)
            if link.motion == "revolute"
            else Twist(twist.omega, twist.v + along)
        )
        rates.setdefault(link.joint, []).append(rate)
    return {joint: ca.vertcat(*parts) for joint, parts in rates.items()}


def _rigid(inertial: Inertial) -> Inertia:
    mass, moment, inertia = inertial
    return Inertia(ca.SX(inertia), ca.skew(ca.SX(moment)), mass * ca.SX.eye(3))


def _without(given: _Given, own: Inertia, bias: Momentum) -> tuple[Inertia, Momentum]:
    """What is left when the joint gives way: I − U Uᵀ/D, b + U (p − S·b)/D."""
    spin, push, pivot, free = given
    less_spin, less_push, rate = spin / pivot, push / pivot, free / pivot
    inertia = Inertia(
        _symmetric(own.J, less_spin, spin),
        own.H - ca.mtimes(less_spin, push.T),
        _symmetric(own.M, less_push, push),
    )
    return inertia, Momentum(bias.spin + spin * rate, bias.push + push * rate)


def _symmetric(a: ca.SX, x: ca.SX, y: ca.SX) -> ca.SX:
    """A − x yᵀ, known to be symmetric."""
    return _mirrored([[a[i, j] - x[i] * y[j] for j in range(i, 3)] for i in range(3)])


def _mirrored(rows: list[list[ca.SX]]) -> ca.SX:
    """A symmetric matrix from its upper triangle."""
    return ca.blockcat([[rows[min(i, j)][abs(i - j)] for j in range(3)] for i in range(3)])


def _sum(a: Inertia, b: Inertia) -> Inertia:
    both = [
        _mirrored([[x[i, j] + y[i, j] for j in range(i, 3)] for i in range(3)])
        for x, y in ((a.J, b.J), (a.M, b.M))
    ]
    return Inertia(both[0], a.H + b.H, both[1])


def _outward(link: Link, q: ca.SX, own: Inertia) -> Inertia:
    """An inertia about a link's own origin and axes, about and along its parent's."""
    if link.motion == "prismatic":
        own = _shifted(own, shift(link, q))
    if link.motion == "revolute":
        c, s = ca.cos(q), ca.sin(q)
        own = Inertia(_spun(own.J, c, s, True), _spun(own.H, c, s, False), _spun(own.M, c, s, True))
    turn = ca.SX(link.place.rotation)
    own = Inertia(
        _congruent(turn, own.J), ca.mtimes(ca.mtimes(turn, own.H), turn.T), _congruent(turn, own.M)
    )
    return _shifted(own, ca.SX(link.place.position))


def _carried(link: Link, q: ca.SX, own: Momentum) -> Momentum:
    """The same of a momentum."""
    spin, push = own
    if link.motion == "prismatic":
        spin = spin + ca.cross(shift(link, q), push)
    turned = []
    for x in (spin, push):
        if link.motion == "revolute":
            c, s = ca.cos(q), ca.sin(q)
            x = ca.vertcat(c * x[0] - s * x[1], s * x[0] + c * x[1], x[2])
        turned.append(ca.mtimes(ca.SX(link.place.rotation), x))
    spin, push = turned
    return Momentum(spin + ca.cross(ca.SX(link.place.position), push), push)


def _shifted(own: Inertia, r: ca.SX) -> Inertia:
    """About an origin from which the old one is at r."""
    across = ca.skew(r)
    coupling = own.H + ca.mtimes(across, own.M)
    turning, lifted = ca.mtimes(across, own.H.T), ca.mtimes(coupling, across)
    return Inertia(
        _mirrored(
            [[own.J[i, j] + turning[i, j] - lifted[i, j] for j in range(i, 3)] for i in range(3)]
        ),
        coupling,
        own.M,
    )


def _spun(a: ca.SX, c: ca.SX, s: ca.SX, symmetric: bool) -> ca.SX:
    """R A Rᵀ for the rotation R about the third axis, cos = c, sin = s.

    The part of the upper block that turns does so by twice the angle; its trace and its skew part
    stay.
    """
    half = (a[0, 0] - a[1, 1]) / 2
    mean = a[0, 0] - half
    tilt = a[0, 1] if symmetric else (a[0, 1] + a[1, 0]) / 2
    skew = 0 if symmetric else a[0, 1] - tilt
    c2, s2 = 1 - 2 * s * s, 2 * s * c
    half, tilt = c2 * half - s2 * tilt, s2 * half + c2 * tilt
    right = [c * a[0, 2] - s * a[1, 2], s * a[0, 2] + c * a[1, 2]]
    below = right if symmetric else [c * a[2, 0] - s * a[2, 1], s * a[2, 0] + c * a[2, 1]]
    return ca.blockcat(
        [
            [mean + half, tilt + skew, right[0]],
            [tilt - skew, mean - half, right[1]],
            [below[0], below[1], a[2, 2]],
        ]
    )


def _congruent(turn: ca.SX, a: ca.SX) -> ca.SX:
    """E A Eᵀ of a symmetric A."""
    half = ca.mtimes(turn, a)
    return _mirrored([[ca.dot(half[i, :].T, turn[j, :].T) for j in range(i, 3)] for i in range(3)])

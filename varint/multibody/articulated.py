"""v from p = M(q) v by articulated bodies: a number of operations linear in the links.

From the tips to the ground every link hands its parent the inertia that the parent feels, its own
joint free to give way; from the ground to the tips the velocities follow. M itself is never formed.

R. Featherstone, Rigid Body Dynamics Algorithms, Springer 2008, §7.2, with momenta in place of
forces: what is there f = I a + b is here the momentum I v + b of a subtree.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import casadi as ca

from varint.discrete.legendre import mass_solve
from varint.multibody.elementary import for_each_link
from varint.multibody.inertia import (
    NO_MOMENTUM,
    Inertia,
    Momentum,
    carried,
    mirrored,
    outward,
    rigid,
    together,
)
from varint.multibody.kinematics import (
    STILL,
    Motions,
    Twist,
    body_rates,
    coordinates_of,
    moved,
)
from varint.multibody.tree import GROUND, Link, Tree


class _Drive(NamedTuple):
    """What a joint is driven with: its momentum, and its rotor's inertia."""

    momentum: ca.SX
    armature: Any


class _Given(NamedTuple):
    """What a joint of one coordinate gives way by: the column U/D of inertia over its pivot D, but
    for its component along the joint, 1 − share; the rate (p − S·b)/D in a parent at rest; and
    what its parent feels, I − U Uᵀ/D and b + U (p − S·b)/D, about the link's origin.
    """

    spin: ca.SX
    push: ca.SX
    share: ca.SX
    rate: ca.SX
    J: ca.SX
    H: ca.SX
    M: ca.SX
    spin_left: ca.SX
    push_left: ca.SX


class _Wholly(NamedTuple):
    """The same of a joint that gives way in all three directions, of turning or of moving: its rate
    ``rate − x − K y`` in a parent with that part x of its twist and the other part y.
    """

    rate: ca.SX
    K: ca.SX
    J: ca.SX
    H: ca.SX
    M: ca.SX
    spin_left: ca.SX
    push_left: ca.SX


class _Answer(NamedTuple):
    """The rate of a joint of one coordinate, and the twist of its link."""

    rate: ca.SX
    omega: ca.SX
    v: ca.SX


def velocity_of_momentum(
    tree: Tree,
    motions: Motions,
    momenta: Mapping[str, ca.SX],
    armatures: Mapping[str, Any],
    stretching: Mapping[str, Any],
) -> dict[str, ca.SX]:
    """Rates of every joint's coordinates with p = M(q) v.

    Parameters
    ----------
    tree : Tree
        With joints that follow no other.
    motions : dict
        Coordinates of the joints by name; their rates are not looked at.
    momenta : dict
        p of the joints by name.
    armatures : dict
        Inertia of the joints' rotors by name.
    stretching : dict
        μ of the quaternions' lengths by name, see `stretching`.
    """
    links = tree.links
    inertias = [rigid(inertial) for inertial in tree.inertials]
    biases = [NO_MOMENTUM] * len(links)
    given: list[_Given | _Wholly] = []
    for i in reversed(range(len(links))):
        link = links[i]
        q, _ = coordinates_of(link, motions)
        p = momenta[link.joint][link.first : link.first + link.size]
        one: _Given | _Wholly
        if link.size == 1:
            drive = _Drive(p, ca.SX(armatures[link.joint]))
            one = _given_way(link, q, inertias[i], biases[i], drive)
        else:
            p = spin_of(q, p) if link.motion == "spherical" else p
            one = _given_way_wholly(link, q, inertias[i], biases[i], p)
        given.append(one)
        if link.parent != GROUND:
            outer = outward(link, q, Inertia(one.J, one.H, one.M))
            inertias[link.parent] = together(inertias[link.parent], outer)
            spin, push = carried(link, q, Momentum(one.spin_left, one.push_left))
            before = biases[link.parent]
            biases[link.parent] = Momentum(before.spin + spin, before.push + push)
    twists: list[Twist] = []
    rates: dict[str, list[ca.SX]] = {}
    for link, one in zip(links, given[::-1], strict=True):
        q, _ = coordinates_of(link, motions)
        p = momenta[link.joint][link.first : link.first + link.size]
        outer_twist = STILL if link.parent == GROUND else twists[link.parent]
        twist = moved(link, q, outer_twist, STILL)
        if isinstance(one, _Given):
            rate, *whole = _answer(link, q, one, twist)
        else:
            here, other = twist if link.motion == "spherical" else twist[::-1]
            rate = one.rate - here - ca.mtimes(one.K, other)
            own = Twist(rate, STILL.v) if link.motion == "spherical" else Twist(STILL.omega, rate)
            whole = [twist.omega + own.omega, twist.v + own.v]
        if link.motion == "spherical":
            rate = quaternion_rates(q, rate) + q * ca.dot(q, p) / stretching[link.joint]
        twists.append(Twist(*whole))
        rates.setdefault(link.joint, []).append(rate)
    return {joint: ca.vertcat(*parts) for joint, parts in rates.items()}


def spin_of(q: ca.SX, p: ca.SX) -> ca.SX:
    """Angular momentum ½ Im(q̄ p) (3,) along the body's axes that the momentum of a quaternion is:
    p = Eᵀ Π with ω = E q̇.
    """
    return ca.sumsqr(q) / 4 * body_rates(q, p)


def quaternion_rates(q: ca.SX, omega: ca.SX) -> ca.SX:
    """q̇ = ½ q (0, ω) of an angular velocity along the body's axes."""
    (w, x, y, z), (a, b, c) = ca.vertsplit(q), ca.vertsplit(omega)
    return (
        ca.vertcat(
            -x * a - y * b - z * c,
            w * a + y * c - z * b,
            w * b + z * a - x * c,
            w * c + x * b - y * a,
        )
        / 2
    )


@for_each_link(Inertia, Momentum, _Drive, gives=_Given)
def _given_way(link: Link, q: ca.SX, own: Inertia, bias: Momentum, drive: _Drive) -> _Given:
    """Without a rotor nothing is felt along the joint but its momentum: its share is zero."""
    turns = link.motion == "revolute"
    spin, push = (own.J[:, 2], own.H[2, :].T) if turns else (own.H[:, 2], own.M[:, 2])
    pivot = (spin if turns else push)[2] + drive.armature
    free = drive.momentum - (bias.spin if turns else bias.push)[2]
    less_spin, less_push, share = spin / pivot, push / pivot, drive.armature / pivot
    spin_left, push_left = bias.spin + less_spin * free, bias.push + less_push * free
    (spin_left if turns else push_left)[2] = drive.momentum - share * free
    H = own.H - ca.mtimes(less_spin, push.T)
    if turns:
        J, M = _freed(own.J, less_spin, spin, share), _without(own.M, less_push, push)
        H[2, :] = share * push.T
    else:
        J, M = _without(own.J, less_spin, spin), _freed(own.M, less_push, push, share)
        H[:, 2] = share * spin
    rate = free / pivot
    return _Given(less_spin, less_push, share, rate, J, H, M, spin_left, push_left)


@for_each_link(_Given, Twist, gives=_Answer)
def _answer(link: Link, q: ca.SX, one: _Given, outer: Twist) -> _Answer:
    """The joint's rate in a parent that moves, and the link's twist with it."""
    omega, v = ca.SX(outer.omega), ca.SX(outer.v)
    spin, push = ca.SX(one.spin), ca.SX(one.push)
    along, less = (omega, spin) if link.motion == "revolute" else (v, push)
    before, less[2] = along[2], -one.share
    after = one.rate - ca.dot(spin, omega) - ca.dot(push, v)
    along[2] = after
    return _Answer(after - before, omega, v)


@for_each_link(Inertia, Momentum, ca.SX, gives=_Wholly)
def _given_way_wholly(link: Link, q: ca.SX, own: Inertia, bias: Momentum, p: ca.SX) -> _Wholly:
    """Of the pair (turning, moving) one gives way: its inertia is the pivot."""
    none = ca.SX.zeros(3, 3)
    if link.motion == "spherical":
        pivot, across, free = own.J, own.H, p - bias.spin
    else:
        pivot, across, free = own.M, own.H.T, p - bias.push
    solved = mass_solve(pivot, ca.horzcat(free, across))
    rate, gain = solved[:, 0], solved[:, 1:]
    carried_on = ca.mtimes(across.T, rate)
    rest = ca.mtimes(across.T, gain)
    rest = mirrored([[rest[i, j] for j in range(i, 3)] for i in range(3)])
    if link.motion == "spherical":
        return _Wholly(rate, gain, none, none, own.M - rest, p, bias.push + carried_on)
    return _Wholly(rate, gain, own.J - rest, none, none, bias.spin + carried_on, p)


def _freed(a: ca.SX, less: ca.SX, u: ca.SX, share: ca.SX) -> ca.SX:
    """A − less uᵀ where A's third column is u and less_2 = 1 − share."""
    found = _without(a, less, u)
    found[2, :], found[:, 2] = share * u.T, share * u
    return found


def _without(a: ca.SX, x: ca.SX, y: ca.SX) -> ca.SX:
    """A − x yᵀ, known to be symmetric."""
    return mirrored([[a[i, j] - x[i] * y[j] for j in range(i, 3)] for i in range(3)])

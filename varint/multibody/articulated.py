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
from varint.multibody.kinematics import STILL, Motions, Twist, coordinates_of, moved, relative_twist
from varint.multibody.tree import GROUND, Link, Tree

HINGES = ("revolute", "prismatic")  # motions that one number describes


class _Drive(NamedTuple):
    """What a joint is driven with: its momentum, and its rotor's inertia."""

    momentum: ca.SX
    armature: Any


class _Given(NamedTuple):
    """What a joint gives way by: the column U of inertia, its pivot D, and p − S·b; then what its
    parent feels, I − U Uᵀ/D and b + U (p − S·b)/D, about the link's origin.
    """

    spin: ca.SX
    push: ca.SX
    pivot: ca.SX
    free: ca.SX
    J: ca.SX
    H: ca.SX
    M: ca.SX
    spin_left: ca.SX
    push_left: ca.SX


def has_only_hinges(tree: Tree) -> bool:
    """Whether every link moves by one number of its own."""
    return all(link.motion in HINGES for link in tree.links)


def velocity_of_momentum(
    tree: Tree, motions: Motions, momenta: Mapping[str, ca.SX], armatures: Mapping[str, Any]
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
    inertias = [rigid(inertial) for inertial in tree.inertials]
    biases = [NO_MOMENTUM] * len(links)
    given: list[_Given] = []
    for i in reversed(range(len(links))):
        link = links[i]
        q, _ = coordinates_of(link, motions)
        drive = _Drive(momenta[link.joint][link.first], ca.SX(armatures[link.joint]))
        given.append(_given_way(link, q, inertias[i], biases[i], drive))
        if link.parent != GROUND:
            inertia, rest = Inertia(*given[-1][4:7]), Momentum(*given[-1][7:])
            inertias[link.parent] = together(inertias[link.parent], outward(link, q, inertia))
            spin, push = carried(link, q, rest)
            before = biases[link.parent]
            biases[link.parent] = Momentum(before.spin + spin, before.push + push)
    twists: list[Twist] = []
    rates: dict[str, list[ca.SX]] = {}
    for link, (spin, push, pivot, free, *_) in zip(links, given[::-1], strict=True):
        q, _ = coordinates_of(link, motions)
        outer = STILL if link.parent == GROUND else twists[link.parent]
        twist = moved(link, q, outer, STILL)
        rate = (free - ca.dot(spin, twist.omega) - ca.dot(push, twist.v)) / pivot
        own = relative_twist(link, q, rate)
        twists.append(Twist(twist.omega + own.omega, twist.v + own.v))
        rates.setdefault(link.joint, []).append(rate)
    return {joint: ca.vertcat(*parts) for joint, parts in rates.items()}


@for_each_link(Inertia, Momentum, _Drive, gives=_Given)
def _given_way(link: Link, q: ca.SX, own: Inertia, bias: Momentum, drive: _Drive) -> _Given:
    turns = link.motion == "revolute"
    spin, push = (own.J[:, 2], own.H[2, :].T) if turns else (own.H[:, 2], own.M[:, 2])
    pivot = (spin if turns else push)[2] + drive.armature
    free = drive.momentum - (bias.spin if turns else bias.push)[2]
    less_spin, less_push, rate = spin / pivot, push / pivot, free / pivot
    return _Given(
        spin,
        push,
        pivot,
        free,
        _without(own.J, less_spin, spin),
        own.H - ca.mtimes(less_spin, push.T),
        _without(own.M, less_push, push),
        bias.spin + spin * rate,
        bias.push + push * rate,
    )


def _without(a: ca.SX, x: ca.SX, y: ca.SX) -> ca.SX:
    """A − x yᵀ, known to be symmetric."""
    return mirrored([[a[i, j] - x[i] * y[j] for j in range(i, 3)] for i in range(3)])

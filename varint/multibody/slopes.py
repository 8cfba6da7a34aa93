"""∂L/∂q and ∂L/∂v of a machine by recursion: a fixed number of operations for each link.

From the ground to the tips the twists, from the tips to the ground the momenta of subtrees. A joint
that moves by s dq changes the twists of its subtree as the twist V that it is carried with is
turned: ∂T/∂q = h·(V × s) with the subtree's momentum h, and ∂T/∂v = h·s. The weight does the same
to the subtree's first moment. Equal to reverse differentiation of L, for less.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import casadi as ca

from varint.multibody.elementary import for_each_link
from varint.multibody.grouped import grouped
from varint.multibody.inertia import NO_MOMENTUM, Momentum, carried
from varint.multibody.kinematics import (
    STILL,
    Motions,
    Twist,
    body_rates,
    coordinates_of,
    moved,
    relative_twist,
    shift,
    turned,
    turned_back,
)
from varint.multibody.tree import GROUND, Inertial, Link, Tree


class _Weight(NamedTuple):
    """Mass and first moment of a subtree, about a link's origin."""

    mass: ca.SX
    moment: ca.SX


def link_slopes(tree: Tree, motions: Motions, gravity: Any, state: ca.SX) -> ca.SX:
    """∂/∂state of T + Σ m g·x of the links, (2 n,); the state has q first, then v."""
    links, inertials = tree.links, grouped(tree)
    outside, downs, twists = list[Twist](), list[ca.SX](), list[Twist]()
    for link in links:
        q, v = coordinates_of(link, motions)
        grounded = link.parent == GROUND
        outer = moved(link, q, STILL if grounded else twists[link.parent], STILL)
        own = relative_twist(link, q, v)
        outside.append(outer)
        downs.append(turned_back(link, q, ca.SX(gravity) if grounded else downs[link.parent]))
        twists.append(Twist(outer.omega + own.omega, outer.v + own.v))
    momenta = [NO_MOMENTUM] * len(links)
    weights = [_Weight(x.mass, x.moment) for x in inertials]
    coordinates, slopes = list[ca.SX](), list[ca.SX]()
    for i in reversed(range(len(links))):
        link = links[i]
        q, v = coordinates_of(link, motions)
        mine, rest = _momentum(link, q, twists[i], inertials[i]), momenta[i]
        whole = Momentum(mine.spin + rest.spin, mine.push + rest.push)
        felt = _felt(link, q, outside[i], whole, downs[i], weights[i])
        coordinates += [q, v]
        slopes += _slopes(link, q, v, felt, whole)
        if link.parent != GROUND:
            spin, push = carried(link, q, whole)
            before, weight = momenta[link.parent], weights[link.parent]
            momenta[link.parent] = Momentum(before.spin + spin, before.push + push)
            mass, moment = _hung(link, q, weights[i])
            weights[link.parent] = _Weight(weight.mass + mass, weight.moment + moment)
    return ca.densify(ca.jtimes(ca.vertcat(*coordinates), state, ca.vertcat(*slopes), True))


@for_each_link(Twist, Inertial, gives=Momentum)
def _momentum(link: Link, q: ca.SX, twist: Twist, inertial: Inertial) -> Momentum:
    """Of a link, about its origin."""
    (omega, v), (mass, moment, inertia) = twist, inertial
    return Momentum(
        ca.mtimes(inertia, omega) + ca.cross(moment, v), mass * v + ca.cross(omega, moment)
    )


@for_each_link(_Weight, gives=_Weight)
def _hung(link: Link, q: ca.SX, own: _Weight) -> _Weight:
    """About the parent's origin and along its axes."""
    moment = turned(link, q, own.moment + own.mass * shift(link, q))
    return _Weight(own.mass, moment + own.mass * link.place.position)


@for_each_link(Twist, Momentum, ca.SX, _Weight, gives=ca.SX)
def _felt(
    link: Link, q: ca.SX, outside: Twist, whole: Momentum, down: ca.SX, weight: _Weight
) -> ca.SX:
    """What a link gains of L for moving by a small vector along its axes, (3,), with the twist
    that it has without its joint.
    """
    if link.motion in ("prismatic", "translation"):
        return ca.cross(whole.push, outside.omega) + weight.mass * down
    return (
        ca.cross(whole.spin, outside.omega)
        + ca.cross(whole.push, outside.v)
        + ca.cross(weight.moment, down)
    )


def _slopes(link: Link, q: ca.SX, v: ca.SX, felt: ca.SX, whole: Momentum) -> list[ca.SX]:
    """∂L/∂q and ∂L/∂v of a link's coordinates."""
    if link.motion == "spherical":
        rates = body_rates(q, v)
        turning = ca.jtimes(rates, q, whole.spin, True) + ca.jtimes(rates, v, felt, True)
        return [turning, ca.jtimes(rates, v, whole.spin, True)]
    along = whole.spin if link.motion == "revolute" else whole.push
    return [felt, along] if link.motion == "translation" else [felt[2], along[2]]

"""Inverse dynamics and the mass matrix by recursion over the tree.

Recursive Newton–Euler and composite rigid bodies: R. Featherstone, Rigid Body Dynamics Algorithms,
Springer 2008, §5.3 and §6.2, each link in its own axes about its own origin. Nothing here is
derived from the Lagrangian, so that each is a check of the other.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import casadi as ca
import numpy as np

from varint.multibody.data import Joint
from varint.multibody.elementary import for_each_link
from varint.multibody.inertia import (
    Inertia,
    Momentum,
    carried,
    outward,
    rigid,
    times,
    together,
)
from varint.multibody.kinematics import (
    STILL,
    Motions,
    Twist,
    body_rates,
    coordinates_of,
    moved,
    relative_twist,
    shift,
    turned_back,
)
from varint.multibody.tree import GROUND, Inertial, Link, Tree


def efforts(
    tree: Tree, motions: Motions, accelerations: Mapping[str, ca.SX], gravity: Any
) -> dict[str, ca.SX]:
    """Generalised forces of the joints, by name, that make the links move as given, in gravity."""
    twists, forces = list[Twist](), list[Momentum]()
    rises: list[Twist] = []  # accelerations of the links' frames, as if the ground rose by −g
    ground = Twist(ca.SX.zeros(3), -ca.SX(gravity))
    for link, inertial in zip(tree.links, tree.inertials, strict=True):
        q, v = coordinates_of(link, motions)
        part = slice(link.first, link.first + link.size)
        own = relative_twist(link, q, v)
        outer = STILL if link.parent == GROUND else twists[link.parent]
        before = ground if link.parent == GROUND else rises[link.parent]
        twist = moved(link, q, outer, own)
        gained = relative_twist(link, q, accelerations[link.joint][part])
        rise = _rise(link, q, outer, before, own, gained)
        twists.append(twist)
        rises.append(rise)
        forces.append(_force(link, q, twist, rise, inertial))
    found: dict[str, list[ca.SX]] = {link.joint: [] for link in tree.links}
    for i in reversed(range(len(tree.links))):
        link = tree.links[i]
        q, _ = coordinates_of(link, motions)
        found[link.joint].insert(0, _along(link, motions, forces[i]))
        if link.parent != GROUND:
            spin, push = carried(link, q, forces[i])
            there = forces[link.parent]
            forces[link.parent] = Momentum(there.spin + spin, there.push + push)
    return {joint: ca.vertcat(*parts) for joint, parts in found.items()}


@for_each_link(Twist, Twist, Twist, Twist, gives=Twist)
def _rise(link: Link, q: ca.SX, outer: Twist, before: Twist, own: Twist, gained: Twist) -> Twist:
    """Accelerations of a link's frame from its parent's, the turning of its axes included."""
    swept = ca.cross(outer.omega, ca.cross(outer.omega, link.place.position))
    turning = turned_back(link, q, outer.omega)
    omega, v = moved(link, q, before, gained)
    return Twist(
        omega + ca.cross(turning, own.omega),
        v
        + turned_back(link, q, swept)
        + ca.cross(turning, ca.cross(turning, shift(link, q)) + 2 * own.v),
    )


@for_each_link(Twist, Twist, Inertial, gives=Momentum)
def _force(link: Link, q: ca.SX, twist: Twist, rise: Twist, inertial: Inertial) -> Momentum:
    """Torque and force (Newton, Euler) that make a link move so, about its origin."""
    mass, moment, inertia = inertial
    spun, swept = ca.mtimes(inertia, twist.omega), ca.cross(twist.omega, moment)
    return Momentum(
        ca.mtimes(inertia, rise.omega) + ca.cross(moment, rise.v) + ca.cross(twist.omega, spun),
        mass * rise.v + ca.cross(rise.omega, moment) + ca.cross(twist.omega, swept),
    )


def mass_matrix(tree: Tree, motions: Motions, v: ca.SX) -> ca.SX:
    """M(q) (n, n) of the links, from the momentum of a subtree of which one joint alone moves."""
    links = tree.links
    composite: list[Inertia] = [rigid(inertial) for inertial in tree.inertials]
    for i in reversed(range(len(links))):
        if links[i].parent != GROUND:
            q, _ = coordinates_of(links[i], motions)
            outer = links[i].parent
            composite[outer] = together(composite[outer], outward(links[i], q, composite[i]))
    sizes = [len(_columns(link)) for link in links]
    firsts = np.concatenate([[0], np.cumsum(sizes)]).astype(int)
    entries: dict[tuple[int, int], ca.SX] = {}
    for i, link in enumerate(links):
        for k, column in enumerate(_columns(link), int(firsts[i])):
            momentum, at = times(composite[i], *column), i
            while True:
                for j, x in enumerate(_parts(links[at], momentum), int(firsts[at])):
                    entries[j, k] = entries[k, j] = x
                if links[at].parent == GROUND:
                    break
                momentum = carried(links[at], coordinates_of(links[at], motions)[0], momentum)
                at = links[at].parent
    rows, columns = zip(*entries, strict=True)
    # in which order the sparse matrix holds them
    order = ca.DM.triplet(rows, columns, ca.DM(range(len(rows))), int(firsts[-1]), int(firsts[-1]))
    values = list(entries.values())
    found = ca.SX(order.sparsity(), ca.vertcat(*(values[int(k)] for k in order.nonzeros())))
    slopes = ca.jacobian(ca.vertcat(*(_rates(link, motions) for link in links)), v)
    return ca.sparsify(ca.mtimes(ca.mtimes(slopes.T, found), slopes))


def armature_matrix(joints: Iterable[Joint], motions: Motions, v: ca.SX) -> ca.SX:
    """What the rotors add to the mass matrix."""
    total = ca.SX(v.numel(), v.numel())
    for joint in joints:
        slopes = ca.jacobian(motions[joint.name][1], v)
        total += joint.passive.armature * ca.mtimes(slopes.T, slopes)
    return ca.sparsify(total)


def _columns(link: Link) -> list[Twist]:
    """Twists of a link in its parent, one for each number of `_rates`."""
    none, unit = ca.SX.zeros(3), ca.SX.eye(3)
    if link.motion == "revolute":
        return [Twist(unit[:, 2], none)]
    if link.motion == "prismatic":
        return [Twist(none, unit[:, 2])]
    if link.motion == "translation":
        return [Twist(none, unit[:, i]) for i in range(3)]
    return [Twist(unit[:, i], none) for i in range(3)]


def _parts(link: Link, momentum: Momentum) -> list[ca.SX]:
    """Components of a momentum or force along `_columns`."""
    if link.motion in ("revolute", "spherical"):
        parts = ca.vertsplit(ca.densify(momentum.spin))
    else:
        parts = ca.vertsplit(ca.densify(momentum.push))
    return parts[2:] if link.size == 1 else parts


def _rates(link: Link, motions: Motions) -> ca.SX:
    """The rates of a link in its parent: of its coordinates, or its angular velocity."""
    q, v = coordinates_of(link, motions)
    return body_rates(q, v) if link.motion == "spherical" else v


def _along(link: Link, motions: Motions, force: Momentum) -> ca.SX:
    """The generalised force on a link's coordinates."""
    parts = ca.vertcat(*_parts(link, force))
    if link.motion != "spherical":
        return parts
    q, v = coordinates_of(link, motions)
    return ca.mtimes(ca.jacobian(body_rates(q, v), v).T, parts)

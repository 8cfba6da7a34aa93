"""The length of quaternions: a motion of its own that nothing pushes.

A joint that turns by a quaternion q has the kinetic energy of its rotation, which does not change
with |q|, and ½ μ (q·q̇/|q|²)² of the length. With it the mass matrix is regular without a
constraint |q|² = 1: the length stays as it is because its momentum q·p is zero and is kept, and
the motion is the same whatever μ is. L is unchanged by q → λ q, q̇ → λ q̇ (`System.rays`).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import casadi as ca
import numpy as np

from varint.multibody.data import Joint, Machine
from varint.multibody.joints import QUATERNION_AT
from varint.multibody.kinematics import Motions
from varint.multibody.tree import GROUND, Tree
from varint.scene.parameters import parameter_vector

QUARTERS = 4.0  # ½ ω·I ω = ½ 4 I |q̇|² of a ball, for ω = 2 q̄ q̇


def stretching_inertias(machine: Machine, tree: Tree) -> dict[str, Any]:
    """μ of every joint that turns by a quaternion: about what the turning has, 4 times the mean
    moment of inertia of all that the joint carries, parameters at their defaults.
    """
    links = tree.links
    if not any(link.motion == "spherical" for link in links):
        return {}
    masses, moments, arms = _numbers(
        machine,
        [inertial.mass for inertial in tree.inertials],
        [ca.trace(inertial.inertia) / 3 for inertial in tree.inertials],
        [ca.sumsqr(link.place.position) for link in links],
    )
    found = {}
    for i in reversed(range(len(links))):
        if links[i].motion == "spherical":
            found[links[i].joint] = float(QUARTERS * moments[i]) if moments[i] > 0 else 1.0
        if (outer := links[i].parent) != GROUND:
            moments[outer] += moments[i] + masses[i] * arms[i]
            masses[outer] += masses[i]
    return found


def stretching_energy(joints: Mapping[str, Joint], motions: Motions, inertias: Mapping) -> ca.SX:
    """Σ ½ μ (q·q̇/|q|²)²."""
    total = ca.SX(0)
    for name, inertia in inertias.items():
        q, v = quaternion_of(joints[name], motions)
        total += inertia * (ca.dot(q, v) / ca.sumsqr(q)) ** 2 / 2
    return total


def stretching_matrix(
    joints: Mapping[str, Joint], motions: Motions, inertias: Mapping, v: ca.SX
) -> ca.SX:
    """What it adds to the mass matrix, (n, n)."""
    total = ca.SX(v.numel(), v.numel())
    for name, inertia in inertias.items():
        q, rate = quaternion_of(joints[name], motions)
        along = ca.mtimes(q.T, ca.jacobian(rate, v)) / ca.sumsqr(q)
        total += inertia * ca.mtimes(along.T, along)
    return total


def rays_of(machine: Machine) -> tuple[tuple[int, ...], ...]:
    """Which coordinates of the system are quaternions."""
    rays, first = [], 0
    for joint in machine.moving:
        size = joint.q.numel()
        if joint.kind in QUATERNION_AT:
            rays.append(tuple(range(first + QUATERNION_AT[joint.kind], first + size)))
        first += size
    return tuple(rays)


def quaternion_of(joint: Joint, motions: Motions) -> tuple[ca.SX, ca.SX]:
    """A joint's quaternion and its rate."""
    q, v = motions[joint.name]
    return q[QUATERNION_AT[joint.kind] :], v[QUATERNION_AT[joint.kind] :]


def _numbers(machine: Machine, *expressions: list[ca.SX]) -> list[np.ndarray]:
    """Expressions of the model's parameters at their defaults."""
    at = ca.Function(
        "at", [parameter_vector(machine.params)], [ca.vertcat(*each) for each in expressions]
    )
    defaults = machine.params._defaults.values()
    values = np.concatenate([np.zeros(0), *(x.ravel(order="F") for x in defaults)])
    return [np.array(x).ravel() for x in at(values)]

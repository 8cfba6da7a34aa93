"""What a still or streaming medium does to bodies: drag on the box that has a body's inertia."""

from __future__ import annotations

import casadi as ca
import numpy as np

from varint.errors import InputError
from varint.multibody.data import WORLD, Anchor, Body, Machine, Placement
from varint.multibody.frames import fixed_frames
from varint.multibody.kinematics import Motions
from varint.multibody.tree import Tree


def medium_dissipation(machine: Machine, tree: Tree, motions: Motions) -> ca.SX:
    """Rayleigh's function of the medium on all bodies with a mass, ∂/∂v of which are

    the forces ``ρ b_j b_k |v_i| v_i / 2 + 3π μ d v_i`` along the principal axes i of each body and
    the torques ``ρ b_i (b_j⁴ + b_k⁴) |ω_i| ω_i / 64 + π μ d³ ω_i``, with the sides b of the box of
    the body's mass and inertia, d their mean, and v relative to the medium.

    References
    ----------
    MuJoCo documentation, Computation, Fluid forces, inertia-based model.
    """
    total = ca.SX(0)
    if machine.medium is None:
        return total
    density, viscosity, wind = machine.medium
    bodies = [body for body in machine.bodies.values() if _has_mass(body)]
    boxes = [inertia_box(body) for body in bodies]
    anchors = [Anchor(body.name, box[0]) for body, box in zip(bodies, boxes, strict=True)]
    frames = fixed_frames(tree, motions, anchors)
    for (_, sides), (place, twist) in zip(boxes, frames, strict=True):
        v = twist.v - ca.mtimes(ca.SX(place.rotation).T, ca.SX(wind))
        mean = sides.mean()
        for i in range(3):
            j, k = (i + 1) % 3, (i + 2) % 3
            face, swept = sides[j] * sides[k], sides[i] * (sides[j] ** 4 + sides[k] ** 4)
            total += density * face * ca.fabs(v[i]) * v[i] ** 2 / 6
            total += density * swept * ca.fabs(twist.omega[i]) * twist.omega[i] ** 2 / 192
        total += 3 * np.pi * viscosity * mean * ca.sumsqr(v) / 2
        total += np.pi * viscosity * mean**3 * ca.sumsqr(twist.omega) / 2
    return total


def inertia_box(body: Body) -> tuple[Placement, np.ndarray]:
    """The box of even density with a body's mass and inertia: its frame in the body, its sides."""
    if any(isinstance(x, ca.SX) for x in (body.mass, body.com, body.inertia)):
        raise InputError(
            f"the drag on body {body.name!r} follows from its inertia, which must be numbers"
        )
    moments, axes = np.linalg.eigh(body.inertia)
    axes[:, 2] *= np.sign(np.linalg.det(axes))
    squares = 6 / body.mass * (moments.sum() - 2 * moments)
    return Placement(body.com, axes), np.sqrt(np.maximum(squares, 0.0))


def _has_mass(body: Body) -> bool:
    return body.name != WORLD and (isinstance(body.mass, ca.SX) or body.mass > 0)

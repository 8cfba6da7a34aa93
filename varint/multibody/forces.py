"""Springs between frames, and generalised forces: F = ∂/∂v (power of controls − dissipation)."""

from __future__ import annotations

from typing import Any

import casadi as ca

from varint.multibody.data import Actuator, Machine, Placement
from varint.multibody.frames import fixed_frames
from varint.multibody.joints import QUATERNION_AT
from varint.multibody.kinematics import Motions, Twist, body_rates
from varint.multibody.medium import medium_dissipation
from varint.multibody.tree import Tree

Fixed = tuple[Placement, Twist]


def spring_potential(machine: Machine, tree: Tree, motions: Motions) -> ca.SX:
    """Σ ½ k (ℓ − rest)² of the springs between frames."""
    total, springs = ca.SX(0), list(machine.springs.values())
    ends = fixed_frames(tree, motions, [end for x in springs for end in (x.a, x.b)])
    for spring, a, b in zip(springs, ends[::2], ends[1::2], strict=True):
        square = ca.sumsqr(gap_between(a, b))
        # without a rest length the ends may meet, and no root is taken
        stretched = square if is_zero(spring.rest) else (ca.sqrt(square) - spring.rest) ** 2
        if not is_zero(spring.stiffness):
            total += spring.stiffness * stretched / 2
    return total


def generalised_force(machine: Machine, tree: Tree, motions: Motions) -> ca.SX:
    """Forces (n,) of actuators, dampers and friction on the coordinates."""
    return ca.gradient(
        control_power(machine, tree, motions) - dissipation(machine, tree, motions), machine.v
    )


def control_power(machine: Machine, tree: Tree, motions: Motions) -> ca.SX:
    """Σ gear u · speed of what the actuators push."""
    total = ca.SX(0)
    for actuator in machine.actuators.values():
        total += actuator.gear * actuator.u * _speed(actuator, tree, motions)
    return total


def dissipation(machine: Machine, tree: Tree, motions: Motions) -> ca.SX:
    """Rayleigh's function: ½ d v² of dampers, f (√(v² + creep²) − creep) of dry friction, and the
    drag of a medium.
    """
    total = medium_dissipation(machine, tree, motions) + joint_dissipation(machine, motions)
    dampers = [x for x in machine.springs.values() if not is_zero(x.damping)]
    ends = fixed_frames(tree, motions, [end for x in dampers for end in (x.a, x.b)])
    for damper, a, b in zip(dampers, ends[::2], ends[1::2], strict=True):
        gap = gap_between(a, b)
        growth = ca.dot(gap, _velocity(b) - _velocity(a))
        total += damper.damping * growth**2 / ca.sumsqr(gap) / 2
    return total


def joint_dissipation(machine: Machine, motions: Motions) -> ca.SX:
    """That of the joints alone."""
    total = ca.SX(0)
    for joint in machine.joints.values():
        (q, v), passive = motions[joint.name], joint.passive
        if not is_zero(passive.damping):
            first = QUATERNION_AT.get(joint.kind, v.numel())
            square = ca.sumsqr(v[:first])
            if joint.kind in QUATERNION_AT:
                square += ca.sumsqr(body_rates(q[first:], v[first:]))
            total += passive.damping * square / 2
        if not is_zero(passive.friction):
            smooth = ca.sqrt(v**2 + machine.creep**2) - machine.creep
            total += passive.friction * ca.sum1(smooth)
    return total


def _speed(actuator: Actuator, tree: Tree, motions: Motions) -> ca.SX:
    if actuator.anchor is None:
        return motions[actuator.joint][1][actuator.index]
    [(_, twist)] = fixed_frames(tree, motions, [actuator.anchor])
    return (twist.v if actuator.kind == "thrust" else twist.omega)[2]


def gap_between(a: Fixed, b: Fixed) -> ca.SX:
    return ca.SX(b[0].position) - ca.SX(a[0].position)


def _velocity(fixed: Fixed) -> ca.SX:
    place, twist = fixed
    return ca.mtimes(ca.SX(place.rotation), twist.v)


def is_zero(x: Any) -> bool:
    return not isinstance(x, ca.SX) and x == 0

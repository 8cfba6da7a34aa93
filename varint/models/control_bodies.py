"""Ready optimal control problems of bodies that are held together or float: two arms with a load, a hovercraft."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np

from varint.control.phase import Phase
from varint.models.control import ControlModel
from varint.rules import gauss, lobatto
from varint.system import System, coordinates

BASES = (np.array([-0.6, 0.0]), np.array([0.6, 0.0]))  # m: shoulders of the two arms
GRIP = 0.2  # m: half the width of the load
LINK, LINK_MASS, LOAD_MASS, GRAVITY = 0.5, 1.0, 2.0, 9.81


def arms_lagrangian(angles: ca.SX, q: ca.SX, v: ca.SX) -> tuple[ca.SX, list[ca.SX]]:
    """L of two arms of two uniform rods each, in four angles from the horizontal, and the places of the hands."""
    lagrangian, hands = ca.SX(0), []
    for side, base in enumerate(BASES):
        end = ca.SX(ca.DM(base))
        for angle in (angles[2 * side], angles[2 * side + 1]):
            rod = LINK * ca.vertcat(ca.cos(angle), ca.sin(angle))
            middle, end = end + rod / 2, end + rod
            lagrangian += LINK_MASS / 2 * ca.sumsqr(ca.jtimes(middle, q, v)) - LINK_MASS * GRAVITY * middle[1]
            lagrangian += LINK_MASS * LINK**2 / 24 * ca.jtimes(angle, q, v) ** 2
        hands.append(end)
    return lagrangian, hands


def arm_angles(load: ca.SX) -> ca.SX:
    """The four angles when the hands hold the load, elbows outwards: the inverse kinematics."""
    angles = []
    for base, grip, side in zip(BASES, (-GRIP, GRIP), (1, -1), strict=True):
        reach = load + ca.DM([grip, 0]) - ca.DM(base)
        bend = ca.acos(ca.norm_2(reach) / (2 * LINK))
        direction = ca.atan2(reach[1], reach[0])
        angles += [direction + side * bend, direction - side * bend]
    return ca.vertcat(*angles)


def joint_forces(torque: ca.SX) -> ca.SX:
    """Generalised forces on the four angles by motors at shoulders and elbows."""
    return ca.vertcat(torque[0] - torque[1], torque[1], torque[2] - torque[3], torque[3])


def carried_load(
    here: Sequence[float] = (-0.2, 0.45), there: Sequence[float] = (0.25, 0.75), steps: int = 20, stages: int = 4
) -> ControlModel:
    """Two arms of two links carry a load together: a closed loop with four motors, least ∫ |torques|² dt."""
    q, v = coordinates("a1", "a2", "b1", "b2", "x", "y")
    torque = ca.SX.sym("torque", 4)
    arms, hands = arms_lagrangian(q[:4], q, v)
    load, grip = q[4:], ca.DM([GRIP, 0])
    lagrangian = arms + LOAD_MASS / 2 * ca.sumsqr(v[4:]) - LOAD_MASS * GRAVITY * load[1]
    closed = ca.vertcat(hands[0] - (load - grip), hands[1] - (load + grip))
    force = ca.vertcat(joint_forces(torque), 0, 0)
    system = System(q, v, lagrangian, constraint=closed, force=force, control=torque)
    angles = ca.Function("angles", [load], [arm_angles(load)])
    ends = [[*np.array(angles(place)).ravel(), *place] for place in (here, there)]
    phase = Phase(
        system, lobatto(stages), 1.0, steps, ca.sumsqr(torque), start=dict(q=ends[0], v=[0] * 6),
        end=dict(q=ends[1], v=[0] * 6),
    )  # fmt: skip
    known = (tuple(here), tuple(there)) == ((-0.2, 0.45), (0.25, 0.75))
    return ControlModel(
        name="carried_load", phases=(phase,), cost=100.612419644055 if known else None,
        claim="The cost in six coordinates with four constraints is that in the load's two coordinates alone.",
        source="Murray, Li, Sastry, A Mathematical Introduction to Robotic Manipulation, §6.5: closed kinematic chains",
    )  # fmt: skip


def carried_load_reduced(
    here: Sequence[float] = (-0.2, 0.45), there: Sequence[float] = (0.25, 0.75), steps: int = 20
) -> ControlModel:
    """`carried_load` without constraints: the angles are functions of the load's place."""
    q, v = coordinates("x", "y")
    torque = ca.SX.sym("torque", 4)
    angles = arm_angles(q)
    arms, _ = arms_lagrangian(angles, q, v)
    lagrangian = arms + LOAD_MASS / 2 * ca.sumsqr(v) - LOAD_MASS * GRAVITY * q[1]
    force = ca.jtimes(angles, q, joint_forces(torque), True)
    phase = Phase(
        System(q, v, lagrangian, force=force, control=torque), gauss(4), 1.0, steps, ca.sumsqr(torque),
        start=dict(q=list(here), v=[0, 0]), end=dict(q=list(there), v=[0, 0]),
    )  # fmt: skip
    known = (tuple(here), tuple(there)) == ((-0.2, 0.45), (0.25, 0.75))
    return ControlModel(
        name="carried_load_reduced", phases=(phase,), cost=100.612419644055 if known else None,
        claim="The closed loop's cost by the inverse kinematics of the arms.",
        source="Murray, Li, Sastry, A Mathematical Introduction to Robotic Manipulation, §6.5: closed kinematic chains",
    )  # fmt: skip


def hovercraft(target: Sequence[float] = (1.0, 1.0, np.pi / 2), duration: float = 3.0, steps: int = 30) -> ControlModel:
    """Hovercraft (m = 1, J = 0.1) with a thruster behind: thrust along and across at distance 0.2, least ∫ |u|² dt."""
    q, v = coordinates("x", "y", "theta")
    u = ca.SX.sym("u", 2)
    c, s = ca.cos(q[2]), ca.sin(q[2])
    force = ca.vertcat(u[0] * c - u[1] * s, u[0] * s + u[1] * c, -0.2 * u[1])
    system = System(q, v, ca.sumsqr(v[:2]) / 2 + 0.05 * v[2] ** 2, force=force, control=u)
    phase = Phase(
        system, gauss(4), duration, steps, ca.sumsqr(u), start=dict(q=[0, 0, 0], v=[0, 0, 0]),
        end=dict(q=list(target), v=[0, 0, 0]),
    )  # fmt: skip
    known = (tuple(target), duration) == ((1.0, 1.0, np.pi / 2), 3.0)
    return ControlModel(
        name="hovercraft", phases=(phase,), cost=8.073419682023 if known else None,
        claim="Two forces move three coordinates: it turns and shifts sideways at the same time.",
        source="Junge, Marsden, Ober-Blöbaum, Discrete mechanics and optimal control, IFAC 2005, §5: the hovercraft",
    )  # fmt: skip

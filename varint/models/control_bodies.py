"""Ready optimal control problems of bodies that are held together or float: two arms with a
load, a hovercraft.
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np

from varint.control.links import Link
from varint.control.phase import Phase
from varint.models.control import ControlModel
from varint.rules.rule import gauss, lobatto
from varint.scene.free import free
from varint.scene.system import System, coordinates

BASES = (np.array([-0.6, 0.0]), np.array([0.6, 0.0]))  # m: shoulders of the two arms
GRIP = 0.2  # m: half the width of the load
LINK, LINK_MASS, LOAD_MASS, GRAVITY = 0.5, 1.0, 2.0, 9.81


def arms_lagrangian(angles: ca.SX, q: ca.SX, v: ca.SX) -> tuple[ca.SX, list[ca.SX]]:
    """L of two arms of two uniform rods each, in four angles from the horizontal, and the places
    of the hands.
    """
    lagrangian, hands = ca.SX(0), []
    for side, base in enumerate(BASES):
        end = ca.SX(ca.DM(base))
        for angle in (angles[2 * side], angles[2 * side + 1]):
            rod = LINK * ca.vertcat(ca.cos(angle), ca.sin(angle))
            middle, end = end + rod / 2, end + rod
            lagrangian += (
                LINK_MASS / 2 * ca.sumsqr(ca.jtimes(middle, q, v)) - LINK_MASS * GRAVITY * middle[1]
            )
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
    here: Sequence[float] = (-0.2, 0.45),
    there: Sequence[float] = (0.25, 0.75),
    steps: int = 20,
    stages: int = 4,
) -> ControlModel:
    """Two arms of two links carry a load together: a closed loop with four motors, least ∫
    |torques|² dt.
    """
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
        system,
        lobatto(stages),
        1.0,
        steps,
        ca.sumsqr(torque),
        start=dict(q=ends[0], v=[0] * 6),
        end=dict(q=ends[1], v=[0] * 6),
    )
    known = (tuple(here), tuple(there)) == ((-0.2, 0.45), (0.25, 0.75))
    return ControlModel(
        name="carried_load",
        phases=(phase,),
        cost=100.612419644055 if known else None,
        claim=(
            "The cost in six coordinates with four constraints is that in the load's two "
            "coordinates alone."
        ),
        source=(
            "Murray, Li, Sastry, A Mathematical Introduction to Robotic Manipulation, §6.5: "
            "closed kinematic chains"
        ),
    )


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
        System(q, v, lagrangian, force=force, control=torque),
        gauss(4),
        1.0,
        steps,
        ca.sumsqr(torque),
        start=dict(q=list(here), v=[0, 0]),
        end=dict(q=list(there), v=[0, 0]),
    )
    known = (tuple(here), tuple(there)) == ((-0.2, 0.45), (0.25, 0.75))
    return ControlModel(
        name="carried_load_reduced",
        phases=(phase,),
        cost=100.612419644055 if known else None,
        claim="The closed loop's cost by the inverse kinematics of the arms.",
        source=(
            "Murray, Li, Sastry, A Mathematical Introduction to Robotic Manipulation, §6.5: "
            "closed kinematic chains"
        ),
    )


def hovercraft(
    target: Sequence[float] = (1.0, 1.0, np.pi / 2), duration: float = 3.0, steps: int = 30
) -> ControlModel:
    """Hovercraft (m = 1, J = 0.1) with a thruster behind: thrust along and across at distance
    0.2, least ∫ |u|² dt.
    """
    q, v = coordinates("x", "y", "theta")
    u = ca.SX.sym("u", 2)
    c, s = ca.cos(q[2]), ca.sin(q[2])
    force = ca.vertcat(u[0] * c - u[1] * s, u[0] * s + u[1] * c, -0.2 * u[1])
    system = System(q, v, ca.sumsqr(v[:2]) / 2 + 0.05 * v[2] ** 2, force=force, control=u)
    phase = Phase(
        system,
        gauss(4),
        duration,
        steps,
        ca.sumsqr(u),
        start=dict(q=[0, 0, 0], v=[0, 0, 0]),
        end=dict(q=list(target), v=[0, 0, 0]),
    )
    known = (tuple(target), duration) == ((1.0, 1.0, np.pi / 2), 3.0)
    return ControlModel(
        name="hovercraft",
        phases=(phase,),
        cost=8.073419682023 if known else None,
        claim="Two forces move three coordinates: it turns and shifts sideways at the same time.",
        source=(
            "Junge, Marsden, Ober-Blöbaum, Discrete mechanics and optimal control, IFAC 2005, §5: "
            "the hovercraft"
        ),
    )


def free_floating_robot(
    target: Sequence[float] = (4.0, 4.0, 0.0), duration: float = 5.0
) -> ControlModel:
    """Robot in the plane (M = 10, I = 12) with two pairs of thrusters at arm 5, least ½ ∫ Σ u²
    dt.
    """
    q, v = coordinates("x", "y", "theta")
    u = ca.SX.sym("u", 4)
    along, across = u[0] + u[2], u[1] + u[3]
    c, s = ca.cos(q[2]), ca.sin(q[2])
    force = ca.vertcat(
        along * c - across * s, along * s + across * c, 5 * (u[0] - u[2] - u[1] + u[3])
    )
    system = System(q, v, 5 * ca.sumsqr(v[:2]) + 6 * v[2] ** 2, force=force, control=u)
    phase = Phase(
        system,
        gauss(3),
        duration,
        20,
        ca.sumsqr(u) / 2,
        start=dict(q=[0, 0, 0], v=[0, 0, 0]),
        end=dict(q=list(target), v=[0, 0, 0]),
    )
    straight = target[2] == 0
    cost = 3 * 100 * (target[0] ** 2 + target[1] ** 2) / duration**3 if straight else None
    return ControlModel(
        name="free_floating_robot",
        phases=(phase,),
        cost=cost,
        claim="Without turning it moves as a point: J = 3 M² d²/T³ = 76.8.",
        source="PROPT user's guide, Free floating robot, after dyn.Opt example 6b",
    )


def walker(stride: float = 0.5, steps: int = 20) -> ControlModel:
    """Two stiff legs on a hip walk periodically with least ∫ |torques|² dt: stance, impact,
    change of legs.
    """
    torque = ca.SX.sym("torque", 2)
    q, v = coordinates("x", "y", "stance", "swing")

    def along(angle: ca.SX, part: float) -> ca.SX:
        return q[:2] + part * ca.vertcat(ca.sin(angle), -ca.cos(angle))

    lagrangian = ca.SX(0)
    for mass, place in ((10, q[:2]), (5, along(q[2], 0.5)), (5, along(q[3], 0.5))):
        lagrangian += mass / 2 * ca.sumsqr(ca.jtimes(place, q, v)) - mass * 9.81 * place[1]
    force = ca.vertcat(0, 0, torque[1] - torque[0], torque[0])
    system = System(q, v, lagrangian, constraint=along(q[2], 1), force=force, control=torque)
    foot, lean = along(q[3], 1), np.arcsin(stride / 2)

    def guess(t: float) -> list[float]:
        angle = lean * (1 - t / 0.4)
        return [-np.sin(angle), np.cos(angle), angle, -angle]

    phase = Phase(
        system,
        lobatto(3),
        free(0.8, 0.3, 1.5),
        steps,
        ca.sumsqr(torque),
        guess=dict(q=guess),
        end=dict(bounds=[(stride, foot[0], stride)]),
    )
    swap = ca.vertcat(q[0] - foot[0], q[1] - foot[1], q[3], q[2])
    step = Link(0, 0, contact=foot[1], sticks=foot[0], relabel=swap, time=False)
    return ControlModel(
        name="walker",
        phases=(phase,),
        links=(step,),
        cost=None,
        claim=(
            "The gait repeats itself after the impact, whose loss of energy the torques give back."
        ),
        source=(
            "Goswami, Thuilot, Espiau, International Journal of Robotics Research 17 (1998) 1282"
        ),
    )


def falling_cat(turn: float = 0.6, duration: float = 4.0) -> ControlModel:
    """Satellite with two arms turned by moving the arms around and back, with least ∫ |torques|²
    dt.
    """
    q, v = coordinates("body", "left", "right")
    torque = ca.SX.sym("torque", 2)
    kinetic = 1.5 * v[0] ** 2 / 2
    for side, angle in ((-1, q[0] + q[1]), (1, q[0] + q[2])):
        place = side * 0.6 * ca.vertcat(ca.cos(q[0]), ca.sin(q[0])) + side * ca.vertcat(
            ca.cos(angle), ca.sin(angle)
        )
        kinetic += ca.sumsqr(ca.jtimes(place, q, v)) / 2
    system = System(q, v, kinetic, force=ca.vertcat(0, torque), control=torque)

    def guess(t: float) -> list[float]:
        s = 2 * np.pi * t / duration
        return [turn * t / duration, 1.2 * (1 - np.cos(s)), 1.2 * np.sin(s)]

    phase = Phase(
        system,
        gauss(3),
        duration,
        40,
        ca.sumsqr(torque),
        start=dict(q=[0, 0, 0], v=[0, 0, 0]),
        end=dict(q=[turn, 0, 0], v=[0, 0, 0]),
        guess=dict(q=guess),
        bounds=[(-2.5, q[1], 2.5), (-2.5, q[2], 2.5)],
    )
    return ControlModel(
        name="falling_cat",
        phases=(phase,),
        cost=30.671493472396 if (turn, duration) == (0.6, 4.0) else None,
        claim="The body turns although the angular momentum stays zero to round-off.",
        source=(
            "Montgomery, Gauge theory of the falling cat, Fields Institute Communications 1 "
            "(1993) 193"
        ),
    )

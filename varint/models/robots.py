"""Machines with controls as generalised forces: cart-pole, acrobot, two-link arm."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca

from varint.models.model import Model, energy
from varint.scene.parameters import Parameters
from varint.scene.system import System, coordinates


def cart_pole(
    q0: Sequence[float] = (0.0, 0.5),
    v0: Sequence[float] = (0.0, 0.0),
    M: float = 1.0,
    m: float = 0.3,
    length: float = 0.5,
    g: float = 9.81,
) -> Model:
    """Cart (M) with a hanging pole (m, ℓ), pushed by the control ``push``; θ from the downward
    vertical.
    """
    c = Parameters(M=M, m=m, length=length, g=g)
    q, v = coordinates("x", "theta")
    push = ca.SX.sym("push")
    kinetic = (c.M + c.m) * v[0] ** 2 / 2 + c.m * c.length * v[0] * v[1] * ca.cos(q[1])
    kinetic += c.m * c.length**2 * v[1] ** 2 / 2
    system = System(
        q,
        v,
        kinetic + c.m * c.g * c.length * ca.cos(q[1]),
        force=ca.vertcat(push, 0),
        control=push,
        params=c,
    )
    return Model(
        name="cart_pole",
        system=system,
        q0=q0,
        v0=v0,
        duration=10.0,
        h=0.01,
        invariants=energy(system) | {"p_x": system.momentum[0]},
        claim="Left alone it keeps its energy and p_x; the push changes p_x by its time integral.",
        source="Kelly, SIAM Review 59 (2017) 849, §6",
    )


def _two_links(c: Parameters, q: ca.SX, v: ca.SX, hangs: bool) -> ca.SX:
    """L of two rods, the second angle counted from the first rod; y downwards along the first
    rod at rest.
    """
    first, second = q[0], q[0] + q[1]
    height1 = -c.centre[0] * ca.cos(first)
    height2 = -c.length[0] * ca.cos(first) - c.centre[1] * ca.cos(second)
    spot1 = c.centre[0] * ca.vertcat(ca.sin(first), -ca.cos(first))
    spot2 = c.length[0] * ca.vertcat(ca.sin(first), -ca.cos(first))
    spot2 += c.centre[1] * ca.vertcat(ca.sin(second), -ca.cos(second))
    kinetic = (
        sum(c.m[i] * ca.sumsqr(ca.jacobian(s, q) @ v) for i, s in enumerate((spot1, spot2))) / 2
    )
    kinetic += c.inertia[0] * v[0] ** 2 / 2 + c.inertia[1] * (v[0] + v[1]) ** 2 / 2
    return kinetic - (c.g * (c.m[0] * height1 + c.m[1] * height2) if hangs else 0)


def acrobot(
    q0: Sequence[float] = (0.5, 0.3),
    v0: Sequence[float] = (0.0, 0.0),
    m: Sequence[float] = (1.0, 1.0),
    length: Sequence[float] = (1.0, 1.0),
    centre: Sequence[float] = (0.5, 0.5),
    inertia: Sequence[float] = (0.083, 0.083),
    g: float = 9.81,
) -> Model:
    """Acrobot: two hanging links with a motor, the control ``torque``, at the elbow only."""
    c = Parameters(m=m, length=length, centre=centre, inertia=inertia, g=g)
    q, v = coordinates("shoulder", "elbow")
    torque = ca.SX.sym("torque")
    system = System(
        q, v, _two_links(c, q, v, True), force=ca.vertcat(0, torque), control=torque, params=c
    )
    return Model(
        name="acrobot",
        system=system,
        q0=q0,
        v0=v0,
        duration=10.0,
        h=0.01,
        invariants=energy(system),
        claim=(
            "Left alone it is a double pendulum of rods; the elbow's torque alone must swing it up."
        ),
        source="Spong, IEEE Control Systems 15 (1995) 49",
    )


def two_link_arm(
    q0: Sequence[float] = (0.3, 0.8),
    v0: Sequence[float] = (0.5, -0.4),
    m: Sequence[float] = (1.0, 1.0),
    length: Sequence[float] = (0.5, 0.5),
    centre: Sequence[float] = (0.25, 0.25),
    inertia: Sequence[float] = (0.02, 0.02),
) -> Model:
    """Arm of two links in a horizontal plane with a motor at each joint (controls ``torque1``,
    ``torque2``).
    """
    c = Parameters(m=m, length=length, centre=centre, inertia=inertia)
    q, v = coordinates("shoulder", "elbow")
    torques = ca.vertcat(ca.SX.sym("torque1"), ca.SX.sym("torque2"))
    system = System(q, v, _two_links(c, q, v, False), force=torques, control=torques, params=c)
    return Model(
        name="two_link_arm",
        system=system,
        q0=q0,
        v0=v0,
        duration=10.0,
        h=0.01,
        invariants=energy(system) | {"angular momentum": system.momentum[0]},
        claim=(
            "Left alone it keeps its angular momentum, as the direction of the shoulder does not "
            "matter."
        ),
        source=(
            "Murray, Li & Sastry, A Mathematical Introduction to Robotic Manipulation, 1994, 4.2"
        ),
    )

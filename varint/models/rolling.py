"""Non-holonomic scenes, A(q) v = 0 by Lagrange–d'Alembert: knife edge, sleigh, disc."""

from __future__ import annotations

import casadi as ca
import numpy as np

from varint.models.model import Model, energy
from varint.scene.parameters import Parameters
from varint.scene.system import System, coordinates


def knife_edge(incline: float = 0.4, spin: float = 1.3, gravity: float = 9.81) -> Model:
    """Knife edge on an incline, ẋ sin φ = ẏ cos φ: it turns evenly and runs on a cycloid, across
    the slope.
    """
    c = Parameters(down=gravity * np.sin(incline), inertia=0.5)
    q, v = coordinates("x", "y", "phi")
    blade = ca.horzcat(ca.sin(q[2]), -ca.cos(q[2]), 0)
    lagrangian = (ca.sumsqr(v[:2]) + c.inertia * v[2] ** 2) / 2 + c.down * q[0]
    system = System(q, v, lagrangian, nonholonomic=blade, params=c)
    size = gravity * np.sin(incline) / (2 * spin**2)

    def exact(t):
        a = spin * t
        q = np.stack([size * np.sin(a) ** 2, size * (a - np.sin(2 * a) / 2), a], -1)
        return q, np.stack(
            [size * spin * np.sin(2 * a), 2 * size * spin * np.sin(a) ** 2, np.full_like(a, spin)],
            -1,
        )

    return Model(
        name="knife_edge",
        system=system,
        q0=np.zeros(3),
        v0=[0, 0, spin],
        duration=10.0,
        h=0.01,
        exact=exact,
        claim=(
            "x = (g sin α/2ω²) sin² ωt, y = (g sin α/2ω²)(ωt − ½ sin 2ωt): it does not run "
            "downhill."
        ),
        source="Bloch, Nonholonomic Mechanics and Control, 2nd ed., §1.6.",
    )


def chaplygin_sleigh(
    arm: float = 0.7, inertia: float = 0.3, speed: float = 0.4, turn: float = 1.0
) -> Model:
    """Chaplygin sleigh: a blade at (x, y), the centre of mass an arm ahead; v = V tanh(κVt + c)
    ends up straight.
    """
    c = Parameters(arm=arm, inertia=inertia)
    q, v = coordinates("x", "y", "phi")
    cos, sin = ca.cos(q[2]), ca.sin(q[2])
    kinetic = (
        (v[0] - c.arm * sin * v[2]) ** 2 + (v[1] + c.arm * cos * v[2]) ** 2 + c.inertia * v[2] ** 2
    )
    system = System(q, v, kinetic / 2, nonholonomic=ca.horzcat(-sin, cos, 0), params=c)
    return Model(
        name="chaplygin_sleigh",
        system=system,
        q0=np.zeros(3),
        v0=[speed, 0, turn],
        duration=6.0,
        h=0.01,
        claim=(
            "Energy is kept and yet the motion has an attractor: the speed along the blade tends "
            "to √(2E/m)."
        ),
        source="Bloch, Nonholonomic Mechanics and Control, 2nd ed., §1.7.",
    )


def rolling_disc(roll: float = 2.0, turn: float = 0.5, radius: float = 1.0) -> Model:
    """Upright disc that rolls without slipping: ẋ = R θ̇ cos φ, ẏ = R θ̇ sin φ; it runs on a
    circle.
    """
    c = Parameters(radius=radius)
    q, v = coordinates("x", "y", "roll", "heading")
    slip = ca.vertcat(
        ca.horzcat(1, 0, -c.radius * ca.cos(q[3]), 0), ca.horzcat(0, 1, -c.radius * ca.sin(q[3]), 0)
    )
    lagrangian = (ca.sumsqr(v[:2]) + c.radius**2 * (v[2] ** 2 / 2 + v[3] ** 2 / 4)) / 2
    system = System(q, v, lagrangian, nonholonomic=slip, params=c)

    def exact(t):
        size, a, one = radius * roll / turn, turn * t, np.ones_like(t)
        q = np.stack([size * np.sin(a), size * (1 - np.cos(a)), roll * t, a], -1)
        return q, np.stack(
            [size * turn * np.cos(a), size * turn * np.sin(a), roll * one, turn * one], -1
        )

    return Model(
        name="rolling_disc",
        system=system,
        q0=np.zeros(4),
        v0=[radius * roll, 0, roll, turn],
        duration=10.0,
        h=0.02,
        claim="θ̇ and φ̇ are constant, the path is a circle of radius R θ̇/φ̇.",
        exact=exact,
        source="Bloch, Nonholonomic Mechanics and Control, 2nd ed., §1.4.",
        invariants=energy(system),
    )

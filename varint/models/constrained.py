"""Scenes held by rods, strings and wires, with the reaction as multiplier: pendulums, Atwood
machines, chain, wire.
"""

from __future__ import annotations

from itertools import pairwise

import casadi as ca
import numpy as np

from varint.models.model import Model, energy
from varint.models.pendulums import swing
from varint.scene.parameters import Parameters
from varint.scene.system import System, coordinates, time


def pendulum_cartesian(
    length: float = 1.0, gravity: float = 9.81, theta0: float = 2.0, thetadot0: float = 0.0
) -> Model:
    """Pendulum in Cartesian coordinates, L = ½ m (ẋ² + ẏ²) − m g y with x² + y² = ℓ²; the
    tension is −2 ℓ λ.
    """
    c = Parameters(mass=1.0, length=length, gravity=gravity)
    q, v = coordinates("x", "y")
    lagrangian = c.mass * (ca.sumsqr(v) / 2 - c.gravity * q[1])
    system = System(q, v, lagrangian, constraint=ca.sumsqr(q) - c.length**2, params=c)

    def place(theta, thetadot):
        arm = length * np.stack([np.sin(theta), -np.cos(theta)], -1)
        return arm, length * np.stack([np.cos(theta), np.sin(theta)], -1) * np.asarray(thetadot)[
            ..., None
        ]

    def exact(t):
        return place(*swing(t, theta0, thetadot0, np.sqrt(gravity / length)))

    q0, v0 = place(theta0, thetadot0)
    return Model(
        name="pendulum_cartesian",
        system=system,
        q0=q0,
        v0=v0,
        duration=10.0,
        h=0.01,
        claim=(
            "The motion is that of the angle; the tension −2 ℓ λ is m g cos θ + m ℓ θ̇² along the "
            "whole path."
        ),
        source="Landau & Lifshitz, Mechanics, §11; Hairer & Wanner, Solving ODEs II, VII.1.",
        exact=exact,
        invariants=energy(system),
    )


def spherical_pendulum_cartesian(
    gravity: float = 9.81, theta0: float = 1.0, phidot0: float = 2.5
) -> Model:
    """Spherical pendulum in Cartesian coordinates, |r|² = ℓ²; no pole is singular."""
    c = Parameters(length=1.0, gravity=gravity)
    q, v = coordinates("x", "y", "z")
    system = System(
        q, v, ca.sumsqr(v) / 2 - c.gravity * q[2], constraint=ca.sumsqr(q) - c.length**2, params=c
    )
    turn = {"angular momentum about z": q[0] * v[1] - q[1] * v[0]}
    return Model(
        name="spherical_pendulum_cartesian",
        system=system,
        duration=10.0,
        h=0.01,
        q0=[np.sin(theta0), 0, -np.cos(theta0)],
        v0=[0, np.sin(theta0) * phidot0, 0],
        claim=(
            "Energy and the angular momentum about the vertical are kept; the height oscillates "
            "between two circles."
        ),
        source="Landau & Lifshitz, Mechanics, §14, problem 1.",
        invariants=energy(system) | turn,
    )


def atwood(m1: float = 3.0, m2: float = 2.0, gravity: float = 9.81) -> Model:
    """Atwood's machine, x₁ + x₂ = c with x measured downwards: λ = −2 m₁ m₂ g/(m₁ + m₂), minus
    the tension.
    """
    c = Parameters(m1=m1, m2=m2, gravity=gravity, rope=5.0)
    q, v = coordinates("x1", "x2")
    kinetic = (c.m1 * v[0] ** 2 + c.m2 * v[1] ** 2) / 2
    weights = c.gravity * (c.m1 * q[0] + c.m2 * q[1])
    system = System(q, v, kinetic + weights, constraint=q[0] + q[1] - c.rope, params=c)
    fall = (m1 - m2) * gravity / (m1 + m2)

    def exact(t):
        x, speed = 1.0 - 0.3 * t + fall * t**2 / 2, -0.3 + fall * t
        return np.stack([x, 5.0 - x], -1), np.stack([speed, -speed], -1)

    return Model(
        name="atwood",
        system=system,
        q0=[1.0, 4.0],
        v0=[-0.3, 0.3],
        duration=2.0,
        h=0.1,
        claim="ẍ₁ = (m₁ − m₂) g/(m₁ + m₂) and the tension is 2 m₁ m₂ g/(m₁ + m₂), exactly.",
        source="Goldstein, Classical Mechanics, 3rd ed., §1.6.",
        exact=exact,
        invariants=energy(system),
    )


def double_atwood(
    m1: float = 4.0, m2: float = 2.0, m3: float = 1.0, gravity: float = 9.81
) -> Model:
    """A pulley instead of one weight carries two more: x₁ + p = ℓ₁, (x₂ − p) + (x₃ − p) = ℓ₂,
    the pulley massless.
    """
    c = Parameters(m1=m1, m2=m2, m3=m3, gravity=gravity)
    q, v = coordinates("x1", "x2", "x3", "pulley")
    masses = ca.vertcat(c.m1, c.m2, c.m3)
    lagrangian = ca.dot(masses, v[:3] ** 2) / 2 + c.gravity * ca.dot(masses, q[:3])
    ropes = ca.vertcat(q[0] + q[3] - 3, q[1] + q[2] - 2 * q[3] - 2)
    system = System(q, v, lagrangian, constraint=ropes, params=c)
    upper = 8 * m1 * m2 * m3 * gravity / (m1 * (m2 + m3) + 4 * m2 * m3)
    a = np.array([gravity - upper / m1, gravity - upper / 2 / m2, gravity - upper / 2 / m3])
    a = np.append(a, -a[0])
    q0 = np.array([1.0, 3.0, 3.0, 2.0])

    def exact(t):
        return q0 + np.outer(t**2 / 2, a), np.outer(t, a)

    return Model(
        name="double_atwood",
        system=system,
        q0=q0,
        v0=np.zeros(4),
        duration=1.0,
        h=0.1,
        claim=(
            "Accelerations are constant; the upper rope carries 8 m₁m₂m₃ g/(m₁(m₂ + m₃) + 4 "
            "m₂m₃), the lower half."
        ),
        source="Goldstein, Classical Mechanics, 3rd ed., §1.6; force balance.",
        exact=exact,
        invariants=energy(system),
    )


def chain_rods(links: int = 10, gravity: float = 9.81) -> Model:
    """Chain of unit masses and unit rods hung up at the origin, released straight and level."""
    c = Parameters(gravity=gravity)
    q, v = coordinates(*(f"{axis}{i}" for i in range(1, links + 1) for axis in "xy"))
    points = [ca.SX.zeros(2, 1), *ca.vertsplit(q, 2)]
    rods = ca.vertcat(*(ca.sumsqr(b - a) - 1 for a, b in pairwise(points)))
    system = System(
        q, v, ca.sumsqr(v) / 2 - c.gravity * ca.sum1(q[1::2]), constraint=rods, params=c
    )
    return Model(
        name="chain_rods",
        system=system,
        duration=2.0,
        h=0.005,
        v0=np.zeros(2 * links),
        q0=np.stack([np.arange(1, links + 1), np.zeros(links)], -1).ravel(),
        claim=(
            "The motion is that of the chain in angles; at rest −2 λᵢ = (N − i + 1) g is the "
            "weight below rod i."
        ),
        source="Leimkuhler & Skeel, J. Comput. Phys. 112 (1994).",
        invariants=energy(system),
    )


def turning_wire(omega: float = 1.5, r0: float = 0.5, rdot0: float = -0.3) -> Model:
    """Bead on a straight wire that turns evenly in a plane, y cos Ωt − x sin Ωt = 0: the
    constraint depends on time.
    """
    c, t = Parameters(omega=omega), time()
    q, v = coordinates("x", "y")
    wire = q[1] * ca.cos(c.omega * t) - q[0] * ca.sin(c.omega * t)
    system = System(q, v, ca.sumsqr(v) / 2, constraint=wire, params=c, t=t)

    def exact(times):
        grows, falls = np.cosh(omega * times), np.sinh(omega * times)
        r, rdot = r0 * grows + rdot0 / omega * falls, r0 * omega * falls + rdot0 * grows
        along = np.stack([np.cos(omega * times), np.sin(omega * times)], -1)
        across = np.stack([-along[:, 1], along[:, 0]], -1)
        return r[:, None] * along, rdot[:, None] * along + (r * omega)[:, None] * across

    speed = ca.dot(v, ca.vertcat(ca.cos(c.omega * t), ca.sin(c.omega * t)))
    return Model(
        name="turning_wire",
        system=system,
        q0=[r0, 0],
        v0=[rdot0, omega * r0],
        duration=2.0,
        h=0.02,
        exact=exact,
        claim="r grows as r₀ cosh Ωt + (ṙ₀/Ω) sinh Ωt; the wire pushes with λ = 2 ṙ Ω.",
        source="Goldstein, Classical Mechanics, 3rd ed., §1.6.",
        invariants={"energy in the turning frame": (speed**2 - c.omega**2 * ca.sumsqr(q)) / 2},
    )

"""Rigid bodies by unit quaternion, |q|² = 1: no attitude is singular. The mass matrix is, along
q, and may be.
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np

from varint.errors import InputError
from varint.models.model import Model, energy
from varint.multibody.kinematics import body_rates as body_omega
from varint.multibody.rotations import quaternion_matrix as rotation
from varint.multibody.rotations import quaternion_rate
from varint.scene.parameters import Parameters
from varint.scene.system import System, coordinates


def _body(inertia: Sequence[float], weight: float) -> tuple[System, ca.SX]:
    """The system, and its angular momentum in space."""
    c = Parameters(inertia=inertia, weight=weight)
    q, v = coordinates("w", "x", "y", "z")
    omega, turned = body_omega(q, v), rotation(q)
    lagrangian = ca.dot(c.inertia, omega**2) / 2 - c.weight * turned[2, 2]
    return System(q, v, lagrangian, constraint=ca.sumsqr(q) - 1, params=c), ca.mtimes(
        turned, c.inertia * omega
    )


def free_body_quaternion(
    inertia: Sequence[float] = (1.0, 2.0, 3.0), omega0: Sequence[float] = (0.01, 1.0, 0.01)
) -> Model:
    """Free rigid body by unit quaternion, L = ½ Σ Iᵢ ωᵢ²; by default about its unstable axis
    (Dzhanibekov).
    """
    system, spin = _body(inertia, 0.0)
    q0 = np.array([1.0, 0.0, 0.0, 0.0])
    return Model(
        name="free_body_quaternion",
        system=system,
        q0=q0,
        v0=quaternion_rate(q0, omega0),
        duration=20.0,
        h=0.02,
        claim=(
            "All three components of the angular momentum in space stay to round-off; ω follows "
            "Euler's equations."
        ),
        source=(
            "Landau & Lifshitz, Mechanics, §37; Betsch & Siebert, Int. J. Numer. Meth. Engng 79 "
            "(2009)."
        ),
        invariants=energy(system) | {"angular momentum": spin},
    )


def heavy_top_quaternion(
    inertia: Sequence[float] = (1.0, 1.0, 0.5),
    weight: float = 1.0,
    theta0: float = 0.5,
    spin: float = 5.0,
) -> Model:
    """Heavy symmetric top with a fixed point by unit quaternion, V = w cos θ; it may pass the
    upright.
    """
    if inertia[0] != inertia[1]:
        raise InputError(
            f"a symmetric top has inertia[0] = inertia[1], got {tuple(inertia)}; others are "
            "models.heavy_rigid_body"
        )
    system, momentum = _body(inertia, weight)
    q0 = np.array([np.cos(theta0 / 2), np.sin(theta0 / 2), 0.0, 0.0])
    kept = {
        "angular momentum about the vertical": momentum[2],
        "spin": body_omega(system.q, system.v)[2],
    }
    return Model(
        name="heavy_top_quaternion",
        system=system,
        q0=q0,
        v0=quaternion_rate(q0, [0.0, 0.0, spin]),
        duration=10.0,
        h=0.01,
        claim=(
            "Energy, spin and the angular momentum about the vertical are kept; the axis nutates "
            "as by Euler angles."
        ),
        source="Landau & Lifshitz, Mechanics, §35.",
        invariants=energy(system) | kept,
    )

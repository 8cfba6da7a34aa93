"""Rigid bodies in Euler angles (φ, θ, ψ), z-x-z: free asymmetric body, heavy body, heavy
symmetric top.
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np

from varint.errors import InputError
from varint.models.gyration import euler_top, gyration
from varint.models.model import Model, energy
from varint.scene.parameters import Parameters
from varint.scene.system import System, coordinates

SINGULAR = 1e-8  # sin θ below which φ and ψ have no eight digits left


def body_rates(q: ca.SX, v: ca.SX) -> ca.SX:
    """Angular velocity (3,) along the body's axes from Euler angles q = (φ, θ, ψ) and their
    rates.
    """
    (_, theta, psi), (phidot, thetadot, psidot) = ca.vertsplit(q), ca.vertsplit(v)
    return ca.vertcat(
        phidot * ca.sin(theta) * ca.sin(psi) + thetadot * ca.cos(psi),
        phidot * ca.sin(theta) * ca.cos(psi) - thetadot * ca.sin(psi),
        phidot * ca.cos(theta) + psidot,
    )


def euler_rates(angles: np.ndarray, omega: np.ndarray) -> np.ndarray:
    """Rates (N, 3) of the Euler angles (N, 3) of a body with the angular velocity (N, 3) along its
    axes.

    Raises
    ------
    InputError
        If θ = 0 or π, where φ and ψ turn about one axis.
    """
    _, theta, psi = np.moveaxis(np.asarray(angles, dtype=float), -1, 0)
    if (np.abs(np.sin(theta)) < SINGULAR).any():
        raise InputError(
            "Euler angles are singular at θ = 0 and π: name the body's axes so that its third is "
            "not upright"
        )
    w1, w2, w3 = np.moveaxis(np.asarray(omega, dtype=float), -1, 0)
    phidot = (w1 * np.sin(psi) + w2 * np.cos(psi)) / np.sin(theta)
    return np.stack([phidot, w1 * np.cos(psi) - w2 * np.sin(psi), w3 - phidot * np.cos(theta)], -1)


def _rigid_body(inertia: Sequence[float], weight: float) -> tuple[System, ca.SX]:
    """The system, and its angular momentum along the body's axes."""
    c = Parameters(inertia=inertia, weight=weight)
    q, v = coordinates("phi", "theta", "psi")
    omega = body_rates(q, v)
    return System(
        q, v, ca.dot(c.inertia, omega**2) / 2 - c.weight * ca.cos(q[1]), params=c
    ), c.inertia * omega


def free_rigid_body(
    inertia: Sequence[float] = (1.0, 2.0, 3.0), omega0: Sequence[float] = (0.01, 1.0, 0.01)
) -> Model:
    """Free rigid body, L = ½ Σ Iᵢ ωᵢ², the space axes chosen with the angular momentum along z.

    Then ``cos θ = I₃ω₃/L`` and ``tan ψ = I₁ω₁/(I₂ω₂)``; θ stays away from its singular values.
    """
    system, spins = _rigid_body(inertia, 0.0)
    moments, omega = np.asarray(inertia, dtype=float), np.asarray(omega0, dtype=float)
    spin = moments * omega
    q0 = np.array(
        [0, np.arctan2(np.hypot(spin[0], spin[1]), spin[2]), np.arctan2(spin[0], spin[1])]
    )

    def exact(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        rates, swept, spun = euler_top(t, moments, omega)
        a, b, c = (moments * rates).T
        angles = np.stack([swept, np.arctan2(np.hypot(a, b), c), q0[2] + spun], -1)
        return angles, euler_rates(angles, rates)

    return Model(
        name="free_rigid_body",
        system=system,
        q0=q0,
        v0=euler_rates(q0, omega),
        duration=40.0,
        h=0.02,
        exact=exact,
        invariants=energy(system) | {"p_phi": system.momentum[0], "L²": ca.sumsqr(spins)},
        claim=(
            "Rotation about the middle axis is unstable: the body flips over and back "
            "(Dzhanibekov)."
        ),
        source="Landau & Lifshitz, Mechanics, §37",
    )


def heavy_rigid_body(
    inertia: Sequence[float] = (0.5, 0.9, 1.0),
    weight: float = 1.0,
    angles0: Sequence[float] = (0.3, 1.2, 0.4),
    omega0: Sequence[float] = (0.4, 1.1, 0.4),
) -> Model:
    """Asymmetric heavy body with its centre of mass on the third axis, L = ½ Σ Iᵢ ωᵢ² − w cos θ
    (chaotic).
    """
    system, _ = _rigid_body(inertia, weight)
    return Model(
        name="heavy_rigid_body",
        system=system,
        q0=angles0,
        v0=euler_rates(np.asarray(angles0), np.asarray(omega0)),
        duration=10.0,
        h=0.01,
        invariants=energy(system) | {"p_phi": system.momentum[0]},
        claim="Without the symmetry only the energy and p_φ are left, and the motion is chaotic.",
        source="E. Hairer & M. Hairer, GniCodes, rigidbody.f",
    )


def heavy_top(
    I1: float = 1.0,
    I3: float = 0.5,
    weight: float = 2.0,
    angles0: Sequence[float] = (0.0, 0.9, 0.0),
    rates0: Sequence[float] = (-0.6, 0.3, 10.0),
) -> Model:
    """Heavy symmetric top, L = ½ I₁ (θ̇² + φ̇² sin² θ) + ½ I₃ (ψ̇ + φ̇ cos θ)² − w cos θ, w = m
    g ℓ.
    """
    c = Parameters(I1=I1, I3=I3, weight=weight)
    q, v = coordinates("phi", "theta", "psi")
    kinetic = (
        c.I1 * (v[1] ** 2 + v[0] ** 2 * ca.sin(q[1]) ** 2) / 2
        + c.I3 * (v[2] + v[0] * ca.cos(q[1])) ** 2 / 2
    )
    system = System(q, v, kinetic - c.weight * ca.cos(q[1]), params=c)
    (phi0, theta0, psi0), (phidot0, thetadot0, psidot0) = angles0, rates0
    axial = psidot0 + phidot0 * np.cos(theta0)

    def exact(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        theta, thetadot, phi, phidot, slip = gyration(
            t, theta0, thetadot0, phidot0, I3 / I1 * axial, weight / I1
        )
        place = np.stack([phi0 + phi, theta, psi0 + axial * t - slip], -1)
        return place, np.stack([phidot, thetadot, axial - phidot * np.cos(theta)], -1)

    return Model(
        name="heavy_top",
        system=system,
        q0=angles0,
        v0=rates0,
        duration=10.0,
        h=0.01,
        exact=exact,
        invariants=energy(system) | {"p_phi": system.momentum[0], "p_psi": system.momentum[2]},
        claim="The axis nods between two angles while it precesses, with loops, cusps or waves.",
        source="Landau & Lifshitz, Mechanics, §35, problem 1",
    )

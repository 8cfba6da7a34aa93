"""Closed forms of turning bodies: the symmetric top and spherical pendulum, and the free body."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from varint.models.quadrature import PeriodicIntegral


def gyration(
    t: np.ndarray, theta0: float, thetadot0: float, phidot0: float, spin: float, weight: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Motion of L = ½ (θ̇² + φ̇² sin² θ) + s φ̇ cos θ − w cos θ.

    Here ``u = cos θ`` runs between two roots of a cubic, ``u̇² = (u − u₁)(u₂ − u) Q(u)``, and with
    ``u = ½(u₁ + u₂) + ½(u₂ − u₁) cos χ`` the phase advances by ``χ̇ = √Q`` (Landau & Lifshitz,
    Mechanics, §35).

    Parameters
    ----------
    t : array (N,)
        Times.
    theta0, thetadot0, phidot0 : float
        Start at t = 0.
    spin : float
        s, the axial angular momentum over the transverse inertia; 0 for a spherical pendulum.
    weight : float
        w; negative where θ is counted from the downward vertical.

    Returns
    -------
    theta, thetadot, phi, phidot, slip : array (N,)
        With φ(0) = 0 and slip = ∫₀ᵗ φ̇ cos θ dt, by which the body's own turning angle falls
        behind.
    """
    u0, sine2 = np.cos(theta0), np.sin(theta0) ** 2
    turn = phidot0 * sine2 + spin * u0  # p_φ
    energy = thetadot0**2 / 2 + phidot0**2 * sine2 / 2 + weight * u0
    cubic = [2 * weight, -2 * energy - spin**2, 2 * turn * spin - 2 * weight, 2 * energy - turn**2]
    roots = np.sort(np.roots(np.trim_zeros(cubic, "f")).real)
    low, high = (roots[-2:] if weight < 0 else roots[:2]).clip(-1, 1)
    if thetadot0 == 0:  # the start is a turning point: use it unrounded
        low, high = (u0, high) if abs(low - u0) < abs(high - u0) else (low, u0)
    middle, reach = (low + high) / 2, (high - low) / 2

    def pace(u: np.ndarray | float) -> np.ndarray:  # χ̇ = √Q, Q the cubic over (u − u₁)(u₂ − u)
        return np.sqrt(2 * energy + spin**2 - 2 * weight * (u + 2 * middle))

    def precession(u: np.ndarray) -> np.ndarray:
        return (turn - spin * u) / (1 - u**2)

    def height(chi: np.ndarray) -> np.ndarray:
        return middle + reach * np.cos(chi)

    clock = PeriodicIntegral(lambda chi: 1 / pace(height(chi)))
    swept = PeriodicIntegral(lambda chi: precession(height(chi)) / pace(height(chi)))
    slipped = PeriodicIntegral(
        lambda chi: precession(height(chi)) * height(chi) / pace(height(chi))
    )
    chi0 = np.arctan2(np.sin(theta0) * thetadot0 / pace(u0), u0 - middle)
    chi = clock.inverse(clock(chi0) + t)
    theta = np.arccos(height(chi))
    thetadot = reach * np.sin(chi) * pace(height(chi)) / np.sin(theta)
    return (
        theta,
        thetadot,
        swept(chi) - swept(chi0),
        precession(height(chi)),
        slipped(chi) - slipped(chi0),
    )


def euler_top(
    t: np.ndarray, inertia: np.ndarray, omega0: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Free rigid body: angular velocity along its axes, and its Euler angles φ, ψ about the angular
    momentum.

    With the axes named so that L² − 2 E I₂ has the sign of I₃ − I₂, ``ω = (A₁ cn, A₂ sn, A₃ dn)``
    (Landau & Lifshitz, Mechanics, §37); ``φ̇ = L (I₁ω₁² + I₂ω₂²)/(I₁²ω₁² + I₂²ω₂²)``.

    Parameters
    ----------
    t : array (N,)
        Times.
    inertia, omega0 : array (3,)
        Principal moments; angular velocity at t = 0, not along the third axis.

    Returns
    -------
    omega : array (N, 3)
        Angular velocity along the body's axes.
    phi, psi : array (N,)
        Angles turned since t = 0 about the angular momentum and about the third axis.
    """
    momentum = inertia * omega0
    order = np.argsort(inertia, kind="stable")
    middle = inertia[order[1]]
    if momentum @ momentum < momentum @ omega0 * middle:
        order = order[::-1]
    parity = np.linalg.det(np.eye(3)[order])
    (I1, I2, I3), (w1, w2, w3) = inertia[order], parity * omega0[order]
    # turning the signs of two components leaves Euler's equations as they are
    flip = -1.0 if w3 < 0 else 1.0
    inner = I2 * (I2 - I1) * w2**2 + I3 * (I3 - I1) * w3**2  # L² − 2 E I₁
    outer = I1 * (I3 - I1) * w1**2 + I2 * (I3 - I2) * w2**2  # 2 E I₃ − L²
    k2, rate = 0.0, 1.0
    sizes: np.ndarray = np.zeros(3)
    if inner != 0:  # no sphere
        k2 = (I2 - I1) * outer / ((I3 - I2) * inner)
        rate = np.sqrt((I3 - I2) * inner / (I1 * I2 * I3))
        sizes = np.sqrt(
            [outer / (I1 * (I3 - I1)), outer / (I2 * (I3 - I2)), inner / (I3 * (I3 - I1))]
        )
        sizes[1] *= np.sign(I3 - I2)

    def dn(chi: np.ndarray) -> np.ndarray:
        return np.sqrt(np.cos(chi) ** 2 + (1 - k2) * np.sin(chi) ** 2)

    def omega(chi: np.ndarray) -> np.ndarray:
        if inner == 0:
            return np.tile(omega0, (len(chi), 1))
        named = sizes * np.stack([flip * np.cos(chi), np.sin(chi), flip * dn(chi)], -1)
        rates = np.empty_like(named)
        rates[:, order] = parity * named
        return rates

    total = np.linalg.norm(momentum)

    def precession(chi: np.ndarray) -> np.ndarray:
        w = omega(chi)
        return (
            total * (inertia[:2] * w[:, :2] ** 2).sum(-1) / ((inertia[:2] * w[:, :2]) ** 2).sum(-1)
        )

    def spinning(chi: np.ndarray) -> np.ndarray:
        return omega(chi)[:, 2] * (1 - precession(chi) * inertia[2] / total)

    def per_phase(f: Callable[[np.ndarray], np.ndarray], chi: np.ndarray) -> np.ndarray:
        return f(chi) / (rate * dn(chi))

    chi0 = np.arctan2(w2 / sizes[1], flip * w1 / sizes[0]) if sizes[0] != 0 else 0.0
    clock, swept, spun = (
        PeriodicIntegral(partial(per_phase, f)) for f in (np.ones_like, precession, spinning)
    )
    chi = clock.inverse(clock(chi0) + t)
    return omega(chi), swept(chi) - swept(chi0), spun(chi) - spun(chi0)

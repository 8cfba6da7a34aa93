"""Beads on turning wires and hoops, a block on a wedge, the swinging Atwood machine."""

from __future__ import annotations

import casadi as ca
import numpy as np

from varint.models.model import Model, energy
from varint.models.quadrature import PeriodicIntegral
from varint.scene.parameters import Parameters
from varint.scene.system import System, coordinates


def rotating_hoop(
    theta0: float = 0.6,
    thetadot0: float = 0.0,
    m: float = 1.0,
    R: float = 1.0,
    Omega: float = 5.0,
    g: float = 9.81,
) -> Model:
    """Bead on a hoop turning about its vertical diameter, L = ½ m R² (θ̇² + Ω² sin² θ) + m g R
    cos θ.
    """
    c = Parameters(m=m, R=R, Omega=Omega, g=g)
    q, v = coordinates("theta")
    kinetic = c.m * c.R**2 * (v**2 + c.Omega**2 * ca.sin(q) ** 2) / 2
    system = System(q, v, kinetic + c.m * c.g * c.R * ca.cos(q), params=c)
    return Model(
        name="rotating_hoop",
        system=system,
        q0=theta0,
        v0=thetadot0,
        duration=20.0,
        h=0.02,
        invariants=energy(system),
        claim=(
            "Above Ω² = g/R the lowest point is unstable and the bead swings about cos θ = g/(Ω² "
            "R)."
        ),
        source="Goldstein, Classical Mechanics, 2.7",
    )


def rotating_hoop_period(theta0: float, R: float, Omega: float, g: float) -> float:
    """Period of the bead of `rotating_hoop` released at rest, where it stays on one side of the
    hoop.

    With u = cos θ, ``u̇² = Ω² (1 − u²) (u − u₀) (2g/(RΩ²) − u₀ − u)``.

    Examples
    --------
    >>> import varint as vi
    >>> round(vi.models.rotating_hoop_period(0.6, R=1.0, Omega=5.0, g=9.81), 10)
    1.5308192473
    """
    start = np.cos(theta0)
    other = 2 * g / (R * Omega**2) - start
    middle, reach = (start + other) / 2, abs(start - other) / 2
    return PeriodicIntegral(
        lambda chi: 1 / (Omega * np.sqrt(1 - (middle + reach * np.cos(chi)) ** 2))
    ).period


def rotating_wire(
    r0: float = 0.5, rdot0: float = -0.3, m: float = 1.0, Omega: float = 1.5
) -> Model:
    """Bead on a straight wire turning in a horizontal plane, L = ½ m (ṙ² + Ω² r²)."""
    c = Parameters(m=m, Omega=Omega)
    q, v = coordinates("r")
    system = System(q, v, c.m * (v**2 + c.Omega**2 * q**2) / 2, params=c)

    def exact(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        cosh, sinh = np.cosh(Omega * t), np.sinh(Omega * t)
        return r0 * cosh + rdot0 / Omega * sinh, r0 * Omega * sinh + rdot0 * cosh

    return Model(
        name="rotating_wire",
        system=system,
        q0=r0,
        v0=rdot0,
        duration=4.0,
        h=0.02,
        invariants=energy(system),
        exact=exact,
        claim=(
            "The bead is flung out as cosh Ωt; not its energy but the Jacobi integral is conserved."
        ),
        source="Goldstein, Classical Mechanics, 1.6",
    )


def block_on_wedge(
    M: float = 3.0, m: float = 1.0, alpha: float = np.pi / 6, g: float = 9.81
) -> Model:
    """Block sliding a way s down a wedge (angle α) that slides on a floor, all without friction.

    L = ½ (M + m) Ẋ² + ½ m ṡ² + m Ẋ ṡ cos α + m g s sin α.
    """
    c = Parameters(M=M, m=m, alpha=alpha, g=g)
    q, v = coordinates("X", "s")
    kinetic = (
        (c.M + c.m) * v[0] ** 2 / 2 + c.m * v[1] ** 2 / 2 + c.m * v[0] * v[1] * ca.cos(c.alpha)
    )
    system = System(q, v, kinetic + c.m * c.g * q[1] * ca.sin(c.alpha), params=c)
    slide = (M + m) * g * np.sin(alpha) / (M + m * np.sin(alpha) ** 2)
    acceleration = np.array([-m * np.cos(alpha) / (M + m) * slide, slide])

    def exact(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return np.outer(t**2 / 2, acceleration), np.outer(t, acceleration)

    return Model(
        name="block_on_wedge",
        system=system,
        q0=[0, 0],
        v0=[0, 0],
        duration=2.0,
        h=0.1,
        invariants=energy(system) | {"p_X": system.momentum[0]},
        exact=exact,
        claim="s̈ = (M + m) g sin α / (M + m sin² α); the common momentum p_X stays zero.",
        source="Landau & Lifshitz, Mechanics, §7",
    )


def swinging_atwood(
    r0: float = 1.0,
    theta0: float = np.pi / 2,
    rdot0: float = 0.0,
    thetadot0: float = 0.0,
    mu: float = 3.0,
    m: float = 1.0,
    g: float = 9.81,
) -> Model:
    """Atwood machine whose lighter mass m swings, L = ½ (1 + μ) m ṙ² + ½ m r² θ̇² − μ m g r + m
    g r cos θ.
    """
    c = Parameters(mu=mu, m=m, g=g)
    q, v = coordinates("r", "theta")
    r, theta = ca.vertsplit(q)
    kinetic = (1 + c.mu) * v[0] ** 2 / 2 + r**2 * v[1] ** 2 / 2
    system = System(q, v, c.m * (kinetic - c.mu * c.g * r + c.g * r * ca.cos(theta)), params=c)
    kept = energy(system)
    if mu == 3.0:
        half = theta / 2
        turn = r**2 * v[1] * (v[0] * ca.cos(half) - r * v[1] / 2 * ca.sin(half))
        kept["Tufillaro's integral"] = turn + c.g * r**2 * ca.sin(half) * ca.cos(half) ** 2
    return Model(
        name="swinging_atwood",
        system=system,
        q0=[r0, theta0],
        v0=[rdot0, thetadot0],
        duration=10.0,
        h=0.002,
        invariants=kept,
        claim="At the mass ratio 3 a second integral exists and the motion is regular.",
        source="Tufillaro, Journal de Physique 47 (1986) 1111",
    )

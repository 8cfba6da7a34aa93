"""Pendulums in angles: plane, about an inclined axis, on a sliding support, spherical, double
and of many links.
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np

from varint.models.gyration import gyration
from varint.models.model import Model, energy
from varint.models.quadrature import PeriodicIntegral
from varint.scene.parameters import Parameters
from varint.scene.system import System, coordinates

# of the arithmetic-geometric mean, quadratically convergent: enough for 1 − |θ₀|/π = 1e-15
AGM_STEPS = 12


def swing(
    t: np.ndarray, theta0: float, v0: float, omega: float, mu: float = 0.0
) -> tuple[np.ndarray, np.ndarray]:
    """θ(t), θ̇(t) where ½ θ̇² (1 − μ cos² θ) − ω² cos θ is constant, librating or turning.

    With ``k sin φ = sin ½θ`` the libration is ``φ̇ = ω √(1 − k² sin² φ) / √(1 − μ cos² θ)``, smooth
    at the turning points; for μ = 0 this is Jacobi's amplitude (Landau & Lifshitz, Mechanics, §11).
    """
    half, turns = theta0 / 2, np.round(theta0 / (2 * np.pi))
    speed = v0 * _slowness(theta0, omega, mu) / 2
    k2 = np.sin(half) ** 2 + speed**2
    if k2 > 1:
        clock, sign = _turning_clock(k2, omega, mu), np.sign(v0)
        theta = sign * clock.inverse(clock(sign * theta0) + t)
        return theta, sign * 2 * np.sqrt(k2 - np.sin(theta / 2) ** 2) / _slowness(theta, omega, mu)
    clock = _libration_clock(k2, omega, mu)
    phi = clock.inverse(clock(np.arctan2(np.sin(half - np.pi * turns), speed)) + t)
    theta = _libration_angle(phi, k2)
    return theta + 2 * np.pi * turns, 2 * np.sqrt(k2) * np.cos(phi) / _slowness(theta, omega, mu)


def swing_period(theta0: float, v0: float, omega: float, mu: float = 0.0) -> float:
    """Period of `swing`: of a libration, or of one full turn."""
    k2 = np.sin(theta0 / 2) ** 2 + (v0 * _slowness(theta0, omega, mu) / 2) ** 2
    return (_turning_clock if k2 > 1 else _libration_clock)(k2, omega, mu).period


def _slowness(theta: np.ndarray | float, omega: float, mu: float) -> np.ndarray:
    return np.sqrt(1 - mu * np.cos(theta) ** 2) / omega


def _libration_angle(phi: np.ndarray, k2: float) -> np.ndarray:
    return 2 * np.arctan2(
        np.sqrt(k2) * np.sin(phi), np.sqrt(np.cos(phi) ** 2 + (1 - k2) * np.sin(phi) ** 2)
    )


def _libration_clock(k2: float, omega: float, mu: float) -> PeriodicIntegral:
    return PeriodicIntegral(
        lambda phi: (
            _slowness(_libration_angle(phi, k2), omega, mu)
            / np.sqrt(np.cos(phi) ** 2 + (1 - k2) * np.sin(phi) ** 2)
        )
    )


def _turning_clock(k2: float, omega: float, mu: float) -> PeriodicIntegral:
    return PeriodicIntegral(
        lambda theta: _slowness(theta, omega, mu) / (2 * np.sqrt(k2 - np.sin(theta / 2) ** 2))
    )


def pendulum_period(amplitude: float, omega: float) -> float:
    """Period T = 2π / (ω agm(1, cos ½θ₀)) of a pendulum released at rest at the angle θ₀ (rad).

    Parameters
    ----------
    amplitude : float
        θ₀, between −π and π.
    omega : float
        Frequency of small oscillations, √(g/ℓ).

    Examples
    --------
    >>> import varint as vi
    >>> round(vi.models.pendulum_period(2.0, 1.0), 10)
    8.3497529269
    """
    a, b = 1.0, float(np.cos(amplitude / 2))
    for _ in range(AGM_STEPS):
        a, b = (a + b) / 2, float(np.sqrt(a * b))
    return 2 * np.pi / (omega * a)


def pendulum(
    theta0: float = 2.0,
    thetadot0: float = 0.0,
    m: float = 1.0,
    length: float = 1.0,
    g: float = 9.81,
) -> Model:
    """Plane pendulum, L = ½ m ℓ² θ̇² + m g ℓ cos θ, θ from the downward vertical."""
    c = Parameters(m=m, length=length, g=g)
    q, v = coordinates("theta")
    system = System(q, v, c.m * c.length**2 * v**2 / 2 + c.m * c.g * c.length * ca.cos(q), params=c)
    return Model(
        name="pendulum",
        system=system,
        q0=theta0,
        v0=thetadot0,
        duration=20.0,
        h=0.02,
        invariants=energy(system),
        exact=lambda t: swing(t, theta0, thetadot0, np.sqrt(g / length)),
        claim=(
            "The angle is Jacobi's amplitude function of time, at any amplitude and in full turns."
        ),
        source="Landau & Lifshitz, Mechanics, §11",
    )


def inclined_axis(
    theta0: float = 2.5,
    thetadot0: float = 0.0,
    inertia: float = 0.35,
    m: float = 1.5,
    distance: float = 0.4,
    alpha: float = np.pi / 6,
    g: float = 9.81,
) -> Model:
    """Rigid body about a fixed axis inclined by α from the vertical, L = ½ I θ̇² + m g d sin α
    cos θ.
    """
    c = Parameters(inertia=inertia, m=m, distance=distance, alpha=alpha, g=g)
    q, v = coordinates("theta")
    system = System(
        q, v, c.inertia * v**2 / 2 + c.m * c.g * c.distance * ca.sin(c.alpha) * ca.cos(q), params=c
    )
    omega = np.sqrt(m * g * distance * np.sin(alpha) / inertia)
    return Model(
        name="inclined_axis",
        system=system,
        q0=theta0,
        v0=thetadot0,
        duration=20.0,
        h=0.05,
        invariants=energy(system),
        exact=lambda t: swing(t, theta0, thetadot0, omega),
        claim="Small oscillations have ω² = m g d sin α / I, large ones follow elliptic functions.",
        source="Landau & Lifshitz, Mechanics, §32, problem 3",
    )


def sliding_support(
    theta0: float = 1.2,
    X0: float = 0.0,
    Xdot0: float = 0.5,
    thetadot0: float = 0.0,
    M: float = 2.0,
    m: float = 1.0,
    length: float = 1.0,
    g: float = 9.81,
) -> Model:
    """Pendulum (m, ℓ) on a support (M) that slides without friction.

    L = ½ (m + M) Ẋ² + ½ m (2 ℓ Ẋ θ̇ cos θ + ℓ² θ̇²) + m g ℓ cos θ; the momentum p_X of the cyclic X
    reduces it to ``½ θ̇² (1 − μ cos² θ) − (g/ℓ) cos θ = const`` with ``μ = m/(m + M)``.
    """
    c = Parameters(M=M, m=m, length=length, g=g)
    q, v = coordinates("X", "theta")
    kinetic = (c.m + c.M) * v[0] ** 2 / 2
    kinetic += c.m * (2 * v[0] * v[1] * c.length * ca.cos(q[1]) + c.length**2 * v[1] ** 2) / 2
    system = System(q, v, kinetic + c.m * c.g * c.length * ca.cos(q[1]), params=c)
    mu = m / (m + M)
    drift = Xdot0 + mu * length * thetadot0 * np.cos(theta0)

    def exact(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        theta, rate = swing(t, theta0, thetadot0, np.sqrt(g / length), mu)
        X = X0 + drift * t - mu * length * (np.sin(theta) - np.sin(theta0))
        return np.stack([X, theta], -1), np.stack(
            [drift - mu * length * rate * np.cos(theta), rate], -1
        )

    return Model(
        name="sliding_support",
        system=system,
        q0=[X0, theta0],
        v0=[Xdot0, thetadot0],
        duration=20.0,
        h=0.02,
        invariants=energy(system) | {"p_X": system.momentum[0]},
        exact=exact,
        claim="The horizontal momentum p_X is conserved; θ(t) and X(t) follow from one quadrature.",
        source="Landau & Lifshitz, Mechanics, §5 problem 2 and §14 problem 3",
    )


def sliding_support_period(theta0: float, M: float, m: float, length: float, g: float) -> float:
    """Period of θ of `sliding_support` released at rest at θ₀, by quadrature."""
    return swing_period(theta0, 0.0, np.sqrt(g / length), m / (m + M))


def spherical_pendulum(
    theta0: float = 1.0,
    phi0: float = 0.0,
    thetadot0: float = 0.0,
    phidot0: float = 2.5,
    m: float = 1.0,
    length: float = 1.0,
    g: float = 9.81,
) -> Model:
    """Spherical pendulum, L = ½ m ℓ² (θ̇² + sin² θ φ̇²) + m g ℓ cos θ, θ from the downward
    vertical.
    """
    c = Parameters(m=m, length=length, g=g)
    q, v = coordinates("theta", "phi")
    kinetic = c.m * c.length**2 * (v[0] ** 2 + ca.sin(q[0]) ** 2 * v[1] ** 2) / 2
    system = System(q, v, kinetic + c.m * c.g * c.length * ca.cos(q[0]), params=c)

    def exact(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        theta, thetadot, phi, phidot, _ = gyration(
            t, theta0, thetadot0, phidot0, spin=0.0, weight=-g / length
        )
        return np.stack([theta, phi0 + phi], -1), np.stack([thetadot, phidot], -1)

    return Model(
        name="spherical_pendulum",
        system=system,
        q0=[theta0, phi0],
        v0=[thetadot0, phidot0],
        duration=20.0,
        h=0.02,
        invariants=energy(system) | {"p_phi": system.momentum[1]},
        exact=exact,
        claim=(
            "The height is an elliptic function; the plane of swing advances by a fixed angle per "
            "period."
        ),
        source="Landau & Lifshitz, Mechanics, §14, problem 1",
    )


def _links(names: Sequence[str], m: ca.SX, length: ca.SX, params: Parameters) -> System:
    """Point masses on massless rods, one below the other, angles from the downward vertical."""
    q, v = coordinates(*names)
    kinetic, potential, speed, height = ca.SX(0), ca.SX(0), ca.SX.zeros(2), ca.SX(0)
    for i in range(len(names)):
        # velocities of the masses, not their products expanded: linear in the number of links
        speed += length[i] * v[i] * ca.vertcat(ca.cos(q[i]), ca.sin(q[i]))
        height -= length[i] * ca.cos(q[i])
        kinetic += m[i] * ca.sumsqr(speed) / 2
        potential += m[i] * params.g * height
    return System(q, v, kinetic - potential, params=params)


def double_pendulum(
    theta: Sequence[float] = (0.4, -0.3),
    thetadot: Sequence[float] = (0.0, 0.0),
    m: Sequence[float] = (1.0, 1.0),
    length: Sequence[float] = (1.0, 1.0),
    g: float = 9.81,
) -> Model:
    """Double pendulum with point masses, in the angles of its rods from the downward vertical."""
    c = Parameters(m=m, length=length, g=g)
    system = _links(("theta1", "theta2"), c.m, c.length, c)
    return Model(
        name="double_pendulum",
        system=system,
        q0=theta,
        v0=thetadot,
        duration=20.0,
        h=0.01,
        invariants=energy(system),
        claim=(
            "Small swings are regular, large ones chaotic; the energy error stays bounded in both."
        ),
        source="Landau & Lifshitz, Mechanics, §5, problem 1",
    )


def chain_pendulum(links: int = 5, theta0: float = 0.5, g: float = 9.81) -> Model:
    """Pendulum of N equal links of total length 1 and mass 1, released straight at the angle θ₀."""
    c = Parameters(m=np.full(links, 1 / links), length=np.full(links, 1 / links), g=g)
    system = _links([f"theta{i + 1}" for i in range(links)], c.m, c.length, c)
    return Model(
        name="chain_pendulum",
        system=system,
        q0=np.full(links, theta0),
        v0=np.zeros(links),
        duration=5.0,
        h=0.005,
        invariants=energy(system),
        claim=(
            "Any number of links: the frequencies of small swings are Laguerre's, ω² = N g x / ℓ "
            "with L_N(x) = 0."
        ),
        source="Bernoulli 1738; Braun, European Journal of Physics 24 (2003) 523",
    )

"""Oscillators of a few degrees of freedom: isotropic, coupled, Hénon–Heiles, Duffing, a pendulum on
a spring.
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np

from varint.models.model import Model, energy
from varint.models.quadrature import PeriodicIntegral
from varint.scene.parameters import Parameters
from varint.scene.system import System, coordinates


def isotropic_oscillator(
    q0: Sequence[float] = (1.0, -0.5, 0.2),
    v0: Sequence[float] = (0.3, 0.8, -0.4),
    m: float = 1.0,
    omega: float = 1.3,
) -> Model:
    """Oscillator in space, L = ½ m |v|² − ½ m ω² |q|²."""
    c = Parameters(m=m, omega=omega)
    q, v = coordinates("x", "y", "z")
    system = System(q, v, c.m * (ca.sumsqr(v) - c.omega**2 * ca.sumsqr(q)) / 2, params=c)
    start, speed = np.asarray(q0, dtype=float), np.asarray(v0, dtype=float)

    def exact(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        cosine, sine = np.cos(omega * t), np.sin(omega * t)
        x = np.outer(cosine, start) + np.outer(sine, speed / omega)
        return x, np.outer(cosine, speed) - np.outer(sine, omega * start)

    tensor = c.m * (v @ v.T + c.omega**2 * (q @ q.T)) / 2
    return Model(
        name="isotropic_oscillator",
        system=system,
        q0=q0,
        v0=v0,
        duration=50.0,
        h=0.05,
        exact=exact,
        invariants=energy(system)
        | {"angular momentum": ca.cross(q, system.momentum), "Fradkin's tensor": ca.vec(tensor)},
        claim="Every orbit is an ellipse about the centre with one period, 2π/ω.",
        source="Landau & Lifshitz, Mechanics, §23, problem 3",
    )


def coupled_oscillators(
    q0: Sequence[float] = (1.0, 0.0),
    v0: Sequence[float] = (0.0, 0.0),
    m: float = 1.0,
    k: float = 1.0,
    coupling: float = 0.1,
) -> Model:
    """Two equal oscillators and a spring between them, L = ½ m |v|² − ½ k |x|² − ½ k_c (x₁ −
    x₂)².
    """
    c = Parameters(m=m, k=k, coupling=coupling)
    q, v = coordinates("x1", "x2")
    potential = c.k * ca.sumsqr(q) / 2 + c.coupling * (q[0] - q[1]) ** 2 / 2
    system = System(q, v, c.m * ca.sumsqr(v) / 2 - potential, params=c)
    modes = np.array([[1, 1], [1, -1]]) / np.sqrt(2)
    omega = np.sqrt(np.array([k, k + 2 * coupling]) / m)

    def exact(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        a, b = modes @ q0, modes @ v0
        cosine, sine = np.cos(np.outer(t, omega)), np.sin(np.outer(t, omega))
        return (a * cosine + b / omega * sine) @ modes, (b * cosine - a * omega * sine) @ modes

    return Model(
        name="coupled_oscillators",
        system=system,
        q0=q0,
        v0=v0,
        duration=70.0,
        h=0.1,
        invariants=energy(system),
        exact=exact,
        claim="The energy passes to and fro with the beat of the two normal frequencies.",
        source="Landau & Lifshitz, Mechanics, §23, problem 1",
    )


def henon_heiles(
    q0: Sequence[float] = (0.0, 0.1),
    v0: Sequence[float] | None = None,
    total: float = 1 / 12,
    strength: float = 1.0,
) -> Model:
    """Hénon–Heiles, L = ½ |v|² − ½ |q|² − λ (x² y − ⅓ y³).

    Parameters
    ----------
    q0, v0 : sequence of 2 floats
        Start; without v0 it is along x with the energy `total`.
    total : float
        Energy, used where v0 is not given.
    strength : float
        λ.
    """
    c = Parameters(strength=strength)
    q, v = coordinates("x", "y")
    system = System(
        q,
        v,
        ca.sumsqr(v) / 2 - ca.sumsqr(q) / 2 - c.strength * (q[0] ** 2 * q[1] - q[1] ** 3 / 3),
        params=c,
    )
    if v0 is None:
        x, y = q0
        v0 = (np.sqrt(2 * total - x**2 - y**2 - 2 * strength * (x**2 * y - y**3 / 3)), 0.0)
    return Model(
        name="henon_heiles",
        system=system,
        q0=q0,
        v0=v0,
        duration=300.0,
        h=0.05,
        invariants=energy(system),
        claim="Regular at E = 1/12, mostly chaotic at E = 1/8, unbounded above E = 1/6.",
        source="Hénon & Heiles, Astronomical Journal 69 (1964) 73",
    )


def duffing(
    x0: float = 1.0, v0: float = 0.0, m: float = 1.0, k: float = 1.0, epsilon: float = 1.0
) -> Model:
    """Duffing's oscillator, a spring that hardens, L = ½ m ẋ² − ½ k x² − ¼ ε x⁴."""
    c = Parameters(m=m, k=k, epsilon=epsilon)
    q, v = coordinates("x")
    potential = c.k * q**2 / 2 + c.epsilon * q**4 / 4
    system = System(q, v, c.m * v**2 / 2 - potential, params=c)
    total = m * v0**2 / 2 + k * x0**2 / 2 + epsilon * x0**4 / 4
    # x = A cos φ with ¼ ε A⁴ + ½ k A² = E, φ̇² = (k + ½ ε A² (1 + cos² φ)) / m
    top = float(np.sqrt(4 * total / (k + np.sqrt(k**2 + 4 * epsilon * total))))

    def rate(phi: np.ndarray) -> np.ndarray:
        return np.sqrt((k + epsilon * top**2 * (1 + np.cos(phi) ** 2) / 2) / m)

    def exact(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        clock = PeriodicIntegral(lambda phi: 1 / rate(phi))
        # ẋ = −A φ̇ sin φ, where φ̇ at the start is that of cos φ = x₀/A
        first = np.arctan2(-v0 / rate(np.arccos(np.clip(x0 / top, -1, 1))), x0)
        phi = clock.inverse(clock(first) + t)
        return top * np.cos(phi), -top * rate(phi) * np.sin(phi)

    return Model(
        name="duffing",
        system=system,
        q0=x0,
        v0=v0,
        duration=30.0,
        h=0.05,
        invariants=energy(system),
        exact=exact,
        claim="The motion is Jacobi's elliptic cosine: the larger the swing, the higher its pitch.",
        source="Nayfeh & Mook, Nonlinear Oscillations, 1979, §2.1",
    )


def spring_pendulum(
    q0: Sequence[float] = (0.05, -1.0),
    v0: Sequence[float] = (0.0, 0.0),
    m: float = 1.0,
    k: float = 29.43,
    length: float = 1.0,
    g: float = 9.81,
) -> Model:
    """Weight on an elastic string in the plane, L = ½ m |v|² − m g y − ½ k (r − ℓ)².

    With k = 3 m g/ℓ, the default, it bounces twice as fast as it swings.
    """
    c = Parameters(m=m, k=k, length=length, g=g)
    q, v = coordinates("x", "y")
    stretch = ca.norm_2(q) - c.length
    potential = c.m * c.g * q[1] + c.k * stretch**2 / 2
    system = System(q, v, c.m * ca.sumsqr(v) / 2 - potential, params=c)
    return Model(
        name="spring_pendulum",
        system=system,
        q0=q0,
        v0=v0,
        duration=30.0,
        h=0.02,
        invariants=energy(system),
        claim="At resonance 1 : 2 bouncing turns into swinging and back.",
        source="Vitt & Gorelik, Journal of Technical Physics 3 (1933) 294",
    )

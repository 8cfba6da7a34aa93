"""Motion seen from a turning frame: free particle, with a spring, Foucault's pendulum."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np

from varint.models.model import Model, energy
from varint.scene.parameters import Parameters
from varint.scene.system import System, coordinates


def turned(vectors: np.ndarray, axis: np.ndarray, angles: np.ndarray) -> np.ndarray:
    """Vectors (N, 3) turned about a unit axis (3,) by the angles (N,), by Rodrigues' formula."""
    along = np.outer(vectors @ axis, axis)
    return (
        along
        + np.cos(angles)[:, None] * (vectors - along)
        + np.sin(angles)[:, None] * np.cross(axis, vectors)
    )


def _seen_from(
    t: np.ndarray, Omega: np.ndarray, q0: np.ndarray, v0: np.ndarray, omega0: float
) -> tuple[np.ndarray, np.ndarray]:
    """Free (ω₀ = 0) or harmonic motion of the inertial frame in the coordinates of the frame
    that turns with Ω.
    """
    size = np.linalg.norm(Omega)
    axis = Omega / size if size > 0 else np.array([0.0, 0.0, 1.0])
    inertial = v0 + np.cross(Omega, q0)
    cosine, sine = np.cos(omega0 * t), t * np.sinc(omega0 * t / np.pi)
    place = turned(np.outer(cosine, q0) + np.outer(sine, inertial), axis, -size * t)
    speed = turned(np.outer(cosine, inertial) - np.outer(omega0**2 * sine, q0), axis, -size * t)
    return place, speed - np.cross(Omega, place)


def rotating_frame(
    q0: Sequence[float] = (1.0, 0.5, 0.25),
    v0: Sequence[float] = (-0.2, 0.4, 0.1),
    Omega: Sequence[float] = (0.3, -0.2, 0.9),
    m: float = 1.0,
    stiffness: float = 0.0,
) -> Model:
    """Particle in space seen from a frame turning with Ω, L = ½ m |ṙ + Ω × r|² − ½ k |r|²; free
    for k = 0.
    """
    c = Parameters(Omega=Omega, m=m, stiffness=stiffness)
    q, v = coordinates("x", "y", "z")
    system = System(
        q,
        v,
        c.m * ca.sumsqr(v + ca.cross(c.Omega, q)) / 2 - c.stiffness * ca.sumsqr(q) / 2,
        params=c,
    )
    turn, start, speed = (np.asarray(x, dtype=float) for x in (Omega, q0, v0))
    return Model(
        name="rotating_frame",
        system=system,
        q0=q0,
        v0=v0,
        duration=20.0,
        h=0.02,
        exact=lambda t: _seen_from(t, turn, start, speed, np.sqrt(stiffness / m)),
        invariants=energy(system)
        | {"angular momentum along Ω": ca.dot(ca.cross(q, system.momentum), c.Omega)},
        claim=(
            "Coriolis and centrifugal forces are what the straight line of the inertial frame "
            "looks like."
        ),
        source="Landau & Lifshitz, Mechanics, §39",
    )


def turntable(
    q0: Sequence[float] = (1.0, 0.5),
    v0: Sequence[float] = (-0.2, 0.4),
    Omega: float = 0.7,
    m: float = 1.0,
    stiffness: float = 0.0,
) -> Model:
    """Particle in the plane of a turntable, L = ½ m [(ẋ − Ωy)² + (ẏ + Ωx)²] − ½ k r²; free for k
    = 0.
    """
    c = Parameters(Omega=Omega, m=m, stiffness=stiffness)
    q, v = coordinates("x", "y")
    seen = v + c.Omega * ca.vertcat(-q[1], q[0])
    system = System(q, v, c.m * ca.sumsqr(seen) / 2 - c.stiffness * ca.sumsqr(q) / 2, params=c)

    def exact(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        omega0 = np.sqrt(stiffness / m)
        place, speed = _seen_from(
            t, np.array([0, 0, Omega]), np.array([*q0, 0.0]), np.array([*v0, 0.0]), omega0
        )
        return place[:, :2], speed[:, :2]

    return Model(
        name="turntable",
        system=system,
        q0=q0,
        v0=v0,
        duration=25.0,
        h=0.02,
        exact=exact,
        invariants=energy(system)
        | {"angular momentum": q[0] * system.momentum[1] - q[1] * system.momentum[0]},
        claim="The spiral on the turntable is a straight line in the inertial frame.",
        source="Landau & Lifshitz, Mechanics, §39",
    )


def foucault_pendulum(
    q0: Sequence[float] = (3.0, 0.0),
    v0: Sequence[float] = (0.0, 0.0),
    m: float = 1.0,
    length: float = 67.0,
    latitude: float = np.deg2rad(48.85),
    g: float = 9.81,
    Omega: float = 7.292115e-5,
) -> Model:
    """Foucault's pendulum for small swings, L = ½ m |v|² + m Ω_z (x ẏ − y ẋ) − ½ m (g/ℓ) r², Ω_z
    = Ω sin(latitude).
    """
    c = Parameters(m=m, length=length, latitude=latitude, g=g, Omega=Omega)
    q, v = coordinates("x", "y")
    turn = c.Omega * ca.sin(c.latitude) * (q[0] * v[1] - q[1] * v[0])
    system = System(
        q, v, c.m * (ca.sumsqr(v) / 2 + turn - c.g / c.length * ca.sumsqr(q) / 2), params=c
    )
    rate = Omega * np.sin(latitude)
    swing = np.sqrt(g / length + rate**2)
    start, speed = complex(*q0), complex(*v0)

    def exact(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        # z = x + iy = e^{−iΩ_z t} (A cos ω₁t + B sin ω₁t), ω₁² = g/ℓ + Ω_z²
        frame, A, B = np.exp(-1j * rate * t), start, (speed + 1j * rate * start) / swing
        z = frame * (A * np.cos(swing * t) + B * np.sin(swing * t))
        zdot = frame * swing * (B * np.cos(swing * t) - A * np.sin(swing * t)) - 1j * rate * z
        return np.stack([z.real, z.imag], -1), np.stack([zdot.real, zdot.imag], -1)

    return Model(
        name="foucault_pendulum",
        system=system,
        q0=q0,
        v0=v0,
        duration=3600.0,
        h=0.2,
        exact=exact,
        invariants=energy(system)
        | {"angular momentum": q[0] * system.momentum[1] - q[1] * system.momentum[0]},
        claim="The plane of swing turns at the rate −Ω sin(latitude).",
        source="Landau & Lifshitz, Mechanics, §39, problem 3",
    )

"""Oscillators of a few degrees of freedom: isotropic, coupled, Hénon–Heiles."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np

from varint.models.model import Model, energy
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

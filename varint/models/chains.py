"""Chains of particles: Fermi–Pasta–Ulam–Tsingou with stiff springs, Toda."""

from __future__ import annotations

import casadi as ca
import numpy as np

from varint.models.model import Model, energy
from varint.scene.parameters import Parameters
from varint.scene.system import System, coordinates


def fpu_chain(pairs: int = 3, omega: float = 50.0) -> Model:
    """Stiff linear springs alternating with soft quartic ones (Fermi–Pasta–Ulam–Tsingou after
    Galgani).

    In the coordinates x₀ (displacement of a stiff spring) and x₁ (its stretch)
    ``L = ½ |v|² − ½ ω² Σ x₁ᵢ² − ¼ [(x₀₁ − x₁₁)⁴ + Σ (x₀ᵢ₊₁ − x₁ᵢ₊₁ − x₀ᵢ − x₁ᵢ)⁴ + (x₀ₘ + x₁ₘ)⁴]``.
    """
    c = Parameters(omega=omega)
    q, v = coordinates(*(f"x{kind}_{i + 1}" for kind in (0, 1) for i in range(pairs)))
    slow, stiff = q[:pairs], q[pairs:]
    soft = ca.vertcat(slow - stiff, 0) - ca.vertcat(0, slow + stiff)
    potential = c.omega**2 * ca.sumsqr(stiff) / 2 + ca.sum1(soft**4) / 4
    system = System(q, v, ca.sumsqr(v) / 2 - potential, params=c)
    q0, v0 = np.zeros(2 * pairs), np.zeros(2 * pairs)
    q0[[0, pairs]], v0[[0, pairs]] = [1, 1 / omega], 1
    return Model(
        name="fpu_chain",
        system=system,
        q0=q0,
        v0=v0,
        duration=200.0,
        h=0.002,
        invariants=energy(system),
        claim="The stiff springs exchange energy slowly; its sum is an adiabatic invariant.",
        source="Hairer, Lubich & Wanner, Geometric Numerical Integration, I.5.1",
    )


def fpu_stiff_energies(model: Model) -> ca.SX:
    """Energies I_j = ½ (v₁ⱼ² + ω² x₁ⱼ²) of the stiff springs of `fpu_chain`, as expressions
    (m,).
    """
    system = model.system
    m = system.q.numel() // 2
    return (system.v[m:] ** 2 + system.c**2 * system.q[m:] ** 2) / 2


def toda_chain(sites: int = 200, kappa: float = 1.0) -> Model:
    """Ring of particles with exponential springs, L = ½ Σ vᵢ² − Σ [e^{−rᵢ} + rᵢ − 1], rᵢ = qᵢ₊₁ −
    qᵢ.

    Started as one soliton of strength κ, which shortens the ring by 2κ (parameter ``shift``).
    """
    c = Parameters(shift=-2 * kappa)
    q, v = coordinates(*(f"q{i + 1}" for i in range(sites)))
    stretch = ca.vertcat(q[1:], q[0] + c.shift) - q
    system = System(q, v, ca.sumsqr(v) / 2 - ca.sum1(ca.exp(-stretch) + stretch - 1), params=c)
    n, speed = np.arange(sites), 2 * np.sinh(kappa)

    def exact(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        # q = log((1 + e^{2κ(n−1) − βt})/(1 + e^{2κn − βt})), continued periodically for one turn of
        # the ring
        phase = 2 * kappa * (n - sites // 2) - speed * t[:, None]
        turn = 2 * kappa * sites
        laps = np.floor((phase + turn / 2) / turn)
        phase = phase - laps * turn
        x = np.log1p(np.expm1(-2 * kappa) * _logistic(phase)) - 2 * kappa * laps
        return x, speed * (_logistic(phase) - _logistic(phase - 2 * kappa))

    springs = ca.exp(-stretch)
    third = ca.sum1(v**3 / 3 + v * (springs + ca.vertcat(springs[-1], springs[:-1])))
    q0, v0 = exact(np.zeros(1))
    return Model(
        name="toda_chain",
        system=system,
        q0=q0[0],
        v0=v0[0],
        duration=50.0,
        h=0.05,
        exact=exact,
        invariants=energy(system) | {"momentum": ca.sum1(v), "third integral": third},
        claim=(
            "A soliton travels at the speed sinh κ / κ sites per unit of time and keeps its shape."
        ),
        source="Toda, Journal of the Physical Society of Japan 22 (1967) 431; Flaschka 1974",
    )


def _logistic(x: np.ndarray) -> np.ndarray:
    return 0.5 * (1 + np.tanh(x / 2))

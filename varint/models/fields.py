"""Charged particles, L = ½ m |v|² − e (φ − v·A), in electric and magnetic fields, in any gauge.

A gauge function χ(q, t) turns φ into φ + ∂χ/∂t and A into A − ∇χ: the action changes by −e χ at its
end points, the motion not at all, p by −e ∇χ.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import casadi as ca
import numpy as np

from varint.errors import InputError
from varint.models.model import Model
from varint.models.rotating import turned
from varint.orbits.anomalies import eccentric_anomaly
from varint.scene.parameters import Parameters
from varint.scene.system import System, coordinates, time

Gauge = Callable[[ca.SX, ca.SX], ca.SX]


def charged_particle(
    q: ca.SX,
    v: ca.SX,
    t: ca.SX,
    params: Parameters,
    vector_potential: ca.SX,
    potential: ca.SX | float = 0.0,
    gauge: Gauge | None = None,
) -> System:
    """System of a particle of mass ``params.m`` and charge ``params.e`` in the potentials A(q, t),
    φ(q, t).

    Parameters
    ----------
    q, v, t : SX
        Coordinates, velocities, time.
    params : Parameters
        Must have ``m`` and ``e``.
    vector_potential : SX (n,)
        A, with B = ∇ × A and E = −∇φ − ∂A/∂t.
    potential : SX
        φ.
    gauge : callable, optional
        ``χ(q, t)``, another gauge of the same fields.
    """
    chi = ca.SX(0) if gauge is None else gauge(q, t)
    A, phi = vector_potential - ca.gradient(chi, q), potential + ca.jacobian(chi, t)
    return System(
        q, v, params.m * ca.sumsqr(v) / 2 - params.e * (phi - ca.dot(v, A)), params=params, t=t
    )


def uniform_fields(
    E: Sequence[float] = (0.0, 1.0, 0.0),
    B: Sequence[float] = (0.0, 0.0, 2.0),
    q0: Sequence[float] = (0.0, 0.0, 0.0),
    v0: Sequence[float] = (0.0, 0.0, 0.0),
    m: float = 1.0,
    e: float = 1.0,
    gauge: Gauge | None = None,
) -> Model:
    """Charge in uniform fields E and B, φ = −E·r, A = ½ B × r."""
    c = Parameters(m=m, e=e, E=E, B=B)
    q, v = coordinates("x", "y", "z")
    system = charged_particle(q, v, time(), c, ca.cross(c.B, q) / 2, -ca.dot(c.E, q), gauge)
    field, magnet, start, speed = (np.asarray(x, dtype=float) for x in (E, B, q0, v0))
    spin, push = -e / m * magnet, e / m * field  # v̇ = spin × v + push
    omega = np.linalg.norm(spin)
    axis = spin / omega if omega > 0 else np.array([0, 0, 1.0])
    slide = np.cross(spin, push) / omega**2 if omega > 0 else np.zeros(3)
    kick = (push @ axis) * axis if omega > 0 else push
    turn = (speed - slide) - ((speed - slide) @ axis) * axis if omega > 0 else np.zeros(3)

    def exact(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        steady = speed - turn
        velocity = steady + np.outer(t, kick) + turned(np.tile(turn, (len(t), 1)), axis, omega * t)
        sine = np.outer(t * np.sinc(omega * t / np.pi), turn)
        versine = np.outer(
            omega * t**2 / 2 * np.sinc(omega * t / (2 * np.pi)) ** 2, np.cross(axis, turn)
        )
        return start + np.outer(t, steady) + np.outer(t**2 / 2, kick) + sine + versine, velocity

    kinetic = c.m * ca.sumsqr(v) / 2
    return Model(
        name="uniform_fields",
        system=system,
        q0=q0,
        v0=v0,
        duration=20.0,
        h=0.02,
        exact=exact,
        invariants={
            "kinetic energy − e E·r": kinetic - c.e * ca.dot(c.E, q),
            "m v − e (E t + r × B)": c.m * v - c.e * (c.E * system.t + ca.cross(q, c.B)),
        },
        claim=(
            "The particle gyrates about a centre that drifts with E × B / B²: a cycloid when it "
            "starts at rest."
        ),
        source="Landau & Lifshitz, The Classical Theory of Fields, §22",
    )


def magnetic_mirror(
    q0: Sequence[float] = (0.04, 0.0, 0.0),
    v0: Sequence[float] = (0.0, 0.6, 0.5),
    m: float = 1.0,
    e: float = 1.0,
    B0: float = 10.0,
    L: float = 1.0,
    gauge: Gauge | None = None,
) -> Model:
    """Magnetic mirror, A = ½ B₀ (1 + z²/L²) (−y, x, 0): the field grows along its axis."""
    c = Parameters(m=m, e=e, B0=B0, L=L)
    q, v = coordinates("x", "y", "z")
    A = c.B0 / 2 * (1 + (q[2] / c.L) ** 2) * ca.vertcat(-q[1], q[0], 0)
    system = charged_particle(q, v, time(), c, A, gauge=gauge)
    swept = q[0] * (c.m * v[1] + c.e * A[1]) - q[1] * (c.m * v[0] + c.e * A[0])
    return Model(
        name="magnetic_mirror",
        system=system,
        q0=q0,
        v0=v0,
        duration=20.0,
        h=0.01,
        invariants={"kinetic energy": c.m * ca.sumsqr(v) / 2, "p_phi": swept},
        claim=(
            "The magnetic moment m v⊥²/2B is adiabatically conserved; the particle turns back "
            "where it must."
        ),
        source="Northrop, The Adiabatic Motion of Charged Particles, 1963",
    )


def inverse_distance_field(
    q0: Sequence[float] = (2.0, 0.0),
    v0: Sequence[float] = (0.0, 0.6),
    m: float = 1.0,
    e: float = 1.0,
    k: float = 1.0,
    gauge: Gauge | None = None,
) -> Model:
    """Charge in the plane in the field B = k/r, A = k (−y, x)/r."""
    c = Parameters(m=m, e=e, k=k)
    q, v = coordinates("x", "y")
    r = ca.norm_2(q)
    system = charged_particle(q, v, time(), c, c.k * ca.vertcat(-q[1], q[0]) / r, gauge=gauge)
    start, speed = np.asarray(q0, dtype=float), np.asarray(v0, dtype=float)

    def exact(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        # r = a (1 − ε cos ψ): (r ṙ)² = −c² r² + 2 p κ r − p², so r ψ̇ = c and Kepler's equation
        # holds for ψ
        kappa, spin, pull = _reduced(start, speed, e * k / m)
        a, r0 = spin * kappa / pull**2, np.hypot(*start)
        cosine, sine = 1 - r0 / a, start @ speed / (pull * a)
        eps, psi0 = np.hypot(cosine, sine), np.arctan2(sine, cosine)
        psi = eccentric_anomaly(pull / a * t + psi0 - eps * np.sin(psi0), eps)

        def swept(psi: np.ndarray) -> np.ndarray:
            turns = np.pi * np.round(psi / (2 * np.pi))
            half = np.arctan2(
                np.sqrt(1 + eps) * np.sin(psi / 2 - turns),
                np.sqrt(1 - eps) * np.cos(psi / 2 - turns),
            )
            return 2 * np.sign(spin) * (half + turns) - kappa / pull * psi

        r = a * (1 - eps * np.cos(psi))
        phi = np.arctan2(start[1], start[0]) + swept(psi) - swept(psi0)
        rdot, rphidot = pull * a * eps * np.sin(psi) / r, spin / r - kappa
        outward, across = (
            np.stack([np.cos(phi), np.sin(phi)], -1),
            np.stack([-np.sin(phi), np.cos(phi)], -1),
        )
        return r[:, None] * outward, rdot[:, None] * outward + rphidot[:, None] * across

    return Model(
        name="inverse_distance_field",
        system=system,
        q0=q0,
        v0=v0,
        duration=80.0,
        h=0.05,
        invariants={
            "kinetic energy": c.m * ca.sumsqr(v) / 2,
            "p_phi": c.m * (q[0] * v[1] - q[1] * v[0]) + c.e * c.k * r,
        },
        exact=exact,
        claim="A rosette: the orbit turns by a fixed angle per radial period, both in closed form.",
        source="reduction by p_φ = m r² φ̇ + e k r; Landau & Lifshitz, Mechanics, §14",
    )


def inverse_distance_period(
    q0: Sequence[float], v0: Sequence[float], m: float = 1.0, e: float = 1.0, k: float = 1.0
) -> tuple[float, float]:
    """Radial period T_r = π (r₁ + r₂)/c and the angle turned in it, for `inverse_distance_field`.

    Raises
    ------
    InputError
        If the speed exceeds e k/m and the particle escapes.

    Examples
    --------
    >>> import varint as vi
    >>> period, angle = vi.models.inverse_distance_period((2.0, 0.0), (0.0, 0.6))
    >>> round(period, 10), round(angle, 10)
    (39.2699081699, -1.5707963268)
    """
    kappa, spin, pull = _reduced(
        np.asarray(q0, dtype=float), np.asarray(v0, dtype=float), e * k / m
    )
    return float(2 * np.pi * spin * kappa / pull**3), float(
        2 * np.pi * (np.sign(spin) - kappa / pull)
    )


def _reduced(start: np.ndarray, speed: np.ndarray, kappa: float) -> tuple[float, float, float]:
    """κ = e k/m, p_φ/m and c = √(κ² − v²) of a bound orbit in the field k/r."""
    pull2 = kappa**2 - speed @ speed
    if pull2 <= 0:
        raise InputError(
            f"the speed {np.linalg.norm(speed):.4g} is not below e k/m = {abs(kappa):.4g}: the "
            "particle escapes"
        )
    return (
        kappa,
        start[0] * speed[1] - start[1] * speed[0] + kappa * np.hypot(*start),
        np.sqrt(pull2),
    )


def oscillating_field(
    q0: Sequence[float] = (0.0, 0.0, 0.0),
    v0: Sequence[float] = (0.1, 0.0, 0.2),
    m: float = 1.0,
    e: float = 1.0,
    amplitude: Sequence[float] = (0.8, 0.3, 0.0),
    omega: float = 2.0,
    gauge: Gauge | None = None,
) -> Model:
    """Charge in the field E = ω a sin ωt of a long wave, all of it in A = a cos ωt."""
    c = Parameters(m=m, e=e, amplitude=amplitude, omega=omega)
    q, v = coordinates("x", "y", "z")
    t = time()
    system = charged_particle(q, v, t, c, c.amplitude * ca.cos(c.omega * t), gauge=gauge)
    start, speed, kick = (
        np.asarray(q0, float),
        np.asarray(v0, float),
        e / m * np.asarray(amplitude, float),
    )

    def exact(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        place = start + np.outer(t, speed) + np.outer(t - np.sin(omega * t) / omega, kick)
        return place, speed + np.outer(1 - np.cos(omega * t), kick)

    return Model(
        name="oscillating_field",
        system=system,
        q0=q0,
        v0=v0,
        duration=20.0,
        h=0.02,
        exact=exact,
        invariants={"m v + e a cos ωt": c.m * v + c.e * c.amplitude * ca.cos(c.omega * t)},
        claim=(
            "The canonical momentum is conserved; the particle quivers and drifts as its start "
            "phase decides."
        ),
        source="Landau & Lifshitz, The Classical Theory of Fields, §47, problem 1",
    )


def growing_field(
    q0: Sequence[float] = (1.0, 0.0),
    v0: Sequence[float] = (0.0, -1.0),
    m: float = 1.0,
    e: float = 1.0,
    B0: float = 1.0,
    rate: float = 0.02,
    gauge: Gauge | None = None,
) -> Model:
    """Charge in a magnetic field that grows, B = B₀ + Ḃ t, and induces E: A = ½ (B₀ + Ḃ t) (−y,
    x).
    """
    c = Parameters(m=m, e=e, B0=B0, rate=rate)
    q, v = coordinates("x", "y")
    t = time()
    B = c.B0 + c.rate * t
    system = charged_particle(q, v, t, c, B / 2 * ca.vertcat(-q[1], q[0]), gauge=gauge)
    return Model(
        name="growing_field",
        system=system,
        q0=q0,
        v0=v0,
        duration=100.0,
        h=0.05,
        invariants={"p_phi": c.m * (q[0] * v[1] - q[1] * v[0]) + c.e * B / 2 * ca.sumsqr(q)},
        claim="The orbit shrinks so that m v²/B, and with it the flux through it, stays.",
        source="Landau & Lifshitz, The Classical Theory of Fields, §21",
    )

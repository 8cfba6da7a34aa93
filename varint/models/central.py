"""Central forces in the plane: any potential, Kepler's, its perturbation by b/r², and the
reduced radial motion.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import casadi as ca
import numpy as np

from varint.errors import InputError
from varint.models.model import Model, energy
from varint.orbits.anomalies import eccentric_anomaly
from varint.scene.parameters import Parameters
from varint.scene.system import System, coordinates

Potential = Callable[[ca.SX, Parameters], ca.SX]


def kepler_motion(
    t: np.ndarray, mu: float, r0: np.ndarray, v0: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Elliptic motion r̈ = −μ r/|r|³ from r(0), v(0), in the plane or in space: r and v, each (N,
    d).

    ``r = a (cos E − e) P + b sin E Q`` with Kepler's equation ``E − e sin E = n (t − t₀)``.

    Raises
    ------
    InputError
        If the energy is not negative or the motion is radial.
    """
    r0, v0 = np.asarray(r0, dtype=float), np.asarray(v0, dtype=float)
    distance, speed2, radial = np.linalg.norm(r0), v0 @ v0, r0 @ v0
    inverse_a, swept2 = 2 / distance - speed2 / mu, distance**2 * speed2 - radial**2
    if inverse_a <= 0 or swept2 <= 0:
        raise InputError(
            "this start has no ellipse: its energy must be negative and its angular momentum not "
            "zero"
        )
    a = 1 / inverse_a
    cosine, sine = 1 - distance / a, radial / np.sqrt(mu * a)
    e, E0 = np.hypot(cosine, sine), np.arctan2(sine, cosine)
    rate, b = np.sqrt(mu / a**3), np.sqrt(swept2 / mu * a)
    # the frame from the start's own eccentric anomaly; for e = 0 this is the start's direction
    P = r0 * np.cos(E0) / distance - v0 * np.sin(E0) * np.sqrt(a / mu)
    Q = (r0 * np.sin(E0) / distance + v0 * (np.cos(E0) - e) * np.sqrt(a / mu)) * a / b
    E = eccentric_anomaly(rate * t + E0 - e * np.sin(E0), e)
    Edot = rate / (1 - e * np.cos(E))
    r = np.outer(a * (np.cos(E) - e), P) + np.outer(b * np.sin(E), Q)
    return r, np.outer(-a * np.sin(E) * Edot, P) + np.outer(b * np.cos(E) * Edot, Q)


def require_ellipse(e: float) -> None:
    """Refuse an eccentricity outside 0 ≤ e < 1."""
    if not 0 <= e < 1:
        raise InputError(f"the eccentricity e must be at least 0 and below 1, got {e!r}")


def kepler(e: float = 0.6, a: float = 1.0, m: float = 1.0, k: float = 1.0) -> Model:
    """Kepler's problem in Cartesian coordinates, L = ½ m |v|² + k/|q|, started at the
    pericentre.
    """
    require_ellipse(e)
    c = Parameters(m=m, k=k)
    q, v = coordinates("x", "y")
    system = System(q, v, c.m * ca.sumsqr(v) / 2 + c.k / ca.norm_2(q), params=c)
    q0, v0 = np.array([a * (1 - e), 0]), np.array([0, np.sqrt(k / (m * a) * (1 + e) / (1 - e))])
    p = system.momentum
    spin = q[0] * p[1] - q[1] * p[0]
    runge = ca.vertcat(p[1], -p[0]) * spin / (c.m * c.k) - q / ca.norm_2(q)
    return Model(
        name="kepler",
        system=system,
        q0=q0,
        v0=v0,
        duration=100.0,
        h=0.01,
        exact=lambda t: kepler_motion(t, k / m, q0, v0),
        invariants=energy(system) | {"angular momentum": spin, "Laplace–Runge–Lenz": runge},
        claim=(
            "The orbit is a closed ellipse; its axis (the Laplace–Runge–Lenz vector) stands still."
        ),
        source="Landau & Lifshitz, Mechanics, §15",
    )


def central_force(
    potential: Potential = lambda r, c: -c.k / r,
    constants: Mapping[str, float] | None = None,
    m: float = 1.0,
    r0: float = 0.8,
    theta0: float = 0.0,
    rdot0: float = 0.0,
    thetadot0: float = 1.5,
) -> Model:
    """Any central force in polar coordinates, L = ½ m (ṙ² + r² θ̇²) − V(r).

    Parameters
    ----------
    potential : callable
        ``V(r, c)`` as a CasADi expression, c holding the constants.
    constants : mapping, optional
        Names and values of the constants in V; ``{"k": 1.0}`` for the default V = −k/r.
    m, r0, theta0, rdot0, thetadot0 : float
        Mass and start.

    Examples
    --------
    >>> import varint as vi
    >>> spring = vi.models.central_force(lambda r, c: c.k * r**2 / 2, {"k": 2.0})
    >>> spring.system.structure.cyclic, spring.system.names
    ((1,), ('r', 'theta'))
    """
    c = Parameters(m=m, **({"k": 1.0} if constants is None else constants))
    q, v = coordinates("r", "theta")
    kinetic = c.m * (v[0] ** 2 + q[0] ** 2 * v[1] ** 2) / 2
    system = System(q, v, kinetic - potential(q[0], c), params=c)
    return Model(
        name="central_force",
        system=system,
        q0=[r0, theta0],
        v0=[rdot0, thetadot0],
        duration=20.0,
        h=0.01,
        invariants=energy(system) | {"p_theta": system.momentum[1]},
        claim="θ is cyclic, p_θ = m r² θ̇ is conserved whatever V(r).",
        source="Landau & Lifshitz, Mechanics, §14",
    )


def radial_motion(
    p_theta: float = 0.96,
    potential: Potential = lambda r, c: -c.k / r,
    constants: Mapping[str, float] | None = None,
    m: float = 1.0,
    r0: float = 0.8,
    rdot0: float = 0.0,
) -> Model:
    """The reduced problem of `central_force`, L = ½ m ṙ² − V(r) − p_θ²/(2 m r²)."""
    c = Parameters(m=m, p_theta=p_theta, **({"k": 1.0} if constants is None else constants))
    q, v = coordinates("r")
    system = System(
        q, v, c.m * v**2 / 2 - potential(q, c) - c.p_theta**2 / (2 * c.m * q**2), params=c
    )
    return Model(
        name="radial_motion",
        system=system,
        q0=r0,
        v0=rdot0,
        duration=20.0,
        h=0.01,
        invariants=energy(system),
        claim=(
            "The effective potential V + p_θ²/2mr² gives the same r(t) as the motion in the plane."
        ),
        source="Landau & Lifshitz, Mechanics, §14",
    )


def rosette(
    r0: float = 0.48,
    theta0: float = 0.0,
    rdot0: float = 0.0,
    thetadot0: float = 0.8 / 0.48**2,
    m: float = 1.0,
    k: float = 1.0,
    b: float = 0.04,
) -> Model:
    """V = −k/r + b/r² in polar coordinates: r(t) is Kepler's with p_θ² + 2mb, its angle runs γ
    times slower.
    """
    general = central_force(
        lambda r, c: -c.k / r + c.b / r**2, {"k": k, "b": b}, m, r0, theta0, rdot0, thetadot0
    )
    gamma = np.sqrt(1 + 2 * b / (m * r0**4 * thetadot0**2))
    spin = r0**2 * thetadot0

    def exact(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        place, speed = kepler_motion(
            t, k / m, np.array([r0, 0.0]), np.array([rdot0, r0 * gamma * thetadot0])
        )
        (x, y), (vx, vy) = place.T, speed.T
        r, angle = np.hypot(x, y), np.arctan2(y, x)
        rate, quarter = _mean_motion(k / m, r0, rdot0, gamma * r0 * thetadot0)
        # whole turns from the mean anomaly, which never differs from the true one by half a turn
        turns = np.round((rate * t + quarter - angle) / (2 * np.pi))
        theta = theta0 + (angle + 2 * np.pi * turns) / gamma
        return np.stack([r, theta], -1), np.stack([(x * vx + y * vy) / r, spin / r**2], -1)

    return Model(
        name="rosette",
        system=general.system,
        q0=general.q0,
        v0=general.v0,
        duration=60.0,
        h=0.01,
        invariants=general.invariants,
        exact=exact,
        claim="The pericentre turns by 2π (1/γ − 1) per radial period, γ² = 1 + 2mb/p_θ².",
        source="Landau & Lifshitz, Mechanics, §15, problem 3",
    )


def _mean_motion(mu: float, r: float, rdot: float, across: float) -> tuple[float, float]:
    """n and (M₀ − true anomaly at the start) of the Kepler motion that starts on the x-axis."""
    a = 1 / (2 / r - (rdot**2 + across**2) / mu)
    sine, cosine = r * rdot / np.sqrt(mu * a), 1 - r / a
    E0 = np.arctan2(sine, cosine)
    e = np.hypot(sine, cosine)
    true = 2 * np.arctan2(np.sqrt(1 + e) * np.sin(E0 / 2), np.sqrt(1 - e) * np.cos(E0 / 2))
    return np.sqrt(mu / a**3), E0 - e * np.sin(E0) - true


def apsidal_angle(p_theta: float, m: float, b: float) -> float:
    """Angle 2π/γ swept in one radial period of V = −k/r + b/r², γ² = 1 + 2mb/p_θ².

    Examples
    --------
    >>> import varint as vi
    >>> round(vi.models.apsidal_angle(0.8, m=1.0, b=0.04), 12)
    5.923843917544
    """
    return float(2 * np.pi / np.sqrt(1 + 2 * m * b / p_theta**2))


def radial_period(total: float, m: float, k: float) -> float:
    """Period 2π √(m a³/k) of r in V = −k/r + b/r², a = k/(2|E|), whatever b."""
    return float(2 * np.pi * np.sqrt(m * (k / (2 * abs(total))) ** 3 / k))

"""Scenes whose Lagrangian depends on time: moved pivots, driving torques, friction by a growing
mass.
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from varint.models.model import Model
from varint.models.pendulums import swing
from varint.scene.parameters import Parameters
from varint.scene.system import System, coordinates, time


def _moved_pivot(x: ca.SX, y: ca.SX, q: ca.SX, v: ca.SX, t: ca.SX, c: Parameters) -> ca.SX:
    """L = ½ m |ṙ|² − m g y of a bob at (x(t) + ℓ sin θ, y(t) − ℓ cos θ)."""
    bob = ca.vertcat(x + c.length * ca.sin(q), y - c.length * ca.cos(q))
    velocity = ca.jacobian(bob, q) * v + ca.jacobian(bob, t)
    return c.m * ca.sumsqr(velocity) / 2 - c.m * c.g * bob[1]


def driven_pendulum(
    theta0: float = 0.2,
    thetadot0: float = 0.0,
    m: float = 1.0,
    length: float = 1.0,
    g: float = 9.81,
    torque: float = 2.0,
    Omega: float = 2.0,
) -> Model:
    """Pendulum under the torque τ cos Ωt, L = ½ m ℓ² θ̇² + m g ℓ cos θ + τ θ cos Ωt."""
    c = Parameters(m=m, length=length, g=g, torque=torque, Omega=Omega)
    q, v = coordinates("theta")
    t = time()
    potential = -c.m * c.g * c.length * ca.cos(q) - c.torque * q * ca.cos(c.Omega * t)
    system = System(q, v, c.m * c.length**2 * v**2 / 2 - potential, params=c, t=t)
    return Model(
        name="driven_pendulum",
        system=system,
        q0=theta0,
        v0=thetadot0,
        duration=40.0,
        h=0.02,
        claim="The energy changes at the rate −∂L/∂t and by nothing else.",
        source="Landau & Lifshitz, Mechanics, §6 and §29",
    )


def horizontal_pivot(
    theta0: float = 0.2,
    thetadot0: float = 0.0,
    m: float = 1.0,
    length: float = 1.0,
    g: float = 9.81,
    amplitude: float = 0.3,
    Omega: float = 2.0,
) -> Model:
    """Pendulum whose pivot moves as x = a cos Ωt: ℓ θ̈ = a Ω² cos Ωt cos θ − g sin θ."""
    c = Parameters(m=m, length=length, g=g, amplitude=amplitude, Omega=Omega)
    q, v = coordinates("theta")
    t = time()
    system = System(
        q, v, _moved_pivot(c.amplitude * ca.cos(c.Omega * t), ca.SX(0), q, v, t, c), params=c, t=t
    )
    return Model(
        name="horizontal_pivot",
        system=system,
        q0=theta0,
        v0=thetadot0,
        duration=20.0,
        h=0.02,
        claim="A pivot shaken sideways acts as the inertial force a Ω² cos Ωt on the bob.",
        source="Landau & Lifshitz, Mechanics, §5, problem 3",
    )


def kapitza_pendulum(
    theta0: float = 3.0,
    thetadot0: float = 0.0,
    m: float = 1.0,
    length: float = 1.0,
    g: float = 9.81,
    amplitude: float = 0.1,
    Omega: float = 60.0,
) -> Model:
    """Pendulum whose pivot vibrates as y = a cos Ωt: ℓ θ̈ = −(g − a Ω² cos Ωt) sin θ."""
    c = Parameters(m=m, length=length, g=g, amplitude=amplitude, Omega=Omega)
    q, v = coordinates("theta")
    t = time()
    system = System(
        q, v, _moved_pivot(ca.SX(0), c.amplitude * ca.cos(c.Omega * t), q, v, t, c), params=c, t=t
    )
    return Model(
        name="kapitza_pendulum",
        system=system,
        q0=theta0,
        v0=thetadot0,
        duration=10.0,
        h=0.002,
        claim="Upside down it is stable where a² Ω² > 2 g ℓ.",
        source="Landau & Lifshitz, Mechanics, §30, problem 1",
    )


def kapitza_frequency(length: float, g: float, amplitude: float, Omega: float) -> float:
    """Slow frequency √(a² Ω²/2ℓ² − g/ℓ) about the upright position, to first order of averaging.

    Examples
    --------
    >>> import varint as vi
    >>> vi.models.kapitza_frequency(length=1.0, g=9.0, amplitude=0.1, Omega=60.0)
    3.0
    """
    return float(np.sqrt((amplitude * Omega / length) ** 2 / 2 - g / length))


def accelerated_pivot(
    theta0: float = 0.0,
    thetadot0: float = 0.0,
    m: float = 1.0,
    length: float = 1.0,
    g: float = 9.81,
    acceleration: float = 3.0,
) -> Model:
    """Pendulum in a car that accelerates, pivot at x = ½ a t²: the pendulum of the effective
    gravity (−a, −g).
    """
    c = Parameters(m=m, length=length, g=g, acceleration=acceleration)
    q, v = coordinates("theta")
    t = time()
    system = System(
        q, v, _moved_pivot(c.acceleration * t**2 / 2, ca.SX(0), q, v, t, c), params=c, t=t
    )
    tilt = np.arctan2(acceleration, g)

    def exact(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        theta, rate = swing(
            t, theta0 + tilt, thetadot0, np.sqrt(np.hypot(g, acceleration) / length)
        )
        return theta - tilt, rate

    seen = (
        c.length**2 * v**2 / 2 - c.g * c.length * ca.cos(q) + c.acceleration * c.length * ca.sin(q)
    )
    return Model(
        name="accelerated_pivot",
        system=system,
        q0=theta0,
        v0=thetadot0,
        duration=20.0,
        h=0.02,
        exact=exact,
        invariants={"energy in the car": c.m * seen},
        claim="A pendulum in effective gravity √(g² + a²), tilted by arctan(a/g).",
        source="Landau & Lifshitz, Mechanics, §39",
    )


def lengthening_pendulum(
    theta0: float = 1.0,
    thetadot0: float = 0.0,
    m: float = 1.0,
    length: float = 1.0,
    rate: float = 0.1,
    g: float = 9.81,
) -> Model:
    """Pendulum of length ℓ(t) = ℓ₀ + ℓ̇ t, L = ½ m ℓ² θ̇² + m g ℓ cos θ."""
    c = Parameters(m=m, length=length, rate=rate, g=g)
    q, v = coordinates("theta")
    t = time()
    long = c.length + c.rate * t
    system = System(q, v, c.m * long**2 * v**2 / 2 + c.m * c.g * long * ca.cos(q), params=c, t=t)
    return Model(
        name="lengthening_pendulum",
        system=system,
        q0=theta0,
        v0=thetadot0,
        duration=60.0,
        h=0.02,
        claim="Energy over frequency is an adiabatic invariant: the amplitude shrinks as ℓ^(−3/4).",
        source="Lorentz's question, Solvay 1911; Landau & Lifshitz, Mechanics, §49",
    )


def forced_oscillator(
    x0: float = 1.0,
    v0: float = -0.5,
    m: float = 1.0,
    omega: float = 1.2,
    force: float = 0.7,
    Omega: float = 2.3,
) -> Model:
    """Oscillator under F cos Ωt, L = ½ m ẋ² − ½ m ω² x² + F x cos Ωt; also at resonance."""
    c = Parameters(m=m, omega=omega, force=force, Omega=Omega)
    q, v = coordinates("x")
    t = time()
    lagrangian = c.m * (v**2 - c.omega**2 * q**2) / 2 + c.force * q * ca.cos(c.Omega * t)
    system = System(q, v, lagrangian, params=c, t=t)

    def exact(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        # (cos Ωt − cos ωt)/(ω² − Ω²) written as a product, which stays exact at Ω = ω
        total, half = omega + Omega, (omega - Omega) * t / 2
        beat, swell = np.sinc(half / np.pi), force / m / total
        x = (
            x0 * np.cos(omega * t)
            + v0 / omega * np.sin(omega * t)
            + swell * t * np.sin(total * t / 2) * beat
        )
        v = v0 * np.cos(omega * t) - x0 * omega * np.sin(omega * t)
        return x, v + swell * (omega * t * np.cos(total * t / 2) * beat + np.sin(Omega * t))

    return Model(
        name="forced_oscillator",
        system=system,
        q0=x0,
        v0=v0,
        duration=50.0,
        h=0.05,
        exact=exact,
        claim=(
            "Forced and free oscillation superpose; at resonance the amplitude grows like F t / 2 "
            "m ω."
        ),
        source="Landau & Lifshitz, Mechanics, §22",
    )


def caldirola_kanai(
    x0: float = 1.0, v0: float = -0.5, m: float = 1.0, omega: float = 1.5, gamma: float = 0.4
) -> Model:
    """Damped oscillator from a Lagrangian, L = e^{γt} (½ m ẋ² − ½ m ω² x²): ẍ + γ ẋ + ω² x = 0."""
    c = Parameters(m=m, omega=omega, gamma=gamma)
    q, v = coordinates("x")
    t = time()
    system = System(q, v, c.m * ca.exp(c.gamma * t) * (v**2 - c.omega**2 * q**2) / 2, params=c, t=t)
    # imaginary when over-damped, zero when critical
    ring = np.sqrt(complex(omega**2 - gamma**2 / 4))

    def exact(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        decay, cosine = np.exp(-gamma * t / 2), np.cos(ring * t).real
        sine = (t * np.sinc(ring * t / np.pi)).real  # sin(κt)/κ for every κ
        x = decay * (x0 * cosine + (v0 + gamma * x0 / 2) * sine)
        return x, decay * (v0 * cosine - (gamma * v0 / 2 + omega**2 * x0) * sine)

    kept = c.m * ca.exp(c.gamma * t) * (v**2 + c.omega**2 * q**2 + c.gamma * q * v) / 2
    return Model(
        name="caldirola_kanai",
        system=system,
        q0=x0,
        v0=v0,
        duration=10.0,
        h=0.02,
        exact=exact,
        invariants={"e^γt (H + ½ m γ x v)": kept},
        claim="A mass that grows like e^{γt} makes the damped oscillator variational.",
        source="Caldirola 1941; Kanai 1948",
    )


def linear_drag(
    x0: float = 1.0, v0: float = -0.5, m: float = 1.0, g: float = 9.81, k: float = 0.5
) -> Model:
    """Fall with linear drag from a Lagrangian, L = e^{kt} (½ m ẋ² − m g x): ẍ = −g − k ẋ."""
    c = Parameters(m=m, g=g, k=k)
    q, v = coordinates("x")
    t = time()
    system = System(q, v, c.m * ca.exp(c.k * t) * (v**2 / 2 - c.g * q), params=c, t=t)

    def exact(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        gone = -np.expm1(-k * t) / k
        return x0 - g * t / k + (v0 + g / k) * gone, -g / k + (v0 + g / k) * np.exp(-k * t)

    return Model(
        name="linear_drag",
        system=system,
        q0=x0,
        v0=v0,
        duration=10.0,
        h=0.02,
        exact=exact,
        invariants={"e^kt m (v + g/k)": c.m * ca.exp(c.k * t) * (v + c.g / c.k)},
        claim=(
            "The speed tends to g/k; a translation that changes L by a total derivative gives the "
            "invariant."
        ),
        source="Caldirola 1941",
    )

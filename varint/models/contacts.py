"""Scenes with unilateral contacts: ladder, ball, sphere, string."""

from __future__ import annotations

from collections.abc import Callable

import casadi as ca
import numpy as np

from varint.errors import InputError
from varint.models.model import Model, energy
from varint.scene.parameters import Parameters
from varint.scene.system import System, coordinates

NODES, WEIGHTS = np.polynomial.legendre.leggauss(60)  # on smooth integrands: to round-off


def travel_time(speed_squared: Callable[[np.ndarray], np.ndarray], start: float, end: float):
    """Time from the angle `start` to `end` at the rate √speed²(θ), which may vanish at the start.

    t = ∫ dθ/θ̇ with θ = start ± s², so that a start from rest leaves the integrand smooth.
    """
    root = np.sqrt(abs(end - start))
    s = root * (NODES + 1) / 2
    angle = start + np.sign(end - start) * s**2
    return float(root / 2 * (WEIGHTS @ (2 * s / np.sqrt(speed_squared(angle)))))


def _ladder_time(theta0: float, length: float, gravity: float) -> float:
    """Until the wall lets go."""

    def rate(angle: np.ndarray) -> np.ndarray:
        return 3 * gravity / length * (np.sin(theta0) - np.sin(angle))

    return travel_time(rate, theta0, np.arcsin(2 / 3 * np.sin(theta0)))


def _sphere_time(theta0: float, gravity: float) -> float:
    """Until the particle leaves the sphere."""

    def rate(angle: np.ndarray) -> np.ndarray:
        return 2 * gravity * (np.cos(theta0) - np.cos(angle))

    return travel_time(rate, theta0, np.arccos(2 / 3 * np.cos(theta0)))


def _string_time(speed: float, gravity: float) -> float:
    """Until the string goes slack; a swing from rest at the side where it never does."""
    height = (2 - speed**2 / gravity) / 3  # cos θ there
    if not -1 < height < 0:
        return float(np.pi / np.sqrt(gravity))

    def rate(angle: np.ndarray) -> np.ndarray:
        return speed**2 - 2 * gravity * (1 - np.cos(angle))

    return travel_time(rate, 0.0, np.arccos(height))


def falling_ladder(
    theta0: float = np.pi / 3, mass: float = 1.0, length: float = 2.0, gravity: float = 9.81
) -> Model:
    """Ladder between a smooth wall and a smooth floor: contacts wall, floor, and θ ≥ 0, where it
    comes to lie.

    The wall lets go where sin θ = ⅔ sin θ₀; then the centre moves on with constant ẋ.
    """
    if not 0 < theta0 < np.pi / 2:
        raise InputError(f"theta0 must lie between 0 and π/2, where a ladder slides; got {theta0}")
    scale = _ladder_time(theta0, length, gravity) / _ladder_time(np.pi / 3, 2.0, 9.81)
    c = Parameters(mass=mass, length=length, inertia=mass * length**2 / 12, gravity=gravity)
    q, v = coordinates("x", "y", "theta")
    lagrangian = c.mass * (ca.sumsqr(v[:2]) / 2 - c.gravity * q[1]) + c.inertia * v[2] ** 2 / 2
    wall, floor = q[0] - c.length / 2 * ca.cos(q[2]), q[1] - c.length / 2 * ca.sin(q[2])
    system = System(q, v, lagrangian, contact=ca.vertcat(wall, floor, q[2]), params=c)
    return Model(
        name="falling_ladder",
        system=system,
        duration=0.75 * scale,
        h=0.005 * scale,
        v0=np.zeros(3),
        q0=[length / 2 * np.cos(theta0), length / 2 * np.sin(theta0), theta0],
        claim=(
            "The wall lets go at sin θ = ⅔ sin θ₀; afterwards ẋ = (ℓ/3) sin θ₀ √((M g ℓ/I′) sin "
            "θ₀/3)."
        ),
        source=(
            "Goldstein, Classical Mechanics, 3rd ed., ch. 2; Scholten & Herman, Eur. J. Phys. 33 "
            "(2012)."
        ),
    )


def bouncing_ball(height: float = 1.0, restitution: float = 1.0, gravity: float = 9.81) -> Model:
    """Ball on a floor with a coefficient of restitution e; for e < 1 it rests after √(2h/g) (1 +
    e)/(1 − e).
    """
    scale = np.sqrt(height * 9.81 / gravity)
    c = Parameters(gravity=gravity)
    q, v = coordinates("y")
    system = System(q, v, v**2 / 2 - c.gravity * q, contact=q, restitution=restitution, params=c)
    return Model(
        name="bouncing_ball",
        system=system,
        q0=height,
        v0=0.0,
        duration=4.0 * scale,
        h=0.02 * scale,
        claim="Each impact leaves e² of the energy; infinitely many take a finite time.",
        source=(
            "Goldsmith, Impact (1960), ch. 1; Fetecau, Marsden, Ortiz & West, SIAM J. Appl. Dyn. "
            "Syst. 2 (2003)."
        ),
        invariants=energy(system) if restitution == 1 else {},
    )


def slide_off_sphere(theta0: float = 0.2, gravity: float = 9.81) -> Model:
    """Particle on a smooth sphere of radius 1: it leaves it at cos θ = ⅔ cos θ₀ and falls to the
    floor y = −1.
    """
    scale = _sphere_time(theta0, gravity) / _sphere_time(0.2, 9.81)
    c = Parameters(gravity=gravity)
    q, v = coordinates("x", "y")
    ground = ca.vertcat(ca.sqrt(ca.sumsqr(q)) - 1, q[1] + 1)
    system = System(q, v, ca.sumsqr(v) / 2 - c.gravity * q[1], contact=ground, params=c)
    return Model(
        name="slide_off_sphere",
        system=system,
        q0=[np.sin(theta0), np.cos(theta0)],
        v0=[0, 0],
        duration=1.2 * scale,
        h=0.01 * scale,
        claim="The particle leaves the sphere at cos θ = ⅔ cos θ₀.",
        source="Goldstein, Classical Mechanics, 3rd ed., ch. 1.",
    )


def slack_string(speed: float = 6.264183905346330, gravity: float = 9.81) -> Model:
    """Pendulum on a string, gap ℓ − |r| ≥ 0: it flies free where the tension would turn
    negative.
    """
    scale = _string_time(speed, gravity) / _string_time(2 * np.sqrt(9.81), 9.81)
    c = Parameters(gravity=gravity)
    q, v = coordinates("x", "y")
    system = System(
        q, v, ca.sumsqr(v) / 2 - c.gravity * q[1], contact=1 - ca.sqrt(ca.sumsqr(q)), params=c
    )
    return Model(
        name="slack_string",
        system=system,
        q0=[0, -1],
        v0=[speed, 0],
        duration=1.5 * scale,
        h=0.01 * scale,
        claim="The string goes slack where v² = −g ℓ cos θ; for v₀² = 4 g ℓ at cos θ = −⅔.",
        source="Goldstein, Classical Mechanics, 3rd ed., ch. 1.",
    )

"""Scenes whose paths between end points have names: geodesics, the brachistochrone, the
catenary.
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from varint.errors import InputError
from varint.models.model import Model, energy
from varint.scene.geodesic import geodesic
from varint.scene.parameters import Parameters
from varint.scene.system import System, coordinates

MOST_ITERATIONS = 200  # of bisections; 60 reach round-off


def great_circle(colatitude: float = 1.0, heading: float = 0.7, R: float = 1.0) -> Model:
    """Free particle on a sphere, L = ½ R² (θ̇² + sin²θ φ̇²); it starts with unit speed at
    `heading` from the south.
    """
    c = Parameters(R=R)
    q, v = coordinates("theta", "phi")
    place = c.R * ca.vertcat(ca.sin(q[0]) * ca.cos(q[1]), ca.sin(q[0]) * ca.sin(q[1]), ca.cos(q[0]))
    system = geodesic(q, v, place, params=c)
    south, east = np.cos(heading) / R, np.sin(heading) / (R * np.sin(colatitude))
    start = np.array([np.sin(colatitude), 0.0, np.cos(colatitude)])
    ahead = np.array(
        [
            np.cos(colatitude) * np.cos(heading),
            np.sin(heading),
            -np.sin(colatitude) * np.cos(heading),
        ]
    )

    def exact(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        x = np.outer(np.cos(t / R), start) + np.outer(np.sin(t / R), ahead)
        dx = (np.outer(np.cos(t / R), ahead) - np.outer(np.sin(t / R), start)) / R
        rho = np.hypot(x[:, 0], x[:, 1])
        q = np.stack([np.arctan2(rho, x[:, 2]), np.unwrap(np.arctan2(x[:, 1], x[:, 0]))], axis=1)
        turning = (x[:, 0] * dx[:, 1] - x[:, 1] * dx[:, 0]) / rho**2
        return q, np.stack([-dx[:, 2] / rho, turning], axis=1)

    return Model(
        name="great_circle",
        system=system,
        q0=[colatitude, 0.0],
        v0=[south, east],
        duration=6.0,
        h=0.02,
        invariants=energy(system) | {"angular momentum about z": system.momentum[1]},
        exact=exact,
        claim=(
            "A free particle on a sphere moves along a great circle; past the antipode it is no "
            "longer the shortest."
        ),
        source="do Carmo, Differential Geometry of Curves and Surfaces, §4.4",
    )


def torus_geodesic(
    u: float = 0.0,
    udot: float = 0.9791586370343542,
    vdot: float = 0.2220035600966659,
    R: float = 2.0,
    r: float = 0.8,
) -> Model:
    """Free particle on a torus, L = ½ (r² u̇² + (R + r cos u)² v̇²), u round the tube and v
    round the axis.
    """
    c = Parameters(R=R, r=r)
    q, v = coordinates("u", "v")
    around = c.R + c.r * ca.cos(q[0])
    place = ca.vertcat(around * ca.cos(q[1]), around * ca.sin(q[1]), c.r * ca.sin(q[0]))
    system = geodesic(q, v, place, params=c)
    return Model(
        name="torus_geodesic",
        system=system,
        q0=[u, 0.0],
        v0=[udot, vdot],
        duration=30.0,
        h=0.05,
        invariants=energy(system) | {"Clairaut's constant": around**2 * v[1]},
        claim=(
            "Clairaut's constant keeps a geodesic that is slow about the axis from the inner "
            "equator."
        ),
        source="do Carmo, Differential Geometry of Curves and Surfaces, §4.4, Clairaut's relation",
    )


def spheroid_geodesic(
    beta: float = 0.8,
    heading: float = 1.0,
    a: float = 6384.0,
    b: float = 6353.0,
    speed: float = 1000.0,
) -> Model:
    """Free particle on an ellipsoid of revolution (km), in reduced latitude β and longitude λ."""
    c = Parameters(a=a, b=b)
    q, v = coordinates("beta", "longitude")
    place = ca.vertcat(
        c.a * ca.cos(q[0]) * ca.cos(q[1]), c.a * ca.cos(q[0]) * ca.sin(q[1]), c.b * ca.sin(q[0])
    )
    system = geodesic(q, v, place, params=c)
    north = np.hypot(a * np.sin(beta), b * np.cos(beta))
    start = [speed * np.cos(heading) / north, speed * np.sin(heading) / (a * np.cos(beta))]
    return Model(
        name="spheroid_geodesic",
        system=system,
        q0=[beta, 0.0],
        v0=start,
        duration=40.0,
        h=0.1,
        invariants=energy(system) | {"Clairaut's constant": (c.a * ca.cos(q[0])) ** 2 * v[1]},
        claim=(
            "On the Earth's spheroid the shortest way is no plane curve, yet keeps Clairaut's "
            "constant."
        ),
        source="Karney, J. Geodesy 87 (2013) 43",
    )


def brachistochrone(X: float = 1.0, depth: float = 1.0, g: float = 9.81) -> Model:
    """Curve of quickest descent, L = (ẋ²/w² + ẇ²)/(2g) + ½ with the depth y = ½ w².

    It is Fermat's principle for the speed √(2gy): with free duration H = 0, so that t is the time
    and S is the time of descent. In w = √(2y) the path is smooth at its start from rest. The model
    starts one radian down the cycloid.
    """
    c = Parameters(g=g)
    q, v = coordinates("x", "w")
    system = System(q, v, (v[0] ** 2 / q[1] ** 2 + v[1] ** 2) / (2 * c.g) + 0.5, params=c)
    radius, _ = cycloid(X, depth)
    rate, start = np.sqrt(g / radius), 1.0

    def exact(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        turn = start + rate * t
        q = np.stack(
            [radius * (turn - np.sin(turn)), 2 * np.sqrt(radius) * np.sin(turn / 2)], axis=1
        )
        v = np.stack([radius * (1 - np.cos(turn)), np.sqrt(radius) * np.cos(turn / 2)], axis=1)
        return q, rate * v

    q0, v0 = (x[0] for x in exact(np.zeros(1)))
    return Model(
        name="brachistochrone",
        system=system,
        q0=q0,
        v0=v0,
        duration=0.24,
        h=0.002,
        invariants=energy(system) | {"momentum along x": system.momentum[0]},
        exact=exact,
        claim="The curve of quickest descent is a cycloid.",
        source=(
            "Johann Bernoulli, Acta Eruditorum 1697; Goldstine, A History of the Calculus of "
            "Variations, §1.6"
        ),
    )


def cycloid(X: float, depth: float) -> tuple[float, float]:
    """(R, θ): radius and end parameter of the cycloid x = R (θ − sin θ), y = R (1 − cos θ) through
    (X, depth).

    Examples
    --------
    >>> from varint.models.paths import cycloid
    >>> [round(x, 12) for x in cycloid(3.141592653589793, 2.0)]
    [1.0, 3.14159265359]
    """
    if not (X > 0 and depth > 0):
        raise InputError(
            f"the cycloid ends below its start and beside it: X and depth are positive, got {X}, "
            f"{depth}"
        )
    low, high = 0.0, 2 * np.pi
    for _ in range(MOST_ITERATIONS):
        turn = (low + high) / 2
        if (turn - np.sin(turn)) * depth < X * (1 - np.cos(turn)):
            low = turn
        else:
            high = turn
    return float(depth / (1 - np.cos(turn))), float(turn)


def catenary(c: float = 0.5, start: float = -1.0) -> Model:
    """Hanging chain, L = ½ (ẋ² + ẏ² − ℓ̇²) + y ℓ̇ with the length ℓ of the chain so far, at energy
    0.

    Energy 0 makes ℓ the length of arc, and S = ∫ y dℓ the potential energy. The momentum of ℓ, y −
    ℓ̇, is the height of the directrix. Between (x₀, y₀, 0) and (x₁, y₁, length) the chain hangs
    from both ends.
    """
    q, v = coordinates("x", "y", "length")
    system = System(q, v, (v[0] ** 2 + v[1] ** 2 - v[2] ** 2) / 2 + q[1] * v[2])

    def exact(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        s = start + t
        q = np.stack([c * s, c * np.cosh(s), c * (np.sinh(s) - np.sinh(start))], axis=1)
        return q, np.stack([c + 0 * s, c * np.sinh(s), c * np.cosh(s)], axis=1)

    q0, v0 = (x[0] for x in exact(np.zeros(1)))
    return Model(
        name="catenary",
        system=system,
        q0=q0,
        v0=v0,
        duration=2.0,
        h=0.02,
        invariants=energy(system) | {"horizontal tension": v[0], "directrix": system.momentum[2]},
        exact=exact,
        claim="A hanging chain is a catenary, and its horizontal tension is everywhere the same.",
        source=(
            "Gelfand & Fomin, Calculus of Variations, §12; the isoperimetric condition as a third "
            "coordinate"
        ),
    )

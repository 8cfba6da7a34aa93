"""N particles with pair potentials: gravity, springs, Lennard-Jones; figure-eight, two bodies,
outer Solar System.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import combinations

import casadi as ca
import numpy as np

from varint.models.central import kepler_motion, require_ellipse
from varint.models.model import Model, Motion, energy
from varint.scene.parameters import Parameters
from varint.scene.system import System, coordinates

PairPotential = Callable[[ca.SX, int, int], ca.SX]


def pairs(positions: np.ndarray, params: Parameters, potential: PairPotential) -> System:
    """N particles with L = ½ Σ mᵢ |vᵢ|² − Σ V(|rᵢ − rⱼ|, i, j).

    Parameters
    ----------
    positions : array (N, d)
        Gives the number of particles and the dimension, 2 or 3.
    params : Parameters
        Must have ``m``, the masses (N,).
    potential : callable
        ``V(r, i, j)`` of the distance of the particles i < j, as a CasADi expression.
    """
    count, d = np.shape(positions)
    q, v = coordinates(*(f"{axis}{i + 1}" for i in range(count) for axis in "xyz"[:d]))
    place = [q[d * i : d * (i + 1)] for i in range(count)]
    kinetic = ca.dot(params.m, ca.sum1(ca.reshape(v, d, count) ** 2).T) / 2
    each = (
        potential(ca.norm_2(place[i] - place[j]), i, j) for i, j in combinations(range(count), 2)
    )
    total = ca.sum1(ca.vertcat(*each))
    return System(q, v, kinetic - total, params=params)


def _kept(system: System, count: int) -> dict[str, ca.SX]:
    """Energy, total momentum and angular momentum."""
    d = system.q.numel() // count
    place, p = ca.reshape(system.q, d, count), ca.reshape(system.momentum, d, count)
    each = place[0, :] * p[1, :] - place[1, :] * p[0, :] if d == 2 else ca.cross(place, p, 1)
    return energy(system) | {"momentum": ca.sum2(p), "angular momentum": ca.sum2(each)}


def many_bodies(
    name: str,
    q0,
    v0,
    params: Parameters,
    potential: PairPotential,
    duration: float,
    h: float,
    claim: str,
    source: str,
    exact: Motion | None = None,
) -> Model:
    """The model of particles (N, d) with a pair potential, and what such a scene keeps."""
    system = pairs(q0, params, potential)
    return Model(
        name=name,
        system=system,
        q0=np.ravel(q0),
        v0=np.ravel(v0),
        duration=duration,
        h=h,
        invariants=_kept(system, len(q0)),
        exact=exact,
        claim=claim,
        source=source,
    )


def newtonian(c: Parameters) -> PairPotential:
    """Gravity, V = −G mᵢ mⱼ / r."""
    return lambda r, i, j: -c.G * c.m[i] * c.m[j] / r


def two_body(
    a: float = 1.5,
    e: float = 0.4,
    m: Sequence[float] = (3.0, 1.0),
    G: float = 1.0,
    centre: Sequence[float] = (0.2, -0.1),
    drift: Sequence[float] = (0.05, 0.15),
) -> Model:
    """Two gravitating bodies in the plane, started at the pericentre, their centre of mass
    moving.
    """
    require_ellipse(e)
    c = Parameters(m=m, G=G)
    (m1, m2), total = m, m[0] + m[1]
    apart = np.array([a * (1 - e), 0])
    closing = np.array([0, np.sqrt(G * total / a * (1 + e) / (1 - e))])
    parts = np.array([[-m2 / total], [m1 / total]])

    def exact(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        r, rdot = kepler_motion(t, G * total, apart, closing)
        middle = np.asarray(centre) + np.outer(t, drift)
        return middle[:, None] + parts * r[:, None], np.asarray(drift) + parts * rdot[:, None]

    return many_bodies(
        "two_body",
        centre + parts * apart,
        drift + parts * closing,
        c,
        newtonian(c),
        40.0,
        0.02,
        "The relative motion is Kepler's with the reduced mass; the centre of mass moves "
        "uniformly.",
        "Landau & Lifshitz, Mechanics, §13",
        exact,
    )


def lagrange_triangle(
    m: Sequence[float] = (1.0, 2.0, 3.0), side: float = 1.0, G: float = 1.0
) -> Model:
    """Three bodies at the corners of an equilateral triangle that turns rigidly, ω² = G M / a³
    (unstable).
    """
    c = Parameters(m=m, G=G)
    mass = np.asarray(m, dtype=float)
    corners = side * np.array([[-0.5, 0], [0.5, 0], [0, np.sqrt(3) / 2]])
    corners -= mass @ corners / mass.sum()
    omega = np.sqrt(G * mass.sum() / side**3)

    def exact(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        cosine, sine = np.cos(omega * t), np.sin(omega * t)
        turned = np.moveaxis(np.array([[cosine, -sine], [sine, cosine]]), -1, 0)
        place = np.einsum("tab,ib->tia", turned, corners)
        return place, omega * np.stack([-place[..., 1], place[..., 0]], -1)

    return many_bodies(
        "lagrange_triangle",
        corners,
        exact(np.zeros(1))[1][0],
        c,
        newtonian(c),
        2.5,
        0.005,
        "The triangle turns rigidly, whatever the masses.",
        "Lagrange 1772",
        exact,
    )


def figure_eight() -> Model:
    """Three equal bodies that chase each other along one figure-eight."""
    c = Parameters(m=np.ones(3), G=1.0)
    v = np.array([0.34711688811892694, 0.5327249453880303])
    return many_bodies(
        "figure_eight",
        [[-1, 0], [1, 0], [0, 0]],
        [v, v, -2 * v],
        c,
        newtonian(c),
        FIGURE_EIGHT_PERIOD,
        FIGURE_EIGHT_PERIOD / 600,
        "After a third of the period each body is where the next one was.",
        "Chenciner & Montgomery, Annals of Mathematics 152 (2000) 881; initial data refined by "
        "Newton's method",
    )


FIGURE_EIGHT_PERIOD = 6.325913982926211


def spring_cluster(d: int = 3, stiffness: float = 10.0, rest: float = 1.0) -> Model:
    """Four masses joined each to each by springs of natural length ℓ, V = ½ k (r − ℓ)², in 2 or
    3 dimensions.
    """
    c = Parameters(m=[1.0, 1.5, 2.0, 2.5], stiffness=stiffness, rest=rest)
    q0 = np.array([[0.1, 0, 0], [1.2, 0, 0.1], [0.4, 1, -0.1], [0.5, 0.4, 0.9]])[:, :d]
    v0 = np.array([[0, 0.3, 0], [0, -0.2, 0.4], [0.5, 0, 0], [-0.2, 0, -0.1]])[:, :d]
    return many_bodies(
        "spring_cluster",
        q0,
        v0,
        c,
        lambda r, i, j: c.stiffness * (r - c.rest) ** 2 / 2,
        20.0,
        0.02,
        "Springs between the particles change neither the total momentum nor the angular momentum.",
        "Landau & Lifshitz, Mechanics, §7 and §9",
    )


def lennard_jones(
    side: int = 3, d: int = 2, epsilon: float = 1.0, sigma: float = 1.0, heat: float = 0.3
) -> Model:
    """A small crystal of argon-like atoms, V = 4 ε [(σ/r)¹² − (σ/r)⁶], on a square or cubic grid
    of `side` each way.
    """
    grid = (
        np.stack(np.meshgrid(*[np.arange(side)] * d, indexing="ij"), -1).reshape(-1, d)
        * 2 ** (1 / 6)
        * sigma
    )
    c = Parameters(m=np.ones(len(grid)), epsilon=epsilon, sigma=sigma)
    v0 = heat * np.random.default_rng(1).standard_normal(grid.shape)
    return many_bodies(
        "lennard_jones",
        grid,
        v0 - v0.mean(0),
        c,
        lambda r, i, j: 4 * c.epsilon * ((c.sigma / r) ** 12 - (c.sigma / r) ** 6),
        10.0,
        0.005,
        "Atoms exchange energy through collisions; total energy, momentum and angular momentum "
        "stay.",
        "Hairer, Lubich & Wanner, Geometric Numerical Integration, I.4",
    )


def outer_solar_system() -> Model:
    """Jupiter, Saturn, Uranus, Neptune, Pluto and the Sun with the inner planets; AU, days,
    solar masses.
    """
    c = Parameters(m=[body[0] for body in OUTER_SOLAR_SYSTEM.values()], G=2.95912208286e-4)
    q0, v0 = (np.array([body[i] for body in OUTER_SOLAR_SYSTEM.values()]) for i in (1, 2))
    return many_bodies(
        "outer_solar_system",
        q0,
        v0,
        c,
        newtonian(c),
        200_000.0,
        100.0,
        "Over 200,000 days the energy error stays bounded and every orbit stays in place.",
        "Hairer, Lubich & Wanner, Geometric Numerical Integration, I.2.4 and Table 2.2 (data: "
        "Ahnerts Kalender 1994)",
    )


# mass (Sun = 1, inner planets added to it), position (AU), velocity (AU/day), 5 September 1994
OUTER_SOLAR_SYSTEM = {
    "Jupiter": (
        0.000954786104043,
        (-3.5023653, -3.8169847, -1.5507963),
        (0.00565429, -0.00412490, -0.00190589),
    ),
    "Saturn": (
        0.000285583733151,
        (9.0755314, -3.0458353, -1.6483708),
        (0.00168318, 0.00483525, 0.00192462),
    ),
    "Uranus": (
        0.0000437273164546,
        (8.3101420, -16.2901086, -7.2521278),
        (0.00354178, 0.00137102, 0.00055029),
    ),
    "Neptune": (
        0.0000517759138449,
        (11.4707666, -25.7294829, -10.8169456),
        (0.00288930, 0.00114527, 0.00039677),
    ),
    "Pluto": (
        1 / 1.3e8,
        (-15.5387357, -25.2225594, -3.1902382),
        (0.00276725, -0.00170702, -0.00136504),
    ),
    "Sun": (1.00000597682, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
}

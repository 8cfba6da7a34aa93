"""The Sun and its eight planets."""

from __future__ import annotations

import numpy as np

from varint.models.model import Model
from varint.models.particles import many_bodies, newtonian
from varint.orbits.kepler import kepler_state
from varint.scene.parameters import Parameters

G = 2.9591220828559115e-4  # Gauss's k², AU³ per solar mass and day²
# Sun's mass to the planet's with its satellites; a (AU), e, inclination, mean longitude, longitudes
# of the pericentre and of the node (degrees) about the Sun, ecliptic and equinox of J2000
PLANETS = {
    "Mercury": (
        6023600.0,
        0.38709927,
        0.20563593,
        7.00497902,
        252.25032350,
        77.45779628,
        48.33076593,
    ),
    "Venus": (
        408523.71,
        0.72333566,
        0.00677672,
        3.39467605,
        181.97909950,
        131.60246718,
        76.67984255,
    ),
    "Earth": (328900.56, 1.00000261, 0.01671123, -0.00001531, 100.46457166, 102.93768193, 0.0),
    "Mars": (3098708.0, 1.52371034, 0.09339410, 1.84969142, -4.55343205, -23.94362959, 49.55953891),
    "Jupiter": (
        1047.3486,
        5.20288700,
        0.04838624,
        1.30439695,
        34.39644051,
        14.72847983,
        100.47390909,
    ),
    "Saturn": (
        3497.898,
        9.53667594,
        0.05386179,
        2.48599187,
        49.95424423,
        92.59887831,
        113.66242448,
    ),
    "Uranus": (
        22902.98,
        19.18916464,
        0.04725744,
        0.77263783,
        313.23810451,
        170.95427630,
        74.01692503,
    ),
    "Neptune": (
        19412.24,
        30.06992276,
        0.00859048,
        1.77004347,
        -55.12002969,
        44.96476227,
        131.78422574,
    ),
}


def solar_system() -> Model:
    """The Sun and its eight planets, about their centre of mass; AU, days, solar masses.

    Body 1 is the Sun, 2 … 9 are Mercury to Neptune, each with its satellites.
    """
    ratio, a, e, inclination, longitude, pericentre, node = np.array(list(PLANETS.values())).T
    angles = np.radians([inclination, node, pericentre - node, longitude - pericentre])
    m = np.concatenate([[1.0], 1 / ratio])
    r, v = kepler_state(a, e, *angles, mu=G * (1 + m[1:]))
    states = [np.concatenate([np.zeros((1, 3)), x]) for x in (r, v)]
    q0, v0 = (x - m @ x / m.sum() for x in states)
    c = Parameters(m=m, G=G)
    return many_bodies(
        "solar_system",
        q0,
        v0,
        c,
        newtonian(c),
        36525.0,
        2.5,
        "Semi-major axes stay, eccentricities and inclinations go up and down over hundreds of "
        "thousands of years.",
        "Standish, Keplerian Elements for Approximate Positions of the Major Planets (JPL), table "
        "1, at J2000; masses: IAU 1976 and JPL DE405",
    )

"""Mass and inertia of primitive solids and shells, and of several that are joined."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class MassProperties:
    """Mass, centre of mass and inertia about it, in the axes of a frame."""

    mass: float
    com: np.ndarray
    inertia: np.ndarray  # (3, 3)

    def seen_from(self, position: np.ndarray, rotation: np.ndarray) -> MassProperties:
        """The same in a frame in which this one stands at a position, turned by a rotation."""
        return MassProperties(
            self.mass, position + rotation @ self.com, rotation @ self.inertia @ rotation.T
        )


NOTHING = MassProperties(0.0, np.zeros(3), np.zeros((3, 3)))


def joined(parts: Sequence[MassProperties]) -> MassProperties:
    """Several rigidly joined: Σ I + m (|d|² 1 − d dᵀ), d from the common centre of mass."""
    mass = sum(part.mass for part in parts)
    if mass == 0:
        return NOTHING
    com = sum((part.mass * part.com for part in parts), np.zeros(3)) / mass
    inertia = np.zeros((3, 3))
    for part in parts:
        d = part.com - com
        inertia = inertia + part.inertia + part.mass * (d @ d * np.eye(3) - np.outer(d, d))
    return MassProperties(mass, com, inertia)


def volume(kind: str, size: Sequence[float]) -> float:
    """Volume of a solid: radius of a sphere; radius and half-length of a cylinder or capsule (its
    cylinder); half-axes of a box or an ellipsoid.
    """
    a, b, c = (*size, 0.0, 0.0, 0.0)[:3]
    return {
        "sphere": 4 / 3 * np.pi * a**3,
        "capsule": np.pi * a**2 * (2 * b + 4 / 3 * a),
        "cylinder": 2 * np.pi * a**2 * b,
        "ellipsoid": 4 / 3 * np.pi * a * b * c,
        "box": 8 * a * b * c,
    }[kind]


def area(kind: str, size: Sequence[float]) -> float:
    """Surface of a solid."""
    a, b, c = (*size, 0.0, 0.0, 0.0)[:3]
    return {
        "sphere": 4 * np.pi * a**2,
        "capsule": 4 * np.pi * a * (a + b),
        "cylinder": 2 * np.pi * a * (a + 2 * b),
        "box": 8 * (a * b + b * c + c * a),
    }[kind]


def solid(kind: str, size: Sequence[float], mass: float) -> MassProperties:
    """A homogeneous solid about its centre, its axis along z."""
    a, b, c = (*size, 0.0, 0.0, 0.0)[:3]
    if kind == "sphere":
        diagonal = np.full(3, 2 / 5 * a**2)
    elif kind == "ellipsoid":
        diagonal = np.array([b**2 + c**2, a**2 + c**2, a**2 + b**2]) / 5
    elif kind == "box":
        diagonal = np.array([b**2 + c**2, a**2 + c**2, a**2 + b**2]) / 3
    elif kind == "cylinder":
        diagonal = np.array([a**2 / 4 + b**2 / 3, a**2 / 4 + b**2 / 3, a**2 / 2])
    else:  # a capsule: a cylinder and two half balls, whose centres of mass lie 3/8 a outside
        ball = 4 * a / (4 * a + 6 * b)  # share of the mass
        across = (1 - ball) * (a**2 / 4 + b**2 / 3) + ball * (2 / 5 * a**2 + b**2 + 3 / 4 * a * b)
        diagonal = np.array([across, across, (1 - ball) * a**2 / 2 + ball * 2 / 5 * a**2])
    return MassProperties(mass, np.zeros(3), mass * np.diag(diagonal))


def shell(kind: str, size: Sequence[float], mass: float) -> MassProperties:
    """A thin shell of even thickness about its centre, its axis along z."""
    a, b, c = (*size, 0.0, 0.0, 0.0)[:3]
    if kind == "sphere":
        diagonal = np.full(3, 2 / 3 * a**2)
    elif kind == "cylinder":  # its side and two discs
        discs = a / (a + 2 * b)
        across = (1 - discs) * (a**2 / 2 + b**2 / 3) + discs * (a**2 / 4 + b**2)
        diagonal = np.array([across, across, (1 - discs) * a**2 + discs * a**2 / 2])
    elif kind == "capsule":  # a side and two half spheres, centres of mass a/2 outside
        ball = a / (a + b)
        across = (1 - ball) * (a**2 / 2 + b**2 / 3) + ball * (2 / 3 * a**2 + b**2 + a * b)
        diagonal = np.array([across, across, (1 - ball) * a**2 + ball * 2 / 3 * a**2])
    else:  # a box: pairs of faces, each a plate
        half = np.array([a, b, c])
        face = np.array([b * c, c * a, a * b]) / (a * b + b * c + c * a)
        second = half**2 * (face + (1 - face) / 3)  # ∫x², the mean over all faces
        diagonal = second.sum() - second
    return MassProperties(mass, np.zeros(3), mass * np.diag(diagonal))

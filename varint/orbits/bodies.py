"""The bodies of a scene: which coordinates are whose, their masses, and the constant of gravity."""

from __future__ import annotations

from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from varint.drawing.sketch import cartesian
from varint.errors import InputError, parsed_or_refused
from varint.results.require import require_trajectory
from varint.results.trajectory import Trajectory
from varint.scene.system import System


class Bodies(NamedTuple):
    """Bodies of a motion.

    Attributes
    ----------
    names : tuple of str
    places : ndarray of int (B, d)
        Indices of their coordinates.
    masses : ndarray (B,)
    G : float
    """

    names: tuple[str, ...]
    places: np.ndarray
    masses: np.ndarray
    G: float


def body_places(system: System) -> dict[str, np.ndarray]:
    """Indices of the coordinates of each body, by its name.

    Raises
    ------
    InputError
        If the coordinates are not called x1, y1, z1, x2, … or alike.
    """
    read = cartesian(system.names, system.q)
    if read is None:
        raise InputError(
            "the bodies of this scene are not known: their coordinates must be called x1, y1, z1, "
            f"x2, …, or x_sun, y_sun, …; they are {list(system.names)}"
        )
    names = list(system.names)
    return {
        body: np.array([names.index(x.name()) for x in ca.vertsplit(place)])
        for body, place in read.points.items()
    }


def bodies_of(motion: Trajectory, masses: Any, G: Any) -> Bodies:
    """The bodies of a motion; masses and G are its parameters ``m`` and ``G`` unless given.

    Raises
    ------
    InputError
        If they are not known, or there are fewer than two bodies.
    """
    require_trajectory(motion)
    places = body_places(motion.system)
    if len(places) < 2:
        raise InputError("elements are of two bodies and more; the scene has one")

    def value(what: str, given: Any, name: str) -> np.ndarray:
        if given is None:
            if name not in motion.parameters:
                raise InputError(
                    f"the scene has no parameter {name!r}: give {what}= of its bodies "
                    f"{list(places)}"
                )
            return np.ravel(motion.parameters[name])
        if isinstance(given, ca.SX):
            return np.ravel(motion[:1].value(given))
        return parsed_or_refused(
            lambda: np.ravel(np.asarray(given, dtype=float)),
            lambda: f"{what} must be numbers, got {given!r}",
        )

    m, g = value("masses", masses, "m"), value("G", G, "G")
    if m.shape != (len(places),) or not (m >= 0).all() or m.max() <= 0:
        raise InputError(
            f"masses must be {len(places)} numbers, none negative and not all zero, one for each "
            f"of {list(places)}; got {m}"
        )
    if g.shape != (1,) or g[0] <= 0:
        raise InputError(f"G must be a positive number, got {g}")
    return Bodies(tuple(places), np.array(list(places.values())), m, float(g[0]))

"""A curve of orbits: what it goes along, and what changes along it are measured by."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from varint.orbits.orbit import Orbit
from varint.orbits.phase import Units
from varint.orbits.shooting import Iterate


@dataclass(frozen=True, eq=False)
class Curve:
    """What is continued, and what is held meanwhile.

    Attributes
    ----------
    along : str
        "energy", "period" or a parameter's name.
    index : int or None
        Of the parameter in ``system.c``.
    hold : str or None
        "energy" or "period", held where a parameter is varied.
    value : float
        Its value.
    drive : int
        The power of the parameter that the period of a driven scene goes with: −1 of a driving
        frequency, 1 of a driving period, 0 of others.
    """

    along: str
    index: int | None
    hold: str | None
    value: float
    drive: int = 0


class Direction(NamedTuple):
    """A change of an orbit: of the states (M, 2n), of the period, of the parameter."""

    x: np.ndarray
    period: float
    parameter: float


class Measures(NamedTuple):
    """What changes are measured by along a curve."""

    units: Units
    period: float
    parameter: float


def measures(orbit: Orbit, curve: Curve) -> Measures:
    """Ranges of the orbit, its period, and the size of the parameter."""
    value = 0.0 if curve.index is None else abs(float(orbit.at.c[curve.index]))
    return Measures(orbit.units, orbit.period, value or 1.0)


def product(a: Direction, b: Direction, by: Measures) -> float:
    """The inner product of two changes."""
    inner = float((a.x / by.units.scale * (b.x / by.units.scale)).sum() / len(a.x))
    inner += a.period * b.period / by.period**2
    return inner + a.parameter * b.parameter / by.parameter**2


def change(new: Iterate, old: Iterate, curve: Curve) -> Direction:
    """What leads from one orbit to another, at all beginnings where they are the same ones, else
    at the first.
    """
    moved = 0.0 if curve.index is None else float(new.c[curve.index] - old.c[curve.index])
    if new.x.shape != old.x.shape:
        new, old = (one._replace(x=one.x[:1]) for one in (new, old))
    return Direction(new.x - old.x, new.period - old.period, moved)


def scaled(a: Direction, factor: float) -> Direction:
    return Direction(factor * a.x, factor * a.period, factor * a.parameter)

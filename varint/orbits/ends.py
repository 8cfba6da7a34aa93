"""Where a family of orbits ends of itself: closed, or at an equilibrium."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from varint.errors import ConvergenceError, InputError
from varint.orbits.curve import Curve, change, product
from varint.orbits.orbit import Orbit
from varint.orbits.passages import Point
from varint.orbits.rest import require_restful, rest

FEWEST = 8  # orbits of a closed family
SHRUNK = 1e-3  # of the family's largest orbit: look for what the orbits shrink to


def is_back(orbits: Sequence[Orbit], here: Point, length: float, curve: Curve) -> bool:
    """Whether the family has come back to its first orbit."""
    if len(orbits) < FEWEST:
        return False
    away = change(here.orbit.at, orbits[0].at, curve)
    return product(away, away, here.by) < length**2 / 4


def is_at_rest(orbits: Sequence[Orbit]) -> bool:
    """Whether the last orbit is a thousandth of the largest and goes round an equilibrium.

    Steps are measured by the orbit's own ranges: from there a family would go on to shrink by a
    part in each, until its orbits are round-off.
    """
    last, size = orbits[-1], max(float(one.units.length.max()) for one in orbits)
    ranges = last.units.length
    if float(ranges.max()) > SHRUNK * size:
        return False
    middle = (last.motion.q.min(axis=0) + last.motion.q.max(axis=0)) / 2
    try:
        require_restful(last.shooting.system)
        still = rest(last.shooting.system, middle, last.at.c)
    except (ConvergenceError, InputError):
        return False
    return bool(np.abs(still.q - middle).max() < float(ranges.max()))

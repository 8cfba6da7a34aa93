"""Orbits and families from files."""

from __future__ import annotations

from typing import Any

import numpy as np

from varint.errors import InputError
from varint.numerics.plain import field_of
from varint.orbits.family import Family
from varint.orbits.files import FORMAT
from varint.orbits.orbit import Orbit
from varint.orbits.save import Saved, read_orbits

__all__ = ["FORMAT", "orbits_of"]


def orbits_of(header: dict[str, Any], arrays: dict[str, np.ndarray]) -> Orbit | Family:
    """What a file holds.

    Raises
    ------
    InputError
        If parts are missing or do not fit.
    """
    kind = field_of(header, "kind", str)
    orbits = tuple(_orbit(one) for one in read_orbits(header, arrays))
    if kind == "orbit" and len(orbits) == 1:
        return orbits[0]
    if kind != "family":
        raise InputError(f"it holds {len(orbits)} orbits as a {kind!a}")
    words = field_of(header, "extra", dict[str, str])
    return Family(orbits, field_of(words, "along", str), (), field_of(words, "ended", str))


def _orbit(one: Saved) -> Orbit:
    residual, error, period_error, iterations = (float(x) for x in one.numbers)
    return Orbit(one.shooting, one.at, one.units, residual, error, period_error, int(iterations))

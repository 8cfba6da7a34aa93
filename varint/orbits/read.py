"""Orbits, families and equilibria from files."""

from __future__ import annotations

from typing import Any

import numpy as np

from varint.errors import InputError
from varint.numerics.plain import field_of, record_of
from varint.orbits.bifurcations import Bifurcation
from varint.orbits.continuation import Curve, Direction
from varint.orbits.equilibria import Equilibria
from varint.orbits.family import Family
from varint.orbits.files import FORMAT
from varint.orbits.modes import NormalModes, normal_modes
from varint.orbits.orbit import Orbit
from varint.orbits.resting import EQUILIBRIA, MODES, saved_equilibria
from varint.orbits.save import Met, Saved, read_met, read_orbits

__all__ = ["FORMAT", "READ", "orbits_of"]

READ = "orbit", "family", EQUILIBRIA, MODES  # kinds


def orbits_of(
    header: dict[str, Any], arrays: dict[str, np.ndarray]
) -> Orbit | Family | Equilibria | NormalModes:
    """What a file holds.

    Raises
    ------
    InputError
        If parts are missing or do not fit.
    """
    kind = field_of(header, "kind", str)
    if kind in (EQUILIBRIA, MODES):
        still = saved_equilibria(header, arrays)
        return Equilibria(still) if kind == EQUILIBRIA else normal_modes(still[0].system, still[0])
    saved = read_orbits(header, arrays)
    orbits = tuple(_orbit(one) for one in saved)
    if kind == "orbit" and len(orbits) == 1:
        return orbits[0]
    if kind != "family":
        raise InputError(f"it holds {len(orbits)} orbits as a {kind!a}")
    words = field_of(header, "extra", dict[str, str])
    met = read_met(header, arrays, saved)
    count = len(orbits) - len(met)
    branching = tuple(map(_bifurcation, met, orbits[count:]))
    along, ended = (field_of(words, name, str) for name in ("along", "ended"))
    return Family(orbits[:count], along, branching, ended)


def _bifurcation(met: Met, orbit: Orbit) -> Bifurcation:
    *x, period, parameter = met.tangent
    tangent = Direction(np.array(x).reshape(orbit.at.x.shape), float(period), float(parameter))
    curve = record_of(Curve, "curve", met.curve)
    if curve.index is not None and not 0 <= curve.index < len(orbit.at.c):
        raise InputError(f"the scene has no parameter number {curve.index}")
    return Bifurcation(met.kind, orbit, met.value, tangent, curve)


def _orbit(one: Saved) -> Orbit:
    residual, error, period_error, iterations = (float(x) for x in one.numbers)
    return Orbit(one.shooting, one.at, one.units, residual, error, period_error, int(iterations))

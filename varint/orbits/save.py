"""Orbits and families on disk: one ``.npz`` file, no pickle, read back by `varint.load`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from varint.errors import InputError
from varint.numerics.archive import write_archive
from varint.numerics.files import VERSION, write_atomically
from varint.numerics.plain import field_of, finite, plain
from varint.orbits.files import FORMAT
from varint.orbits.phase import Integrals, Units, integrals
from varint.orbits.shooting import Iterate, Shooting
from varint.results.save import file_path
from varint.scene.serialisation import describe, revive, rule_of

MOST_ORBITS, MOST_STEPS = 100_000, 10**7


class Saved(NamedTuple):
    """What a file holds of an orbit: how it is run, the orbit, units, and four numbers."""

    shooting: Shooting
    at: Iterate
    units: Units
    numbers: np.ndarray


def saved_orbit(orbit: Any) -> Saved:
    """What is written of an Orbit."""
    found = [orbit.residual, orbit.error_estimate, orbit.period_error, float(orbit.iterations)]
    return Saved(orbit.shooting, orbit.at, orbit.units, np.array(found))


def save_orbits(
    path: Any,
    kind: str,
    orbits: Sequence[Saved],
    extra: Mapping | None = None,
    met: Sequence[Any] = (),
) -> None:
    """Write orbits of one scene and rule, and bifurcations that were met among them.

    Raises
    ------
    InputError
        If the folder does not exist or cannot be written.
    """
    first, count = orbits[0].shooting, len(orbits)
    orbits = [*orbits, *(saved_orbit(one.orbit) for one in met)]
    header = {
        "format": FORMAT,
        "version": VERSION,
        "kind": kind,
        "system": describe(first.system),
        "rule": plain(first.rule),
        "t0": first.t0,
        "extra": plain(dict(extra or {})),
        "met": [
            {"kind": one.kind, "value": float(one.value), "curve": plain(one.curve)} for one in met
        ],
        "orbits": [
            {"segments": one.shooting.segments, "each": one.shooting.each} for one in orbits
        ],
    }
    arrays: dict[str, Any] = {"shift": first.shift}
    for i, one in enumerate(orbits):
        parts = [one.at.x.ravel(), [one.at.period], one.at.c, one.units.length]
        numbers = np.concatenate([*parts, [one.units.action], one.numbers])
        arrays[f"orbit_{i}"] = numbers
        if one.shooting.parts is not None:
            arrays[f"parts_{i}"] = one.shooting.parts
    for i, one in enumerate(met, start=count):
        along = one.tangent
        arrays[f"tangent_{i}"] = np.append(along.x.ravel(), [along.period, along.parameter])
    path = file_path(path)
    write_atomically(path, lambda file: write_archive(file, header, arrays, compress=True))


def read_orbits(header: dict[str, Any], arrays: dict[str, np.ndarray]) -> list[Saved]:
    """The orbits of a file, checked.

    Raises
    ------
    InputError
        If parts are missing or do not fit.
    """
    system, rule = revive(header.get("system")), rule_of(header.get("rule"))
    n, many = system.structure.n, system.c.numel()
    t0 = finite("t0", field_of(header, "t0", float))
    grids = field_of(header, "orbits", list[dict[str, int]])
    shift = _row(arrays, "shift", n)
    if not 0 < len(grids) <= MOST_ORBITS:
        raise InputError(f"it holds {len(grids)} orbits")
    found: list[Saved] = []
    known: Integrals | None = None
    for i, grid in enumerate(grids):
        segments, each = (field_of(grid, name, int) for name in ("segments", "each"))
        if not (0 < segments <= MOST_STEPS and 0 < each <= MOST_STEPS):
            raise InputError(f"orbit {i} has {segments} segments of {each} steps")
        numbers = _row(arrays, f"orbit_{i}", segments * 2 * n + 1 + many + n + 1 + 4)
        sizes = np.cumsum([segments * 2 * n, 1, many, n, 1])
        x, period, c, length, action, rest = np.split(numbers, sizes)
        if period[0] <= 0 or (length <= 0).any() or action[0] <= 0:
            raise InputError(f"period or units of orbit {i} are not positive")
        at = Iterate(x.reshape(segments, 2 * n), float(period[0]), c)
        if known is None:
            known = integrals(system, c, at.x[0, :n], None)
        shooting = Shooting(
            system, rule, segments, each, t0, shift, known, _parts(arrays, i, segments)
        )
        found.append(Saved(shooting, at, Units(length, float(action[0])), rest))
    return found


class Met(NamedTuple):
    """What a file holds of a bifurcation besides its orbit."""

    kind: str
    value: float
    curve: dict[str, Any]
    tangent: np.ndarray


def read_met(
    header: dict[str, Any], arrays: dict[str, np.ndarray], found: list[Saved]
) -> list[Met]:
    """The bifurcations of a file, whose orbits are its last ones, checked.

    Raises
    ------
    InputError
        If parts are missing or do not fit.
    """
    listed = header.get("met", [])
    if not isinstance(listed, list) or len(listed) >= len(found):
        raise InputError("the bifurcations it holds do not fit its orbits")
    met, first = [], len(found) - len(listed)
    for i, one in enumerate(listed, start=first):
        tangent = _row(arrays, f"tangent_{i}", found[i].at.x.size + 2)
        value = finite("value", field_of(one, "value", float))
        curve = field_of(one, "curve", dict)
        met.append(Met(field_of(one, "kind", str), value, curve, tangent))
    return met


def _parts(arrays: dict[str, np.ndarray], i: int, segments: int) -> np.ndarray | None:
    """Durations of the segments of an orbit, in periods, where they differ."""
    if f"parts_{i}" not in arrays:
        return None
    parts = _row(arrays, f"parts_{i}", segments)
    if not (parts > 0).all() or abs(parts.sum() - 1) > 1e-9:
        raise InputError(f"the segments of orbit {i} do not make up a period")
    return parts


def _row(arrays: dict[str, np.ndarray], name: str, size: int) -> np.ndarray:
    """An array of so many finite numbers."""
    if name not in arrays or arrays[name].shape != (size,) or arrays[name].dtype.kind != "f":
        raise InputError(f"{name} is missing, or not {size} numbers")
    if not np.isfinite(arrays[name]).all():
        raise InputError(f"{name} is not finite")
    return arrays[name]

"""Equilibria and their modes on disk: one ``.npz`` file, no pickle, read back by `varint.load`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from varint.errors import InputError
from varint.numerics.archive import write_archive
from varint.numerics.files import VERSION, write_atomically
from varint.orbits.files import FORMAT
from varint.orbits.rest import Equilibrium, require_restful
from varint.results.save import file_path
from varint.scene.serialisation import describe, revive

EQUILIBRIA, MODES = "equilibria", "modes"


def save_equilibria(path: Any, kind: str, items: Sequence[Equilibrium]) -> None:
    """Write equilibria of one scene; modes follow from them.

    Raises
    ------
    InputError
        If the folder does not exist or cannot be written, or the disk is full.
    """
    header = {
        "format": FORMAT,
        "version": VERSION,
        "kind": kind,
        "system": describe(items[0].system),
    }
    names = "q", "multipliers", "c"
    arrays = {name: np.array([getattr(one, name) for one in items]) for name in names}
    arrays["residual"] = np.array([one.residual for one in items])
    path = file_path(path)
    write_atomically(path, lambda file: write_archive(file, header, arrays, compress=True))


def saved_equilibria(
    header: dict[str, Any], arrays: dict[str, np.ndarray]
) -> tuple[Equilibrium, ...]:
    """The equilibria in a file, checked.

    Raises
    ------
    InputError
        If parts are missing or do not fit the scene.
    """
    system = revive(header.get("system"))
    require_restful(system)
    s, count = system.structure, len(arrays.get("q", ()))
    sizes = {"q": (s.n,), "multipliers": (s.velocity_rows,), "c": (system.c.numel(),)}
    for name, size in (sizes | {"residual": ()}).items():
        found = arrays.get(name)
        if found is None or found.shape != (count, *size) or found.dtype.kind != "f":
            raise InputError(f"{name} is missing, or does not fit the scene")
        if not np.isfinite(found).all():
            raise InputError(f"{name} is not finite")
    if not count:
        raise InputError("it holds no equilibrium")
    rows = zip(*(arrays[name] for name in (*sizes, "residual")), strict=True)
    return tuple(Equilibrium(system, q, lam, c, float(left)) for q, lam, c, left in rows)

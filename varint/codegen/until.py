"""Steps of a scene with a clock among its coordinates until the clock shows a wanted time, in one
call of c/until_core.c.
"""

from __future__ import annotations

import struct
from ctypes import c_void_p, cast
from typing import Any, NamedTuple

import numpy as np

from varint.codegen.arguments import DONE
from varint.codegen.core import rows_entry, until_entry
from varint.codegen.kernel import Kernel, new_address
from varint.codegen.rows import RowFunction
from varint.numerics.limits import FIXED_POINT_ITERATIONS

_ASKED = struct.Struct("8P5q6d")  # Until
ROOM = 2**18  # numbers of nodes: longer runs are watched on their way
TOLD = 5

# memory for nodes that no call uses, and where it lies
_rooms: list[tuple[np.ndarray, int]] = []


class Entries(NamedTuple):
    """Addresses of a loop and of the energies of its scene, and what lies there."""

    n: int
    carry: int
    run: int
    scene: int
    rows: int
    energies: int
    entry: Any
    held: tuple


def entries_of(kernel: Kernel, energies: RowFunction) -> Entries:
    """Where they are; `energies` is of (q, p): the energy that a start has, its p·v, the energy
    that is constant, its p·v.

    Raises
    ------
    CompileError
        If the loops were not built with the package and cannot be compiled.
    """
    entries: tuple[Any, ...] = (kernel.entry, rows_entry())
    run, rows = (cast(entry, c_void_p).value or 0 for entry in entries)
    heads = kernel.n, kernel.carry_size, run, kernel.scene, rows, energies.at
    return Entries(*heads, until_entry(), (kernel, energies))


class Until(NamedTuple):
    """What a call finds.

    Attributes
    ----------
    nodes : array (N + 1, 2, n)
        q and p, the last ones where the clock shows the end.
    time : float
        Fictitious time of the end.
    iterations, residual : float
    quiet : bool
        Whether the constant energy is that of the start all along, as far as it was looked at.
    """

    nodes: np.ndarray
    time: float
    iterations: float
    residual: float
    quiet: bool


def run_until(
    entries: Entries,
    start: int,
    c: int,
    *,
    h: float,
    level: float,
    total: float,
    expected: float,
    patience: float,
    energy: float,
    off: float,
) -> Until | None:
    """The motion from q and p at the address `start` with parameters at `c`, about so many steps h
    until the last coordinate is `total`.

    None where a step cannot be solved, the clock stands still, the energy is off `energy` by more
    than a part `off` of p·v where the clock is slowest, or nodes are too many.
    """
    n = entries.n
    memory = _rooms.pop() if _rooms else _new_room()
    room, at = memory
    try:
        status = entries.entry(
            _ASKED.pack(
                entries.run,
                entries.scene,
                entries.rows,
                entries.energies,
                start,
                c,
                at + 8 * TOLD,
                at,
                n,
                entries.carry,
                FIXED_POINT_ITERATIONS,
                int(min(patience, ROOM)),
                ROOM // (3 * n),
                h,
                level,
                total,
                expected,
                energy,
                off,
            )
        )
        if status != DONE:
            return None
        kept, time, iterations, residual, quiet = room[:TOLD].tolist()
        count = int(kept) + 1
        nodes = room[TOLD : TOLD + 3 * n * count].reshape(count, 3, n)[:, :2].copy()
        return Until(nodes, time, iterations, residual, bool(quiet))
    finally:
        _rooms.append(memory)


def _new_room() -> tuple[np.ndarray, int]:
    room = np.empty(ROOM + TOLD)
    return room, new_address(room)

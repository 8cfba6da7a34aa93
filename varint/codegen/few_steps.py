"""A few steps and the energies of their nodes in one call of c/few_steps_core.c."""

from __future__ import annotations

import struct
from ctypes import c_void_p, cast
from typing import Any, NamedTuple

import numpy as np

from varint.codegen.arguments import DONE
from varint.codegen.core import few_steps_entry, rows_entry
from varint.codegen.kernel import Kernel, new_address
from varint.codegen.rows import RowFunction
from varint.numerics.limits import FIXED_POINT_ITERATIONS

# FewSteps, what belongs to the loop and to what is asked; between them the place of the start
_LOOP, _ASKED = struct.Struct("4P3q"), struct.Struct("Pq3d")
_PLACE, _TOLD = struct.Struct("3P"), struct.Struct("4d")
TOLD = 6  # numbers that there is room for where something is told
_FLOAT, _WHOLE = np.dtype(float), np.dtype(np.int64)


class Entries(NamedTuple):
    """Addresses of a loop and of the energy (q, p, t) → H, |p·v| of its scene, and what lies
    there; `head` is how the core is told of them.
    """

    n: int
    carry: int
    scene: int
    run: int
    rows: int
    energy: int
    head: bytes
    held: tuple


def entries_of(kernel: Kernel, energy: RowFunction) -> Entries:
    """Where they are.

    Raises
    ------
    CompileError
        If the loops were not built with the package and cannot be compiled.
    """
    entries: tuple[Any, ...] = (kernel.entry, rows_entry())
    run, rows = (cast(entry, c_void_p).value or 0 for entry in entries)
    n, carry, scene = kernel.n, kernel.carry_size, kernel.scene
    head = _LOOP.pack(run, scene, rows, energy.at, n, carry, FIXED_POINT_ITERATIONS)
    return Entries(n, carry, scene, run, rows, energy.at, head, (kernel, energy))


class Place(NamedTuple):
    """Where a start lies, as the core is told of it, and the `TOLD` numbers that it tells."""

    head: bytes
    told: memoryview


def place_of(start: int, c: int, told_at: int, told: memoryview) -> Place:
    """Addresses of q and p at the start, of parameters, and of the numbers that are told, which are
    this memory.
    """
    return Place(_PLACE.pack(start, c, told_at), told)


Nodes = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]


def nodes_of(n: int, nodes: int, room: int = 0) -> tuple[int, Nodes]:
    """Memory in one piece for a run as the core writes it: its address; numbers, times, coordinates
    and momenta of the nodes, and room for so many more numbers behind.
    """
    block, size, both = np.empty(2 * nodes * (n + 1) + room), 8 * nodes, (nodes, n)
    array = np.ndarray  # half the time of slices
    return new_address(block), (
        array(nodes, _WHOLE, block, (2 * n + 1) * size),
        array(nodes, _FLOAT, block, 2 * n * size),
        array(both, _FLOAT, block),
        array(both, _FLOAT, block, n * size),
    )


def few_steps(
    entries: Entries, place: Place, t0: float, h: float, steps: int, level: float
) -> tuple[Nodes, float, float, float, float] | None:
    """The motion with every node from a start: nodes, iterations, residual, the largest change of
    the energy and the largest energy; None where a step cannot be solved.
    """
    at, nodes = nodes_of(entries.n, steps + 1)
    asked = entries.head + place.head + _ASKED.pack(at, steps, t0, h, level)
    if few_steps_entry()(asked) != DONE:
        return None
    return nodes, *_TOLD.unpack_from(place.told)

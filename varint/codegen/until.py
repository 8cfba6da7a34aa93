"""Steps of a scene with a clock among its coordinates until the clock shows a wanted time, in one
call of c/until_core.c.
"""

from __future__ import annotations

import struct
from ctypes import c_void_p, cast
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from varint.codegen.arguments import DONE
from varint.codegen.core import rows_entry, until_entry
from varint.codegen.few_steps import Nodes
from varint.codegen.kernel import Kernel, new_address
from varint.codegen.rows import RowFunction
from varint.numerics.limits import FIXED_POINT_ITERATIONS

_HEAD = struct.Struct("4P3q")  # Until: what follows from the scene
_WHERE = struct.Struct("3Pq")  # where it is to write
_ASKED = struct.Struct("2Pq7d")  # the rest of it
_TOLD = struct.Struct("4qd")
ROOM = 2**18  # numbers of nodes: longer runs are watched on their way
PROVED_AT, TOLD = 5, 11  # behind what is told of a run there is room for what proves one
_FIRST = TOLD + ROOM  # where nodes are kept
_array, _FLOAT, _WHOLE = np.ndarray, np.dtype(float), np.dtype(np.int64)


class Memory(NamedTuple):
    """Memory for nodes, how the core is told of it, and its address."""

    room: memoryview
    where: bytes
    at: int


_rooms: list[Memory] = []  # that no call uses


class Entries(NamedTuple):
    """A loop and the energies of its scene, as the core is told of them, and what lies there."""

    n: int
    head: bytes
    entry: Any
    kernel: Kernel
    held: RowFunction


def entries_of(kernel: Kernel, energies: RowFunction) -> Entries:
    """Where they are; `energies` is of (q, p): the energy that a start has, its p·v, the energy
    that is constant, its p·v, the pace of the clock.

    Raises
    ------
    CompileError
        If the loops were not built with the package and cannot be compiled.
    """
    entries: tuple[Any, ...] = (kernel.entry, rows_entry())
    run, rows = (cast(entry, c_void_p).value or 0 for entry in entries)
    n = kernel.n
    places = run, kernel.scene, rows, energies.at
    head = _HEAD.pack(*places, n, kernel.carry_size, FIXED_POINT_ITERATIONS)
    return Entries(n, head, until_entry(), kernel, energies)


class Until(NamedTuple):
    """What a call finds.

    Attributes
    ----------
    kernel : Kernel
        Its loop.
    n : int
        Coordinates, the clock among them.
    steps : int
        Until the end, the last one shorter.
    nodes : int
        Nodes that are kept, the end among them.
    kept : bytearray
        Of each its fictitious time, its physical one, how many whole steps are before it,
        coordinates and momenta, in double precision: one behind the other.
    iterations : int
    residual : float
    quiet : bool
        Whether the constant energy is that of the start all along, as far as it was looked at.
    """

    kernel: Kernel
    n: int
    steps: int
    nodes: int
    kept: bytearray
    iterations: int
    residual: float
    quiet: bool


_until = partial(tuple.__new__, Until)  # in less time than by names


def fictitious_nodes(found: Until) -> Nodes:
    """Whole steps before, fictitious times, coordinates and momenta of the nodes."""
    _, n, _, count, kept, _, _, _ = found
    both = count, n
    return (
        _array(count, _WHOLE, kept, 16 * count),
        _array(count, _FLOAT, kept),
        _array(both, _FLOAT, kept, 24 * count),
        _array(both, _FLOAT, kept, (24 + 8 * n) * count),
    )


def physical_times(found: Until) -> tuple[np.ndarray, np.ndarray]:
    """Whole steps before, and physical times of the nodes."""
    count, kept = found.nodes, found.kept
    return (
        _array(count, _WHOLE, kept, 16 * count),
        _array(count, _FLOAT, kept, 8 * count),
    )


def physical_states(found: Until, own: int) -> tuple[np.ndarray, np.ndarray]:
    """The first so many coordinates and momenta of the nodes: those of the scene itself."""
    _, n, _, count, kept, _, _, _ = found
    others, apart, at = (count, own), (8 * n, 8), 24 * count
    return (  # in half the time of slices
        _array(others, _FLOAT, kept, at, apart),
        _array(others, _FLOAT, kept, at + 8 * n * count, apart),
    )


def clock_momenta(found: Until) -> np.ndarray:
    """The last momentum of every node."""
    _, n, _, count, kept, _, _, _ = found
    return _array((count,), _FLOAT, kept, (24 + 8 * n) * count + 8 * (n - 1), (8 * n,))


def asked_of(
    start: tuple[int, int],
    h: float,
    level: float,
    span: tuple[float, float],
    every: int,
    patience: float,
    energy: float,
    off: float,
) -> bytes:
    """What `run_until` is asked, which may be asked again as long as the start stays there.

    The motion from q and p at an address with parameters at another one by steps h over (t0, what
    the last coordinate is at the end), given up after so many; every so many nodes are kept, and
    the last one.
    """
    (at, c), (t0, total) = start, span
    every = every if every < ROOM else ROOM
    return _ASKED.pack(at, c, every, patience, h, level, total, energy, off, t0)


def run_until(entries: Entries, asked: bytes) -> Until | None:
    """The motion that is asked for.

    None where a step cannot be solved, the clock stands still, the energy is off that of the start
    by more than a part `off` of p·v where the clock is slowest, or nodes are too many.
    """
    memory = _rooms.pop() if _rooms else _new_memory()
    try:
        if entries.entry(entries.head + memory.where + asked) != DONE:
            return None
        return found_in(memory, entries)
    finally:
        _rooms.append(memory)


def take_room() -> Memory:
    """Memory for nodes, to be given back."""
    return _rooms.pop() if _rooms else _new_memory()


def give_back(memory: Memory) -> None:
    _rooms.append(memory)


def found_in(memory: Memory, entries: Entries) -> Until:
    """The run whose nodes are kept there."""
    n, (room, _, _) = entries.n, memory
    steps, count, iterations, quiet, residual = _TOLD.unpack_from(room)
    kept = bytearray(room[_FIRST : _FIRST + (3 + 2 * n) * count])
    return _until((entries.kernel, n, steps, count, kept, iterations, residual, quiet == 1))


def _new_memory() -> Memory:
    room = np.empty(TOLD + 3 * ROOM)  # of nodes, and more than enough of those that are kept
    at = new_address(room)
    return Memory(room.data, _WHERE.pack(at + 8 * TOLD, at, at + 8 * _FIRST, ROOM), at)

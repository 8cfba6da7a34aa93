"""What energies of a run in fictitious time tell, and how far two of them are apart: each in one
call of c/nearness_core.c.
"""

from __future__ import annotations

import struct
from ctypes import addressof, c_char, c_void_p, cast
from typing import Any, NamedTuple

import numpy as np

from varint.codegen.arguments import DONE
from varint.codegen.core import nearness_entries, rows_entry
from varint.codegen.kernel import address_of
from varint.codegen.rows import RowFunction
from varint.codegen.until import Until

_COURSE, _PLACES = struct.Struct("6P4qd"), struct.Struct("2Pq")  # Course, Places
_SWING, _APART = struct.Struct("PqP"), struct.Struct("PqPq2qP")  # the rest of Swing, Apart
QUANTILES = 5  # of c/order.h


class Nearness(NamedTuple):
    """The entries of the core, how a scene's runs are looked at, and what lies at its addresses;
    see `nearness_of`.
    """

    swing: Any
    apart: Any
    head: bytes
    held: tuple


def nearness_of(
    energy: RowFunction,
    velocity: RowFunction,
    body: np.ndarray,
    turns: np.ndarray,
    width: int,
    parts: np.ndarray,
    most: tuple[int, int],
    rounded: float,
) -> Nearness:
    """How the runs of a scene are looked at.

    Parameters
    ----------
    energy, velocity : RowFunction
        (q, p, t) → what stays of H, |p·v|; v. The former may be of all that nodes have.
    body, turns : array (n,) of int64
        The first coordinate of each one's body; whether it is an angle.
    width : int
        Coordinates of a node, those of the clock among them.
    parts : array
        Which quantiles of energy errors.
    most : tuple of int
        Nodes whose energy is looked at, and that are compared, and up to as many more.
    rounded : float
        A difference that is nothing.

    Raises
    ------
    CompileError
        If the loops were not built with the package and cannot be compiled.
    """
    swing, apart = nearness_entries()
    rows = cast(rows_entry(), c_void_p).value or 0  # type: ignore[arg-type]
    arrays = body, turns, parts
    where = (address_of(x) for x in arrays)
    head = _COURSE.pack(rows, energy.at, velocity.at, *where, len(body), width, *most, rounded)
    return Nearness(swing, apart, head, (energy, velocity, *arrays))


class Places(NamedTuple):
    """Where parameters and masses lie, as the core is told of them, what it tells, and where."""

    head: bytes
    told: memoryview
    at: int


def places_at(c: int, mass: int, apart: int) -> Places:
    """Addresses of parameters and of the diagonal of the mass matrix, its numbers so far apart."""
    told = np.zeros(QUANTILES)
    return Places(_PLACES.pack(c, mass, apart), told.data, address_of(told))


def swing(nearness: Nearness, places: Places, run: Until) -> list[float]:
    """Quantiles of |H − H0| over the middle one of |p·v|, infinite where the motion is lost."""
    asked = _SWING.pack(_place(run), run.nodes, places.at)
    if nearness.swing(nearness.head + places.head + asked) != DONE:
        raise MemoryError(f"no memory for the energies of {run.nodes} nodes")
    return places.told.tolist()  # type: ignore[return-value]


def apart(
    nearness: Nearness, places: Places, one: Until, few: int, other: Until, many: int
) -> tuple[float, float, float]:
    """Largest difference of two runs with so many steps, every node of which was kept, the least
    that an early one lets expect in the middle, and how many times larger it is between the nodes
    that were compared.
    """
    runs = _place(one), one.nodes, _place(other), other.nodes
    asked = _APART.pack(*runs, few, many, places.at)
    if nearness.apart(nearness.head + places.head + asked) != DONE:
        raise MemoryError(f"no memory for the differences at {other.nodes} nodes")
    largest, early, beyond, *_ = places.told
    return largest, early, beyond


def _place(run: Until) -> int:
    return addressof(c_char.from_buffer(run.kept))

"""Functions of a scene at many points at once, as data for c/rows_core.c: nothing is compiled."""

from __future__ import annotations

import struct
from collections.abc import Callable
from ctypes import addressof, c_char
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from varint.codegen.arguments import DONE
from varint.codegen.block import block_of, start_of
from varint.codegen.cache import CompileError
from varint.codegen.core import rows_entry
from varint.codegen.graph import NotCompilable
from varint.codegen.kernel import new_address
from varint.codegen.native import tapes_of
from varint.codegen.routines import routines
from varint.numerics.arrays import over_columns

_FLOAT = np.dtype(float)
MOST_ARGUMENTS = 8  # of c/rows_core.c
_EACH = f"{MOST_ARGUMENTS}P{MOST_ARGUMENTS}q"
_LAYOUT = struct.Struct(f"qPP{_EACH}{_EACH}")  # RowsArguments


class RowFunction(NamedTuple):
    """A function of some arguments and of parameters that are the same at all points.

    Attributes
    ----------
    widths : tuple of int
        Numbers of each result at a point.
    entry : callable
    block : ndarray
        The operations, and where they begin.
    at : int
    """

    widths: tuple[int, ...]
    entry: Callable[[bytes], int]
    block: np.ndarray
    at: int

    def values(self, constants: np.ndarray, *arguments: np.ndarray) -> list[np.ndarray]:
        """Values (k, width) at points whose arguments are the rows of arrays (k, …), which may be
        apart in memory; of one row where it is the same at all points.
        """
        count = max([len(x) for x in arguments])
        if not count:  # arrays of no rows have no strides
            return [np.empty((0, width)) for width in self.widths]
        places, apart = [], []
        for x in arguments:
            if x.strides[-1] != x.itemsize and x.shape[-1] > 1:
                raise AssertionError("the numbers of a point must lie side by side")
            places.append(_place(x))
            apart.append(x.strides[0] // x.itemsize if len(x) > 1 else 0)
        none, rest = (
            (0,) * (MOST_ARGUMENTS - len(places)),
            (0,) * (MOST_ARGUMENTS - len(self.widths)),
        )
        block = np.empty(count * sum(self.widths))  # one address to ask for
        address, ends, found = new_address(block), [], []
        first = 0
        for width in self.widths:
            ends.append(address + 8 * first)
            found.append(np.ndarray((count, width), _FLOAT, block, 8 * first))
            first += count * width
        where = _place(constants)
        status = self.entry(
            _LAYOUT.pack(
                count,
                where,
                self.at,
                *places,
                *none,
                *apart,
                *none,
                *ends,
                *rest,
                *self.widths,
                *rest,
            )
        )
        if status != DONE:
            raise MemoryError(f"no memory for a function at {count} points")
        return found


def _place(x: np.ndarray) -> int:
    """Where the numbers of an array begin, whose rows lie in one piece each; 0 if it has none."""
    if not x.size:
        return 0
    try:
        return addressof(c_char.from_buffer(x[0] if x.ndim > 1 else x))  # type: ignore[arg-type]
    except (TypeError, ValueError, BufferError):  # not to be changed
        return x.__array_interface__["data"][0]  # takes five times as long


def row_function_or_none(
    name: str,
    arguments: list[ca.SX],
    constants: ca.SX,
    results: list[ca.SX],
    roots: bool = False,
) -> RowFunction | None:
    """The function of columns and of `constants`, whose results are columns; None where an
    operation has no form as data, they are too many, or the loop was not built with the package and
    cannot be compiled. `roots`: see `graph_of`.
    """
    try:
        routine = routines(constants, {name: (arguments, results)}, roots=roots)[name]
        entry, tape = rows_entry(), tapes_of({name: routine})[name]
    except (NotCompilable, CompileError):
        return None
    block = block_of([tape])
    return RowFunction(tuple(x.numel() for x in results), entry, block, start_of(block))


def as_data(rows: Callable[..., list[np.ndarray]]) -> RowFunction | None:
    """The operations of a function of `at_many_points`, where they are data."""
    function = getattr(rows, "__self__", None)
    return function if isinstance(function, RowFunction) else None


def at_many_points(
    name: str, arguments: list[Any], constants: Any, results: list[Any]
) -> Callable[..., list[np.ndarray]]:
    """The function of `constants` and then of rows of arguments (k, …), in C where it can be; the
    results, columns of SX or MX, are rows.
    """
    if all(isinstance(x, ca.SX) for x in results):
        found = row_function_or_none(name, arguments, constants, results)
        if found is not None:
            return found.values
    function = ca.Function(name, [*arguments, constants], results, {"cse": True})
    return lambda c, *points: over_columns(function, *points, c)

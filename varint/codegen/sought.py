"""Zeros of expressions along a run of few steps, looked for in the same call of
c/few_steps_core.c.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from ctypes import c_void_p, cast
from typing import Any, NamedTuple

import numpy as np

from varint.codegen.core import crossings_entry
from varint.codegen.crossings import HEAD, Numbers
from varint.codegen.kernel import Kernel, address_of
from varint.codegen.rows import RowFunction

_WATCHED = struct.Struct("2Pq")  # Watched
_SOUGHT = struct.Struct("3P9q3d2P")  # Sought
ROOM = 64  # zeros of all expressions together: where there are more they are searched elsewhere


class Sought(NamedTuple):
    """What is looked for, as the core is told of it.

    Attributes
    ----------
    at : int
        Its address.
    room : int
        Zeros that there is room for.
    width : int
        Numbers of a zero: the node before it, which expression, time, value, rate, q, v and p.
    held : tuple
        What lies there.
    """

    at: int
    room: int
    width: int
    held: tuple


def sought_by(
    kernel: Kernel,
    watched: Sequence[tuple[RowFunction, RowFunction, int]],
    stops: bool,
    places: np.ndarray,
    numbers: Numbers,
) -> Sought:
    """What is looked for along runs by a loop.

    Parameters
    ----------
    kernel : Kernel
    watched : sequence
        Of each expression (q, v, t) → value and rate, bounds (see `locate_zeros`), and whether it
        is to rise (+1), to fall (−1) or either of them (0).
    stops : bool
        Whether the run ends with the first zero of the first of them.
    places : array
        In [0, 1], where nodes of a run that ends so are looked at.
    numbers : Numbers

    Raises
    ------
    CompileError
        If the search was not built with the package and cannot be compiled.
    """
    entries: tuple[Any, ...] = (crossings_entry(), kernel.parts)
    search, parts = (cast(entry, c_void_p).value or 0 for entry in entries)
    each = b"".join(_WATCHED.pack(f.at, bounds.at, direction) for f, bounds, direction in watched)
    expressions = np.frombuffer(bytearray(each), np.uint8)
    counts = len(watched), int(stops), len(places), *numbers[:6]
    lie = address_of(places), address_of(expressions)
    packed = _SOUGHT.pack(search, parts, kernel.scene, *counts, *numbers[6:], *lie)
    block = np.frombuffer(bytearray(packed), np.uint8)
    held = kernel, tuple(watched), places, expressions, block
    return Sought(address_of(block), ROOM, HEAD + 3 * kernel.n, held)

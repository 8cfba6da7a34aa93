"""A look at a start that constraint rows hold, and its momentum on them, in one call of
c/held_core.c.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from varint.codegen.arguments import c_names, c_source
from varint.codegen.core import held_entry
from varint.codegen.kernel import address_of

_HELD = struct.Struct("3q9P3d")  # Held
CLEAR, _ = range(len(c_names(c_source("held_core.c"), "enum Start {")))


class HeldStart(NamedTuple):
    """What is known at a start, where it lies.

    Attributes
    ----------
    q, v : array (n,)
    mass : array (n²,)
    g, speeds, slopes : array
        Holonomic rows; W v + w of these and the others, and W, column after column.
    along, change : array (n,)
        The velocity along the rows that belongs to the momentum, and what makes that fit them.
    p : array (n,)
        The momentum, which is changed by that.
    limits : tuple
        Those of c/held_core.c.
    """

    q: np.ndarray
    v: np.ndarray
    mass: np.ndarray
    g: np.ndarray
    speeds: np.ndarray
    slopes: np.ndarray
    along: np.ndarray
    change: np.ndarray
    p: np.ndarray
    limits: tuple[float, float, float]


def is_clear(start: HeldStart) -> Callable[[], bool]:
    """() → whether the start is on its rows beyond doubt, and its momentum has been put there.

    Raises
    ------
    CompileError
        If this was not built with the package and cannot be compiled.
    """
    *arrays, limits = start
    counts = len(start.q), len(start.speeds), len(start.g)
    asked = _HELD.pack(*counts, *[address_of(x) if x.size else 0 for x in arrays], *limits)
    entry = held_entry()
    return lambda: entry(asked) == CLEAR

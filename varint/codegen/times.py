"""A motion at times between its nodes, in one call of c/times_core.c."""

from __future__ import annotations

import struct
from ctypes import c_void_p, cast
from typing import Any

import numpy as np

from varint.codegen.arguments import DONE
from varint.codegen.core import times_entry
from varint.codegen.kernel import Kernel, address_of, new_address
from varint.numerics.limits import FIXED_POINT_ITERATIONS

_TIMES = struct.Struct("2P4q9Pd")  # Times


def states_at_times(
    kernel: Kernel,
    nodes: tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray],
    c: np.ndarray,
    h: float,
    times: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
    """q, p and whole steps before, at times in the order of the motion; None where one of them lies
    a step or more from the node before it, outside the motion or out of order, or cannot be
    reached.

    Parameters
    ----------
    kernel : Kernel
        That need not be told more at a fresh start, of a scene without controls.
    nodes : tuple of array
        t (N,), q and p (N, n), k (N,) of int64.
    c : array
        Parameters.
    h : float
        The step.
    times : array (M,)

    Raises
    ------
    CompileError
        If this was not built with the package and cannot be compiled.
    """
    n, count, entry = kernel.n, len(times), times_entry()
    block = np.empty(count * (2 * n + 1))
    q = np.ndarray((count, n), float, block)
    p = np.ndarray((count, n), float, block, 8 * count * n)
    k = np.ndarray(count, np.int64, block, 16 * count * n)
    parts: Any = kernel.parts
    at, size = new_address(block), 8 * count * n
    given = [address_of(x) if x.size else 0 for x in (*nodes, c, times)]
    found = at, at + size, at + 2 * size
    counts = n, FIXED_POINT_ITERATIONS, len(nodes[0]), count
    place = cast(parts, c_void_p).value or 0
    status = entry(_TIMES.pack(place, kernel.scene, *counts, *given, *found, h))
    return (q, p, k) if status == DONE else None

"""Zeros of an expression within the steps of a smooth motion, in one call of c/crossings_core.c."""

from __future__ import annotations

import struct
from ctypes import c_void_p, cast
from typing import Any, NamedTuple

import numpy as np

from varint.codegen.arguments import c_names, c_source
from varint.codegen.core import crossings_entry, rows_entry
from varint.codegen.kernel import Kernel, address_of
from varint.codegen.rows import RowFunction
from varint.numerics.limits import FIXED_POINT_ITERATIONS

_ASKED = struct.Struct("15P12q3d")  # Crossings
SEARCHED, NO_ROOM, _ = range(
    len(c_names(c_source("crossings_core.c"), "enum Searched {"))
)  # how a call ends
FEWEST = 64  # zeros that have room
HEAD = 5  # numbers of a zero before its state


class Numbers(NamedTuple):
    """Those of the search for zeros, as roots.py and isolation.py have them."""

    halvings: int
    most_pieces: int
    iterations: int
    secants: int
    newton: int
    located: float
    pole: float


class Nodes(NamedTuple):
    """Nodes of a motion, (M,) and (M, n), controls that are held over the steps from them (M, r k),
    how long the steps are, parameters, and how near to a node a time is that node's.
    """

    t: np.ndarray
    q: np.ndarray
    v: np.ndarray
    p: np.ndarray
    u: np.ndarray
    h: float
    c: np.ndarray
    close: float


class Zeros(NamedTuple):
    """Zeros of an expression, in the order of the steps: the node before each, the sign of the
    expression before it, and time, value, rate, q, v and p there.
    """

    node: np.ndarray
    side: np.ndarray
    t: np.ndarray
    value: np.ndarray
    rate: np.ndarray
    q: np.ndarray
    v: np.ndarray
    p: np.ndarray


def locate_zeros(
    kernel: Kernel, values: RowFunction, bounds: RowFunction, nodes: Nodes, numbers: Numbers
) -> Zeros | None:
    """The zeros along a motion; None where a shorter step cannot be solved.

    Parameters
    ----------
    kernel : Kernel
        That made the motion.
    values, bounds : RowFunction
        (q, v, t) → value and rate; (q, v at both ends of a piece, its begin and duration) → value,
        rate and curvature, each low and high.
    nodes : Nodes
    numbers : Numbers

    Raises
    ------
    CompileError
        If the search was not built with the package and cannot be compiled.
    """
    n, count = kernel.n, len(nodes.t)
    entries: tuple[Any, ...] = (kernel.parts, rows_entry())
    parts, rows = (cast(entry, c_void_p).value or 0 for entry in entries)
    given = nodes.t, nodes.q, nodes.v, nodes.p, nodes.c, nodes.u
    t, q, v, p, c, u = (np.ascontiguousarray(x, dtype=float) for x in given)
    nowhere, found = np.empty((count, 0)), np.zeros(2, np.int64)

    def search(zeros: np.ndarray, opening: np.ndarray, marks: np.ndarray | None) -> int:
        arrays = t, q, v, p, c, u, opening, zeros, found, nowhere if marks is None else marks
        places = [address_of(x) if x.size else 0 for x in arrays]
        first = int(found[1])
        heads = parts, kernel.scene, rows, values.at, bounds.at
        counts = n, count, first, u.shape[1], opening.shape[1], FIXED_POINT_ITERATIONS, len(zeros)
        last = *numbers[:5], nodes.close, *numbers[5:]
        return crossings_entry()(_ASKED.pack(*heads, *places, *counts, *last))

    opening = nowhere
    if kernel.opening:  # what the loop is told costs more than the search, and few steps need one
        marks = np.zeros(count, np.int8)
        search(nowhere, nowhere, marks)
        found[:], some = 0, np.flatnonzero(marks)
        used = kernel.controls and np.abs(u[some].reshape(len(some), -1, kernel.controls)).max(1)
        at = t[some], np.full(len(some), nodes.h), c
        told = kernel.opening(q[some], p[some], used if kernel.controls else None, *at)
        opening = np.empty((count, told.shape[1]))
        opening[some] = told
    room, kept, status = FEWEST, [], NO_ROOM
    while status == NO_ROOM:
        found[0], zeros = 0, np.empty((room, HEAD + 3 * n))
        status = search(zeros, opening, None)
        kept.append(zeros[: found[0]])
        room *= 4
    if status != SEARCHED:
        return None
    flat = kept[0] if len(kept) == 1 else np.concatenate(kept)
    heads, states = flat[:, :HEAD].T.copy(), flat[:, HEAD:].reshape(-1, 3, n).transpose(1, 0, 2)
    return Zeros(heads[0].astype(int), *heads[1:], *states.copy())

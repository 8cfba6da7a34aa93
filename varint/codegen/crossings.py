"""Zeros of an expression within the steps of a motion, in one call of c/crossings_core.c."""

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

_ASKED = struct.Struct("17P13q4d")  # Crossings
_SOURCE = c_source("crossings_core.c")
SEARCHED, NO_ROOM, _ = range(len(c_names(_SOURCE, "enum Searched {")))  # how a call ends
BROKEN, _, WANTED = range(len(c_names(_SOURCE, "enum Step {")))  # from a node to the next
FEWEST = 64  # zeros that have room
HEAD = 5  # numbers of a zero before its state
LOOKS = 8  # at typical sizes: a look takes as long as to locate a zero


class Numbers(NamedTuple):
    """Those of the search for zeros, as roots.py and isolation.py have them."""

    halvings: int
    deepest: int
    most_pieces: int
    iterations: int
    secants: int
    newton: int
    located: float
    pole: float
    shallow: float


class Nodes(NamedTuple):
    """Nodes of a motion, (M,) and (M, n), controls that are held over the steps from them (M, r k),
    how long the steps are, parameters, how near to a node a time is that node's, and which nodes
    there is a step from to the next (M − 1,). Where the motion jumps: v and p in which it comes
    there, rows of `before`, and of every node which row, or −1.
    """

    t: np.ndarray
    q: np.ndarray
    v: np.ndarray
    p: np.ndarray
    u: np.ndarray
    h: float
    c: np.ndarray
    close: float
    step: np.ndarray
    before: np.ndarray
    jumps: np.ndarray


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


def _typical_sizes(kernel: Kernel, nodes: Nodes, some: np.ndarray) -> np.ndarray:
    """Those of velocities and momenta at some nodes, (2n,): one for all, as a run has, from a few
    looks.
    """
    assert kernel.opening
    seen = some[:: -(-len(some) // LOOKS)]
    used = None
    if kernel.controls:
        used = np.abs(nodes.u[seen].reshape(len(seen), -1, kernel.controls)).max(1)
    times = nodes.t[seen], np.full(len(seen), nodes.h)
    told = kernel.opening(nodes.q[seen], nodes.p[seen], used, *times, nodes.c)
    return told[:, : 2 * kernel.n].max(axis=0)


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
    steps, jumps = np.full(count, BROKEN, np.int8), nodes.jumps.astype(np.int32)
    steps[:-1][nodes.step] = WANTED

    def search(zeros: np.ndarray, opening: np.ndarray, marking: bool = False) -> int:
        arrays = t, q, v, p, c, u, opening, nodes.before, jumps, zeros, found, steps
        places = [address_of(x) if x.size else 0 for x in arrays]
        heads = parts, kernel.scene, rows, values.at, bounds.at
        sizes = u.shape[1], opening.shape[1], FIXED_POINT_ITERATIONS, len(zeros)
        counts = n, count, marking, *sizes
        last = *numbers[:6], nodes.close, *numbers[6:]
        return crossings_entry()(_ASKED.pack(*heads, *places, *counts, *last))

    opening = nowhere
    if kernel.opening:  # what the loop is told costs more than the search, and few steps need one
        search(nowhere, nowhere, marking=True)
        found[:], some = 0, np.flatnonzero(steps == WANTED)
        if len(some):
            opening = np.empty((count, 3 * n))
            opening[some, : 2 * n] = _typical_sizes(kernel, nodes, some)
            opening[some, 2 * n :] = v[some]
    room, kept, status = FEWEST, [], NO_ROOM
    while status == NO_ROOM:
        found[0], zeros = 0, np.empty((room, HEAD + 3 * n))
        status = search(zeros, opening)
        kept.append(zeros[: found[0]])
        room *= 4
    if status != SEARCHED:
        return None
    flat = kept[0] if len(kept) == 1 else np.concatenate(kept)
    heads, states = flat[:, :HEAD].T.copy(), flat[:, HEAD:].reshape(-1, 3, n).transpose(1, 0, 2)
    return Zeros(heads[0].astype(int), *heads[1:], *states.copy())

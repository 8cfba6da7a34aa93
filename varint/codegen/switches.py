"""Motions from switch to switch, in one call of c/switches_core.c."""

from __future__ import annotations

import struct
from ctypes import CFUNCTYPE, c_int, c_int64, c_void_p, cast
from typing import Any, NamedTuple

import numpy as np

from varint.codegen.arguments import MOST_NOTED, c_names, c_number, c_source
from varint.codegen.core import rows_entry, switches_entry
from varint.codegen.kernel import Kernel, address_of, told_of
from varint.codegen.rows import RowFunction
from varint.numerics.limits import FIXED_POINT_ITERATIONS

_MODE, _ASKED = struct.Struct("6P5q"), struct.Struct("15P14q17d")  # Mode, SwitchArguments
_SOURCE = c_source("switches_core.c")
# how a call ends
ARRIVED, UNDECIDED, BESIDE, NO_ROOM = range(len(c_names(_SOURCE, "enum Followed {")))
COUNTS, SLIDABLE, STRAIGHT, CLOCK = (2**i for i in range(4))  # enum Kinds
_TELL = CFUNCTYPE(c_int, c_int64)
TOLD = 3  # numbers of a coordinate that a loop by Newton's method is told: sizes and velocities
PIECE_HEAD = c_number(_SOURCE, "PIECE_HEAD")


class Mode(NamedTuple):
    """What moves while the same switch holds the motion (`held`; −1: none): its loop, (q, v, t) →
    margins and rates, (q, v, t) → what switches and its rate, and of every margin which switch and
    what its number is beyond.
    """

    kernel: Kernel
    margins: RowFunction
    ahead: RowFunction
    watched: tuple[tuple[int, float], ...]
    held: int


class Numbers(NamedTuple):
    """Those of the search, as piece.py, crossing.py and next_branch.py have them."""

    first: int
    most_in_block: int
    roots: int
    turns: int
    surely: int
    located: float
    close: float
    dip: float
    inside: tuple[float, ...]
    least_unit: float
    longer: float
    edge: float
    border: float
    crowded: float
    at_zero: float
    no_jump: float


class Switched(NamedTuple):
    """What is the same in all calls.

    Attributes
    ----------
    modes : tuple of Mode
    branches : array (B, 4)
        Mode, unit of time, the unit at first, how often steps beside switches are halved.
    c : array (B, parameters)
        The numbers behind the switches are the last.
    lagrangian : RowFunction or None
        (q, v, t) → L, where it may jump.
    kinds : array of int (switches,)
        A sum of COUNTS, SLIDABLE, STRAIGHT and CLOCK each.
    among : array
        Instants in a step at which a cubic is looked at.
    numbers : Numbers
    layout : array of bytes
        The modes as they lie in memory.
    kept : tuple
        What lies there besides.
    """

    modes: tuple[Mode, ...]
    branches: np.ndarray
    c: np.ndarray
    lagrangian: RowFunction | None
    kinds: np.ndarray
    among: np.ndarray
    numbers: Numbers
    layout: np.ndarray
    kept: tuple[np.ndarray, ...]


class Passed(NamedTuple):
    """How a call ended, its pieces (P, PIECE_HEAD), times (M,) and (q, p, v), (M, 3, n), of all
    their nodes.
    """

    status: int
    pieces: np.ndarray
    t: np.ndarray
    states: np.ndarray


def switched(
    modes: tuple[Mode, ...],
    branches: np.ndarray,
    c: np.ndarray,
    lagrangian: RowFunction | None,
    kinds: np.ndarray,
    among: np.ndarray,
    numbers: Numbers,
) -> Switched:
    """The modes and branches as they are handed over.

    Raises
    ------
    CompileError
        If the search was not built with the package and cannot be compiled.
    """
    switches_entry()
    layout, kept = [], []
    for mode in modes:
        watched = np.array(mode.watched, dtype=float).reshape(-1, 2)
        entries: tuple[Any, ...] = (mode.kernel.entry, mode.kernel.parts)
        run, parts = (cast(entry, c_void_p).value or 0 for entry in entries)
        functions = mode.kernel.scene, mode.margins.at, mode.ahead.at
        nodes, numbers_of_node = mode.kernel.note
        notes = MOST_NOTED * (1 + nodes * numbers_of_node) if nodes else 0
        told = TOLD * mode.kernel.n if mode.kernel.opening else 0
        sizes = mode.kernel.carry_size, len(watched), mode.held, told, notes
        place = address_of(watched) if watched.size else 0
        layout.append(_MODE.pack(run, parts, *functions, place, *sizes))
        kept.append(watched)
    flat = np.frombuffer(bytearray(b"".join(layout)), dtype=np.uint8)
    return Switched(modes, branches, c, lagrangian, kinds, among, numbers, flat, tuple(kept))


def pass_switches(
    known: Switched,
    place: int,
    t: float,
    q: np.ndarray,
    p: np.ndarray,
    v: np.ndarray,
    *,
    until: float,
    total: float,
    parts: int,
    most: int,
    room: int,
    most_nodes: float,
) -> Passed:
    """Pieces of the motion from a state on the branch at a place of the table, in so many steps a
    unit; the units in the table change.

    Parameters
    ----------
    known : Switched
    place : int
    t : float
    q, p, v : array (n,)
    until, total : float
        Where the call ends at the latest, and the duration of the run.
    parts : int
    most, room : int
        Largest number of pieces, and of their nodes.
    most_nodes : float
        Of a piece.
    """
    n, x = len(q), known.numbers
    start, found = np.concatenate([[t], q, p, v]), np.zeros(2, np.int64)
    pieces, times, states = np.empty((most, PIECE_HEAD)), np.empty(room), np.empty((room, 3, n))
    rows: Any = rows_entry()
    kinds, arrays = address_of(known.kinds), (start, pieces, times, states, found, known.among)
    switches, asked, told = len(known.kinds), np.empty(2 + 2 * n), np.empty(TOLD * n)
    raised: list[BaseException] = []

    def tell(branch: int) -> int:
        try:
            kernel = known.modes[int(known.branches[branch, 0])].kernel
            told[:] = told_of(kernel, asked[2:].reshape(2, n), known.c[branch], *asked[:2].tolist())
        except BaseException as error:
            raised.append(error)
            return 0
        return 1

    telling = _TELL(tell) if any(mode.kernel.opening for mode in known.modes) else None
    status = switches_entry()(
        _ASKED.pack(
            cast(rows, c_void_p).value or 0,
            address_of(known.layout),
            cast(telling, c_void_p).value or 0,  # type: ignore[arg-type]
            *map(address_of, (asked, told, known.branches, known.c)),
            known.lagrangian.at if known.lagrangian else 0,
            kinds,
            *map(address_of, arrays),
            *(n, len(known.branches), known.c.shape[1], switches, place, most, room),
            *(parts, FIXED_POINT_ITERATIONS, *x[:5]),
            *(until, total, most_nodes, *x[5:8], *x.inside, *x[9:]),
        )
    )
    if raised:
        raise raised[0]
    made, nodes = found.tolist()
    return Passed(status, pieces[:made], times[:nodes], states[:nodes])

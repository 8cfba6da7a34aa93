"""A motion at times between its nodes, in one call of c/times_core.c."""

from __future__ import annotations

import struct
from collections.abc import Callable
from ctypes import c_void_p, cast
from typing import Any, NamedTuple

import numpy as np

from varint.codegen.arguments import DONE
from varint.codegen.core import times_entries
from varint.codegen.kernel import Kernel, address_of, new_address
from varint.codegen.within_steps import NOTHING_WITHIN, Within
from varint.numerics.limits import ALONE_ITERATIONS

_TIMES = struct.Struct("2P5q9P2d6P2q")  # Times
_CLOCK = struct.Struct("2P5q9P2d6P2q2P")  # ClockTimes
_WHOLE = np.dtype(np.int64)


class Between(NamedTuple):
    """How motions are looked at between their nodes by a loop that is told nothing. The fields are
    those of c/direct.c.

    Attributes
    ----------
    entry, parts : int
        Where c/times_core.c is, and the loop's shorter steps.
    scene, most : int
        What these are handed: the scene, and most iterations of a step.
    whole : dtype
        Of numbers of steps.
    within, within_scene, tables, order, fewest : int
        `Within`.
    """

    entry: int
    parts: int
    scene: int
    most: int
    whole: np.dtype
    within: int
    within_scene: int
    tables: int
    order: int
    fewest: int


def between(kernel: Kernel, steps: Within = NOTHING_WITHIN) -> Between | None:
    """By this loop, and within steps that hold many times; None where it must be told more at a
    fresh start.

    Raises
    ------
    CompileError
        If this was not built with the package and cannot be compiled.
    """
    if kernel.opening:
        return None
    entries: tuple[Any, ...] = times_entries()[0], kernel.parts
    at, parts = (cast(entry, c_void_p).value or 0 for entry in entries)
    return Between(at, parts, kernel.scene, ALONE_ITERATIONS, _WHOLE, *steps)


def states_at_times(
    kernel: Kernel,
    nodes: tuple[np.ndarray | None, np.ndarray, np.ndarray, np.ndarray | None],
    c: np.ndarray,
    grid: tuple[float, float],
    times: np.ndarray,
    steps: Within = NOTHING_WITHIN,
    sizes: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
    """q, p and whole steps before, at times in the order of the motion; None where one of them lies
    a step or more from the node before it, outside the motion or out of order, or cannot be
    reached.

    Parameters
    ----------
    kernel : Kernel
        Of a scene without controls.
    nodes : tuple of array
        t (N,), q and p (N, n), k (N,) of int64; neither t nor k of equal steps with a node at each.
    c : array
        Parameters.
    grid : tuple of float
        The step, and when the first one begins.
    times : array (M,)
    steps : Within
        For steps that hold many of the times.
    sizes : array, optional
        Of the steps, where they differ.

    Raises
    ------
    CompileError
        If this was not built with the package and cannot be compiled.
    """
    n, count, many = kernel.n, len(times), len(times) * kernel.n
    block = np.empty(2 * many + count)
    q, p, k = block[:many], block[many : 2 * many], block[2 * many :].view(_WHOLE)
    at, parts = new_address(block), kernel.parts
    place = cast(parts, c_void_p).value or 0  # type: ignore[arg-type]
    given = [0 if x is None or not x.size else address_of(x) for x in (*nodes, c, times)]
    found = [at + 8 * i for i in (0, many, 2 * many)]
    uneven = 0 if sizes is None else address_of(sizes)

    def done(entry: Callable[[bytes], int], told: int, room: int, opening: int) -> bool:
        counts = n, ALONE_ITERATIONS, told, len(nodes[1]), count
        behind = *grid, uneven, room, opening, *steps
        return entry(_TIMES.pack(place, kernel.scene, *counts, *given, *found, *behind)) == DONE

    at_times, go_ahead, arrive, _ = times_entries()
    if kernel.opening is None:
        reached = done(at_times, 0, 0, 0)
    else:
        room = np.empty(1 + count * (5 * n + 6))  # ROOM_OF_TIMES in c/times.h
        behind = new_address(room)
        reached = done(go_ahead, 0, behind, 0)
        if reached and (going := room[:1].view(_WHOLE).item()):
            start = room[1 : 1 + 2 * n * going].reshape(going, 2 * n)
            begin, ahead = (room[1 + 2 * many + i * count :][:going] for i in (0, 1))
            told = kernel.opening(start[:, :n], start[:, n:], None, begin, ahead, c)
            reached = done(arrive, told.shape[1], behind, new_address(told))
    return (q.reshape(count, n), p.reshape(count, n), k) if reached else None


def states_at_clock(
    kernel: Kernel,
    nodes: tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray],
    paces: np.ndarray,
    c: np.ndarray,
    h: float,
    times: np.ndarray,
    steps: Within = NOTHING_WITHIN,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray] | None:
    """Own times, q, p and whole steps before, where the last coordinate shows `times`; None where
    nodes are more than a step apart, or one of the times cannot be reached.

    Parameters
    ----------
    kernel : Kernel
        Of a scene without controls, whose loop is told nothing.
    nodes : tuple of array
        t (N,), q and p (N, n), k (N,) of int64.
    paces : array (N,)
        The last velocity.
    c : array
        Parameters.
    h : float
        The step.
    times : array (M,)
        Between those that the first and the last node show.
    steps : Within
        For steps that hold many of the times.

    Raises
    ------
    CompileError
        If this was not built with the package and cannot be compiled.
    """
    n, count, many = kernel.n, len(times), len(times) * kernel.n
    block = np.empty(2 * many + 2 * count)
    place = cast(kernel.parts, c_void_p).value or 0  # type: ignore[arg-type]
    counts = n, ALONE_ITERATIONS, 0, len(nodes[1]), count
    given = [address_of(x) if x.size else 0 for x in (*nodes, c, times)]
    at = new_address(block)
    found = [at + 8 * i for i in (0, many, 2 * many)]
    more = address_of(paces), at + 8 * (2 * many + count)
    alone = 0, 0, 0, *steps
    asked = _CLOCK.pack(place, kernel.scene, *counts, *given, *found, h, 0.0, *alone, *more)
    if times_entries()[3](asked) != DONE:
        return None
    q, p, (k, t) = block[:many], block[many : 2 * many], block[2 * many :].reshape(2, count)
    return t, q.reshape(count, n), p.reshape(count, n), k.view(_WHOLE)

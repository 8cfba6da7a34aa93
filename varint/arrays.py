"""CasADi functions over many columns at once, through the buffer interface: NumPy memory in, NumPy memory out.

Runs of any length are cut into blocks of 1, 10, 100, … so that only a handful of functions is ever built.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import lru_cache
from threading import get_ident

import casadi as ca
import numpy as np

LARGEST_BLOCK = 10_000


def blocks(count: int, largest: int = LARGEST_BLOCK) -> Iterator[int]:
    """`count` as a sum of powers of ten, none above `largest`, larger ones first."""
    size = largest
    while count:
        while size > count:
            size //= 10
        yield size
        count -= size


@lru_cache(maxsize=256)
def _prepared(function: ca.Function, thread: int) -> tuple:
    """Buffer, trigger and sizes of a function; one buffer a thread, for a buffer holds the arguments of its call."""
    del thread
    buffer, trigger = function.buffer()
    sizes = tuple(function.nnz_in(i) for i in range(function.n_in()))
    return buffer, trigger, sizes, tuple(function.nnz_out(i) for i in range(function.n_out()))


def call(function: ca.Function, *arguments: np.ndarray) -> list[np.ndarray]:
    """Function values as flat arrays of the outputs' nonzeros; arguments are C-contiguous doubles, column after column.

    `function` must have dense inputs; each argument's size must match.
    """
    buffer, trigger, sizes, out = _prepared(function, get_ident())
    for i, (argument, size) in enumerate(zip(arguments, sizes, strict=True)):
        if argument.size != size:
            raise AssertionError(f"{function.name()}: input {i} has {argument.size} numbers, not {size}")
        buffer.set_arg(i, memoryview(argument))  # type: ignore[arg-type]
    outputs = [np.empty(size) for size in out]
    for i, output in enumerate(outputs):
        buffer.set_res(i, memoryview(output))  # type: ignore[arg-type]
    trigger()
    return outputs


@lru_cache(maxsize=64)
def _mapped(function: ca.Function, size: int) -> ca.Function:
    return function.map(size) if size > 1 else function


def _rows(a: np.ndarray, count: int) -> np.ndarray:
    """`a` with so many rows, in one piece of memory; faster than `np.broadcast_to` for few."""
    if a.ndim == 2 and len(a) == count:
        return np.ascontiguousarray(a, dtype=float)
    rows = np.empty((count, a.shape[-1]))
    rows[:] = a
    return rows


def over_columns(function: ca.Function, *arrays: np.ndarray) -> list[np.ndarray]:
    """Evaluate `function` for every row of the arrays.

    Parameters
    ----------
    function : Function
        Dense inputs and outputs.
    *arrays : ndarray (N, size of input i) or (size of input i,)
        Time first; one row for all where the array has no time axis.

    Returns
    -------
    list of ndarray (N, size of output i)
    """
    count = max(len(a) for a in arrays if a.ndim == 2)
    columns = [_rows(a, count) for a in arrays]
    if count == 1 or (count < LARGEST_BLOCK and next(blocks(count)) == count):
        return [x.reshape(count, -1) for x in call(_mapped(function, count), *(a.ravel() for a in columns))]
    results: list[Sequence[np.ndarray]] = []
    done = 0
    for size in blocks(count):
        part = call(_mapped(function, size), *(a[done : done + size].ravel() for a in columns))
        results.append([x.reshape(size, -1) for x in part])
        done += size
    sizes = [function.nnz_out(i) for i in range(function.n_out())]
    return [np.concatenate([r[i] for r in results] or [np.empty((0, k))]) for i, k in enumerate(sizes)]

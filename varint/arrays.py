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
FEW = 10  # rows for each number of which a function is built
COPIED = 500  # numbers of a function's arguments and results that are worth a copy of them


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
    """Buffer, trigger and sizes of a function; one buffer a thread, for a buffer holds the arguments of its call.

    Where arguments and results are few they have memory of their own in it: to copy numbers is cheaper than to hand
    over where they are.
    """
    del thread
    buffer, trigger = function.buffer()
    sizes = [function.nnz_in(i) for i in range(function.n_in())]
    out = [function.nnz_out(i) for i in range(function.n_out())]
    if sum(sizes) + sum(out) > COPIED:
        return buffer, trigger, sizes, out, None
    own = [np.empty(size) for size in (*sizes, *out)]
    _hand_over(buffer, own[: len(sizes)], own[len(sizes) :])
    return buffer, trigger, sizes, out, (own[: len(sizes)], own[len(sizes) :])


def _hand_over(buffer: ca.FunctionBuffer, arguments: Sequence[np.ndarray], outputs: Sequence[np.ndarray]) -> None:
    for i, argument in enumerate(arguments):
        buffer.set_arg(i, memoryview(argument))  # type: ignore[arg-type]
    for i, output in enumerate(outputs):
        buffer.set_res(i, memoryview(output))  # type: ignore[arg-type]


def call(function: ca.Function, *arguments: np.ndarray) -> list[np.ndarray]:
    """Function values as flat arrays of the outputs' nonzeros; arguments are C-contiguous doubles, column after column.

    `function` must have dense inputs; each argument's size must match.
    """
    buffer, trigger, sizes, out, own = _prepared(function, get_ident())
    for i, (argument, size) in enumerate(zip(arguments, sizes, strict=True)):
        if argument.size != size:
            raise AssertionError(f"{function.name()}: input {i} has {argument.size} numbers, not {size}")
        if own and size:
            own[0][i][:] = argument if argument.ndim == 1 else argument.reshape(-1)
    outputs = [np.empty(size) for size in out] if own is None else own[1]
    if own is None:
        _hand_over(buffer, arguments, outputs)
    trigger()
    return outputs if own is None else [memory.copy() for memory in outputs]


@lru_cache(maxsize=256)
def _few_rows(function: ca.Function, count: int, thread: int) -> tuple | None:
    """Buffer, trigger, and arguments and results as rows of the buffer's memory; None where they are many."""
    if not count or (next(blocks(count)) != count and count > FEW):
        return None
    buffer, trigger, _, _, own = _prepared(_mapped(function, count), thread)
    return own and (buffer, trigger, *([memory.reshape(count, -1) for memory in part] for part in own))


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


def lengths(rows: np.ndarray) -> np.ndarray:
    """Euclidean lengths of the last axis, (…, n) → (…,), also where the squares would vanish or overflow."""
    largest = np.abs(rows).max(axis=-1, initial=0.0)
    size = np.where(largest > 0, largest, 1.0)
    return size * np.sqrt(((rows / size[..., None]) ** 2).sum(axis=-1))


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
    count = max([len(a) for a in arrays if a.ndim == 2])
    if count < COPIED:
        memory = _few_rows(function, count, get_ident())
        if memory is not None:
            _, trigger, inputs, outputs = memory
            for rows, a in zip(inputs, arrays, strict=True):
                if rows.shape[1] != a.shape[-1]:
                    raise AssertionError(f"{function.name()}: {a.shape[-1]} numbers a row, not {rows.shape[1]}")
                rows[:] = a
            trigger()
            return [rows.copy() for rows in outputs]
    columns = [_rows(a, count) for a in arrays]
    results: list[Sequence[np.ndarray]] = []
    done = 0
    for size in blocks(count):
        part = call(_mapped(function, size), *(a[done : done + size] for a in columns))
        results.append([x.reshape(size, -1) for x in part])
        done += size
    if len(results) == 1:
        return list(results[0])
    sizes = [function.nnz_out(i) for i in range(function.n_out())]
    return [np.concatenate([r[i] for r in results] or [np.empty((0, k))]) for i, k in enumerate(sizes)]

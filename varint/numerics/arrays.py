"""CasADi functions over many columns at once, through the buffer interface: NumPy memory in, NumPy
memory out.

Runs of any length are cut into blocks of 1, 4, 16, … so that only a handful of functions is ever
built; where that costs less than another call, the last block is filled up.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from functools import lru_cache
from threading import get_ident
from typing import NamedTuple

import casadi as ca
import numpy as np

LARGEST_BLOCK = 10_000
FEW = 10  # rows for each number of which a function is built
LARGEST_ROWS = 4**5  # at once: more are no faster a row, and take longer to build
# a call from Python, and a row within one, in operations of CasADi's virtual machine (3 ns each)
CALL, ROW = 2000, 40
MANY = 10**9  # operations of iterations and loops, which are not counted
REMEMBERED = 256  # functions whose buffers are kept
DEFINITE = 1e-12  # least eigenvalue of a matrix that is definite by far: beyond its round-off
CLEARLY = 1e-6  # determinant of a matrix of two rows that needs no closer look
COPIED = 500  # numbers of a function's arguments and results that are worth a copy of them


def finite(*arrays: np.ndarray) -> bool:
    """Whether all numbers of these arrays (k,) are finite."""
    for x in arrays:
        if len(x) >= FEW:
            if not np.isfinite(x).all():
                return False
        # a sum is finite where its terms are, but for overflows; one by one is faster for few
        elif not math.isfinite(sum(numbers := x.tolist())) and not all(map(math.isfinite, numbers)):
            return False
    return True


def is_definite(matrix: np.ndarray) -> bool:
    """Whether a symmetric matrix is positive definite by far, its diagonal scaled to one:
    without its eigenvalues.
    """
    if len(matrix) <= 2 and is_clearly_definite(matrix.ravel().tolist()):
        return True
    if len(matrix) == 1:
        return False
    less = matrix.copy()
    less.reshape(-1)[:: len(matrix) + 1] *= 1 - DEFINITE
    try:
        return math.isfinite(np.linalg.cholesky(less).trace())
    except np.linalg.LinAlgError:
        return False


def is_clearly_definite(numbers: Sequence[float]) -> bool:
    """The same of one row or two, row by row, where it needs no closer look; else False."""
    if len(numbers) == 1:
        return 0 < numbers[0] < math.inf
    if len(numbers) != 4:
        return False
    a, b, c, d = numbers
    return a > 0 and d > 0 and CLEARLY * a * d < a * d - b * c < math.inf


def median(x: np.ndarray) -> float:
    """`numpy.median` of numbers (k,), without what that one loads when it is called first."""
    ordered, half = np.sort(x), len(x) // 2
    if not len(x) or math.isnan(ordered[-1]):
        return math.nan
    return float(ordered[half] if len(x) % 2 else (ordered[half - 1] + ordered[half]) / 2)


def distinct(x: np.ndarray) -> np.ndarray:
    """`numpy.unique` of whole numbers (k,), without what that one loads when it is called first."""
    ordered = np.sort(x)
    return ordered[np.append(True, ordered[1:] != ordered[:-1])] if len(x) else ordered


def blocks(count: int, largest: int = LARGEST_BLOCK) -> Iterator[int]:
    """`count` as a sum of powers of ten, none above `largest`, larger ones first."""
    size = largest
    while count:
        while size > count:
            size //= 10
        yield size
        count -= size


@lru_cache(maxsize=1024)
def row_blocks(count: int, operations: int) -> tuple[int, ...]:
    """Powers of four that add up to `count` rows or, the last one filled up, to more: those that
    take the least time where a row takes so many operations.
    """
    sizes: list[int] = []
    size, row = LARGEST_ROWS, ROW + operations
    while count:
        many = count // size
        sizes += [size] * many
        count -= many * size
        rest, less, calls = count, size, 0
        while less > 1:
            less //= 4
            calls += rest // less
            rest %= less
        if count and CALL + size * row <= calls * CALL + count * row:
            return (*sizes, size)
        size //= 4
    return tuple(sizes)


class _Prepared(NamedTuple):
    """A function with its buffer, the trigger of its call, the sizes of its arguments and results,
    and their memory.

    Where arguments and results are few they have memory of their own in the buffer: to copy numbers
    is cheaper than to hand over where they are. Memory of many is None. `fails`: linear systems or
    iterations may end the call without results.
    """

    function: ca.Function
    buffer: ca.FunctionBuffer
    trigger: Callable[[], object]
    sizes: list[int]
    out: list[int]
    inputs: list[np.ndarray] | None
    outputs: list[np.ndarray]
    fails: bool

    def run(self, outputs: Sequence[np.ndarray]) -> bool:
        """The call, and whether it came to its end; if not its results are no numbers, rather than
        what was in memory.
        """
        written = [x for x in outputs if x.size] if self.fails else []
        if written:
            written[-1].flat[-1] = math.nan
        self.trigger()
        if written and math.isnan(written[-1].flat[-1]) and self.buffer.ret():
            for x in written:
                x.fill(math.nan)
            return False
        return True


_PREPARED: dict[tuple[int, int], _Prepared] = {}


def _prepare(function: ca.Function) -> _Prepared:
    """What a call of the function needs; one buffer a thread, for a buffer holds the arguments of
    its call.

    Functions are looked up by identity, which is safe as long as they are held here: CasADi's own
    hash takes as long as a call.
    """
    key = id(function), get_ident()
    known = _PREPARED.get(key)
    if known is None:
        if len(_PREPARED) >= REMEMBERED:
            _PREPARED.clear()
        known = _PREPARED[key] = _preparation(function)
    return known


def _preparation(function: ca.Function) -> _Prepared:
    buffer, trigger = function.buffer()
    sizes = [function.nnz_in(i) for i in range(function.n_in())]
    out = [function.nnz_out(i) for i in range(function.n_out())]
    fails = not function.is_a("SXFunction")
    if sum(sizes) + sum(out) > COPIED:
        return _Prepared(function, buffer, trigger, sizes, out, None, [], fails)
    inputs, outputs = ([np.empty(size) for size in part] for part in (sizes, out))
    hand_over(buffer, inputs, outputs)
    return _Prepared(function, buffer, trigger, sizes, out, inputs, outputs, fails)


def hand_over(
    buffer: ca.FunctionBuffer, arguments: Sequence[np.ndarray], outputs: Sequence[np.ndarray]
) -> None:
    for i, argument in enumerate(arguments):
        buffer.set_arg(i, memoryview(argument))  # type: ignore[arg-type]
    for i, output in enumerate(outputs):
        buffer.set_res(i, memoryview(output))  # type: ignore[arg-type]


def trigger_on(
    function: ca.Function, inputs: tuple[np.ndarray, ...], outputs: tuple[np.ndarray, ...]
) -> tuple[Callable[[], object], tuple]:
    """The call of a function whose arguments and results have this memory, and what it needs to
    stay there.
    """
    buffer, trigger = function.buffer()
    hand_over(buffer, inputs, outputs)
    return trigger, (buffer, inputs, outputs)


def call(function: ca.Function, *arguments: np.ndarray) -> list[np.ndarray]:
    """Function values as flat arrays of the outputs' nonzeros; arguments are C-contiguous doubles,
    column after column.

    `function` must have dense inputs; each argument's size must match.
    """
    prepared = _prepare(function)
    sizes, inputs, outputs = prepared.sizes, prepared.inputs, prepared.outputs
    for argument, size, memory in zip(arguments, sizes, inputs or arguments, strict=True):
        if argument.size != size:
            raise AssertionError(
                f"{function.name()}: inputs have {[a.size for a in arguments]} numbers, not {sizes}"
            )
        if inputs and size:
            # faster than [:]
            memory[...] = argument if argument.ndim == 1 else argument.reshape(-1)
    if inputs is None:
        outputs = [np.empty(size) for size in prepared.out]
        hand_over(prepared.buffer, arguments, outputs)
        prepared.run(outputs)
        return outputs
    if prepared.fails:
        prepared.run(outputs)
    else:
        prepared.trigger()
    return [memory.copy() for memory in outputs]


class _Rows(NamedTuple):
    """How a function is called for so many rows: the sizes of the blocks, and what one block of few
    numbers needs, arguments and results as rows; None where there are more. `fails`: see
    `_Prepared`.
    """

    function: ca.Function
    sizes: tuple[int, ...]
    few: _Prepared | None
    fails: bool


_ROWS: dict[tuple[int, int, int], _Rows] = {}


def _rows_of(function: ca.Function, count: int) -> _Rows:
    key = id(function), count, get_ident()
    known = _ROWS.get(key)
    if known is None:
        if len(_ROWS) >= REMEMBERED:
            _ROWS.clear()
        known = _ROWS[key] = _plan_of_rows(function, count)
    return known


def _plan_of_rows(function: ca.Function, count: int) -> _Rows:
    fails = not function.is_a("SXFunction")
    operations = MANY if fails else function.n_instructions()
    sizes = (count,) if 0 < count <= FEW else row_blocks(count, operations)
    if len(sizes) != 1 or count >= COPIED:
        return _Rows(function, sizes, None, fails)
    flat = _prepare(map_function(function, sizes[0]))
    if flat.inputs is None:
        return _Rows(function, sizes, None, fails)
    inputs, outputs = (
        [memory.reshape(sizes[0], -1) for memory in part] for part in (flat.inputs, flat.outputs)
    )
    few = flat._replace(inputs=inputs, outputs=outputs, fails=fails)
    return _Rows(function, sizes, few, fails)


@lru_cache(maxsize=REMEMBERED)
def map_function(function: ca.Function, size: int) -> ca.Function:
    """The function of so many columns at once, (…, size) each."""
    return function.map(size) if size > 1 else function


def _rows(a: np.ndarray, count: int, whole: int) -> np.ndarray:
    """`a` with `count` rows, the last again until there are `whole`, in one piece of memory; faster
    than `np.broadcast_to` for few.
    """
    if a.ndim == 2 and len(a) == count == whole:
        return np.ascontiguousarray(a, dtype=float)
    rows = np.empty((whole, a.shape[-1]))
    rows[:count] = a
    rows[count:] = rows[count - 1 : count]
    return rows


SAFE = 1e-200  # squares between this and its reciprocal neither vanish nor overflow


def lengths(rows: np.ndarray) -> np.ndarray:
    """Euclidean lengths of the last axis, (…, n) → (…,), also where the squares would vanish or
    overflow.
    """
    squares = (rows * rows).sum(axis=-1)
    if rows.size and squares.min() > SAFE and squares.max() < 1 / SAFE:
        return np.sqrt(squares)
    largest = np.abs(rows).max(axis=-1, initial=0.0)
    size = np.where(largest > 0, largest, 1.0)
    return size * np.sqrt(((rows / size[..., None]) ** 2).sum(axis=-1))


def _one_by_one(function: ca.Function, columns: Sequence[np.ndarray]) -> list[np.ndarray]:
    """Values row by row."""
    rows = [call(function, *row) for row in zip(*columns, strict=True)]
    return [np.stack(x) for x in zip(*rows, strict=True)]


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
    _, sizes, few, fails = _rows_of(function, count)
    if few is not None:
        for rows, a in zip(few.inputs, arrays, strict=True):  # type: ignore[arg-type]
            if rows.shape[1] != a.shape[-1]:
                raise AssertionError(
                    f"{function.name()}: {a.shape[-1]} numbers a row, not {rows.shape[1]}"
                )
            if sizes[0] > count:
                rows[:count] = a
                rows[count:] = rows[count - 1 : count]
            else:
                rows[...] = a  # faster
        if few.run(few.outputs):
            return [rows[:count].copy() for rows in few.outputs]
        return _one_by_one(function, [_rows(a, count, count) for a in arrays])
    whole = sum(sizes)
    columns = [_rows(a, count, whole) for a in arrays]
    results: list[Sequence[np.ndarray]] = []
    done = 0
    for size in sizes:
        some = [a[done : done + size] for a in columns]
        part = [x.reshape(size, -1) for x in call(map_function(function, size), *some)]
        if fails and size > 1 and not all(x.size == 0 or math.isfinite(x[-1, -1]) for x in part):
            part = _one_by_one(function, some)  # a row that comes to no result ends the others
        results.append(part)
        done += size
    if len(results) == 1:
        return [x[:count] for x in results[0]]
    widths = [function.nnz_out(i) for i in range(function.n_out())]
    return [
        np.concatenate([r[i] for r in results] or [np.empty((0, k))])[:count]
        for i, k in enumerate(widths)
    ]

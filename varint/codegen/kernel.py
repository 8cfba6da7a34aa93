"""A compiled run loop and how it is called: one entry for every method."""

from __future__ import annotations

from collections.abc import Callable
from ctypes import addressof, c_char
from dataclasses import dataclass
from functools import cached_property
from time import perf_counter
from typing import NamedTuple

import numpy as np

from varint.codegen.arguments import (
    DONE,
    LATELY,
    MOST_NOTED,
    PartsArguments,
    RunArguments,
    RunStats,
    packing,
)
from varint.numerics.limits import ALONE_ITERATIONS, FIXED_POINT_ITERATIONS

_ARGUMENTS, _PARTS = packing(RunArguments), packing(PartsArguments)
_STATS = len(RunStats._fields_)


def _nothing(arguments: bytes) -> int:
    raise AssertionError("this loop is not compiled")


@dataclass(frozen=True, eq=False)
class Kernel:
    """A compiled run loop of one system and one rule.

    Attributes
    ----------
    about : str
        What runs, in words.
    n, controls, nodes : int
        Coordinates, controls, and control values (quadrature nodes or kicks) a step.
    operations : int
        Operations of one right-hand side, or of the equations of a step.
    opening : callable or None
        (q0, p0, u, t, h, c) of many fresh starts → what the loop must be told besides, a row each.
    scene : int
        Address of the scene's operations where they are data, or of its functions where they are
        compiled apart from the loop; else 0.
    block : array or None
        The memory of operations that are data.
    rows : int
        Constraint rows whose folds the loop notes.
    within_steps : callable or None
        c/within_steps.c, of a loop that has stages.
    """

    about: str
    n: int
    controls: int
    nodes: int
    operations: int
    entry: Callable[[bytes], int] = _nothing
    parts: Callable[[bytes], int] = _nothing
    carry_size: int = 0
    opening: Callable[..., np.ndarray] | None = None
    scene: int = 0
    block: np.ndarray | None = None
    rows: int = 0
    within_steps: Callable[[bytes], int] | None = None

    @cached_property
    def told(self) -> str:
        """How a user is told of it."""
        return f"{'native' if self.is_native else 'compiled'}: {self.about}"

    @property
    def is_native(self) -> bool:
        """Whether the scene is data."""
        return self.block is not None

    @property
    def note(self) -> tuple[int, int]:
        """Nodes of a note of a fold, and numbers of each of them; (0, 0) where none is made."""
        return (LATELY, 2 + 2 * self.n + self.rows) if self.rows else (0, 0)


_NOTHING = np.empty(0)


class LoopResult(NamedTuple):
    """What a kernel computed.

    Attributes
    ----------
    rows : array (rows, 3, n)
        q, p, v at the start and at every `save_every`-th node after it, up to where the run ended.
    status : int
        DONE, NOT_CONVERGED or NOT_FINITE; a failed run ends at node ``steps``, whose step was not
        possible. One that is DONE may have ended early, to tell of folds.
    steps, iterations, most_iterations : int
        Steps done, right-hand sides of all stages, and most of them in one step (0 for explicit
        methods).
    residual : float
        The worst of the solved steps: what remains of their equations, or what the change of the
        stages in the last iteration lets expect (0 for explicit methods).
    failed : float
        Residual, or relative change of the unknowns, where the iteration of a failed step ended.
    contraction : float
        Slowest ratio of two changes seen: near 1 the iteration hardly contracts and Newton's method
        is better.
    notes : array (notes, 1 + LATELY · numbers of a node)
        What was noted of folds; see c/folds.h.
    last : array (3n,)
        q, p, v of the node where the run ended, saved or not.
    carry : array
        Hand it to the next call to go on as if the run had not stopped.
    seconds : float
        Spent in the loop, whatever had to be built before.
    seen : array (2 · unknowns · steps,)
        What the stages of each step show, if that was asked for; see c/run.h.
    """

    rows: np.ndarray
    status: int
    steps: int
    iterations: int
    most_iterations: int
    residual: float
    failed: float
    contraction: float
    notes: np.ndarray
    last: np.ndarray
    carry: np.ndarray
    seconds: float
    seen: np.ndarray = _NOTHING

    @property
    def done(self) -> bool:
        """Whether it came to its end."""
        return self.status == DONE


def run_loop(
    kernel: Kernel,
    q0: np.ndarray,
    p0: np.ndarray,
    c: np.ndarray,
    *,
    t0: float,
    h: float,
    steps: int,
    save_every: int = 1,
    u: np.ndarray | None = None,
    first: int = 0,
    level: float = 0.0,
    most: int = FIXED_POINT_ITERATIONS,
    carry: np.ndarray | None = None,
    looks: tuple[np.ndarray, int] | None = None,
) -> LoopResult:
    """Take `steps` steps from node `first` at the time t0 + first·h.

    Parameters
    ----------
    kernel : Kernel
    q0, p0 : array (n,)
        State at node `first`; not read when `carry` is given.
    c : array
        Parameter values in the order of `system.c`, float64 and contiguous.
    t0, h : float
        Time of node 0 and step.
    steps, save_every, first : int
        Steps to take, distance of the saved nodes, index of the first node.
    u : array (steps, nodes, controls), optional
        Controls at the nodes of these steps, float64 and contiguous.
    level : float
        Relative error of the stages at which iterations stop; 0: round-off.
    most : int
        Largest number of iterations a step.
    carry : array, optional
        `Run.carry` of the call that ended at node `first`.
    looks : tuple, optional
        `StageLooks.heights` and unknowns of a stage, if it is to be told what the stages of a Gauss
        rule show.

    Returns
    -------
    Run
    """
    n, many = kernel.n, c.size
    stats = 2 * n + many
    last = stats + _STATS
    rows = last + 3 * n
    kept = rows + 3 * n * (steps // save_every + 1)
    noted = kept + kernel.carry_size
    nodes, size = kernel.note
    note = 1 + nodes * size
    # one block, so that its address is asked for once
    block = np.empty(noted + (MOST_NOTED * note if nodes else 0))
    block[:n] = q0
    block[n : 2 * n] = p0
    if many:
        block[2 * n : stats] = c
    if carry is None:
        block[kept] = 0.0
        if kernel.opening:
            when = np.array([t0 + h * first]), np.array([h])
            used = None if u is None else np.abs(u.reshape(-1, kernel.controls)).max(0)
            told = kernel.opening(q0[None], p0[None], used, *when, c)
            block[kept + 1 : kept + 1 + told.size] = told[0]
    else:
        block[kept:noted] = carry
    address = address_of(block)
    controls = 0 if u is None else address_of(u)
    seen, at = _NOTHING, (0, 0)
    if looks is not None:
        seen = np.empty(2 * looks[1] * steps)
        at = address_of(looks[0]), address_of(seen)
    results = (address + 8 * place for place in (rows, kept, stats))
    began = perf_counter()
    status = kernel.entry(
        _ARGUMENTS.pack(
            steps,
            save_every,
            first,
            most,
            t0,
            h,
            level,
            address,
            address + 16 * n,
            controls,
            *results,
            kernel.scene,
            address + 8 * noted if nodes else 0,
            0,
            0,
            *at,
            0.0,
            0,
        )
    )
    seconds = perf_counter() - began
    _, done, iterations, largest, *told, written = block[stats:last].tolist()
    end = kept if done == steps else rows + 3 * n * (int(done) // save_every + 1)
    table = block[rows:end].reshape(-1, 3, n)
    counts = int(done), int(iterations), int(largest)
    notes = block[noted : noted + int(written) * note].reshape(-1, note)
    residual, failed, contraction = told
    ends = block[last:rows], block[kept:noted]
    return LoopResult(
        table, status, *counts, residual, failed, contraction, notes, *ends, seconds, seen
    )


def take_parts(
    kernel: Kernel,
    q: np.ndarray,
    p: np.ndarray,
    c: np.ndarray,
    *,
    t: np.ndarray,
    h: np.ndarray,
    u: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """One step of its own size from each of many states: (q, p, v) there (M, 3, n), and which of
    the steps are solved.

    q and p are (M, n), t and h (M,), u (M, nodes · controls).
    """
    count, n = q.shape
    start = np.empty((count, 2 * n))
    start[:, :n], start[:, n:] = q, p
    t, h, u = (np.ascontiguousarray(x, dtype=float) for x in (t, h, u))
    opening = np.empty((count, 0))
    if kernel.opening:
        used = np.abs(u.reshape(count, -1, kernel.controls)).max(1) if kernel.controls else None
        opening = kernel.opening(q, p, used, t, h, c)
    rows, good = np.empty((count, 3, n)), np.empty(count, dtype=np.int64)
    most = ALONE_ITERATIONS
    arrays = (start, t, h, c, u, opening, rows, good)
    places = [address_of(x) if x.size else 0 for x in arrays]
    kernel.parts(_PARTS.pack(count, opening.shape[1], u.shape[1], most, *places, kernel.scene))
    return rows, good > 0


def told_of(kernel: Kernel, start: np.ndarray, c: np.ndarray, t: float, h: float) -> np.ndarray:
    """What the loop must be told besides at a state (q, p) of a scene without controls, (2, n)."""
    if kernel.opening is None:
        return np.empty(0)
    return kernel.opening(start[:1], start[1:], None, np.array([t]), np.array([h]), c)[0]


def take_part(
    kernel: Kernel, start: np.ndarray, c: np.ndarray, t: float, h: float, told: np.ndarray
) -> np.ndarray | None:
    """One step of its own size from a state (q, p) of a scene without controls, (2, n): (q, p, v)
    there, (3, n); None where it is not solved. `told` is what the loop must be told besides.

    What `take_parts` does for many, for those who look for an instant: a third of its time.
    """
    n, many = kernel.n, c.size
    at, size = 2 * n, 2 * n + 1
    opening = size + 1 + many
    rows = opening + told.size
    good = rows + 3 * n
    block = np.empty(good + 1)
    block[:at] = start.reshape(-1)
    block[at], block[size] = t, h
    block[size + 1 : opening] = c
    if told.size:
        block[opening:rows] = told
    address = address_of(block)
    starts = (0, at, size, size + 1, opening, opening, rows, good)
    places = [address + 8 * i for i in starts]
    kernel.parts(_PARTS.pack(1, told.size, 0, ALONE_ITERATIONS, *places, kernel.scene))
    return block[rows:good].reshape(3, n) if block[good:].view(np.int64)[0] > 0 else None


def address_of(array: np.ndarray) -> int:
    """Where the numbers of an array begin."""
    if not array.flags.writeable:
        return array.ctypes.data
    return addressof(c_char.from_buffer(array.data))  # a third of the time of ndarray.ctypes


def new_address(array: np.ndarray) -> int:
    """`address_of` one that has been made here, in one piece, with numbers in it."""
    return addressof(c_char.from_buffer(array))  # type: ignore[arg-type]

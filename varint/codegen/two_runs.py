"""Two runs and their difference in one call of c/two_runs_core.c."""

from __future__ import annotations

import struct
from typing import NamedTuple

import numpy as np

from varint.codegen.arguments import DONE
from varint.codegen.core import two_runs_entries
from varint.codegen.few_steps import entries_of
from varint.codegen.kernel import Kernel, address_of, new_address
from varint.codegen.rows import RowFunction
from varint.numerics.limits import FIXED_POINT_ITERATIONS

_FOUND = struct.Struct("qq3dP")  # Proved
# TwoRuns, what belongs to the course, to the places, and to what is asked
_COURSE, _PLACES, _ASKED = struct.Struct("7P7q"), struct.Struct("4Pq"), struct.Struct("q4d")
_TAKEN = struct.Struct("4PPqq2d")  # Taken
FOUND = _FOUND.size // 8  # numbers that the core tells
PROVED, NOT_PROVED, NOT_SHORT = range(3)


class Course(NamedTuple):
    """What runs, how its errors are measured, and what lies at its addresses; see `course_of`."""

    n: int
    head: bytes
    held: tuple


def course_of(
    kernel: Kernel,
    energy: RowFunction,
    order: int,
    pieces: tuple[int, int],
    linear: bool,
    body: np.ndarray,
    turns: np.ndarray,
    limits: np.ndarray,
) -> Course:
    """How a motion is run.

    Parameters
    ----------
    kernel : Kernel
    energy : RowFunction
        (q, p, t) → energy and |p·v|.
    order : int
        Of the rule.
    pieces : tuple of int
        Steps of the first piece of a run, after which its iteration must have contracted (0: it
        need not); most steps of a run.
    linear : bool
        Whether the order is sure.
    body, turns : array (n,) of int64
        The first coordinate of each one's body; whether it is an angle.
    limits : array
        Limits in c/two_runs_core.c.

    Raises
    ------
    CompileError
        If the loop was not built with the package and cannot be compiled.
    """
    two_runs_entries()
    on = entries_of(kernel, energy)
    arrays = limits, body, turns
    numbers = on.n, on.carry, order, int(linear), FIXED_POINT_ITERATIONS, *pieces
    calls = on.run, on.scene, on.rows, on.energy
    head = _COURSE.pack(*calls, *(address_of(x) for x in arrays), *numbers)
    return Course(on.n, head, (on, *arrays))


class Places(NamedTuple):
    """Where the start lies, and the `FOUND` numbers that are told; see `places_of`."""

    head: bytes
    told: np.ndarray


def places_of(start: int, mass: tuple[int, int], c: int, found: int, told: np.ndarray) -> Places:
    """Addresses of q and p at the start, of the diagonal of the mass matrix and how far its numbers
    are apart, of parameters, and of `FOUND` numbers that are told, which are this memory.
    """
    return Places(_PLACES.pack(start, c, mass[0], found, mass[1]), told)


class Found(NamedTuple):
    """A run of so many steps and its estimated error: nodes, times, coordinates and momenta."""

    steps: int
    runs: int
    estimate: float
    iterations: int
    residual: float
    k: np.ndarray
    t: np.ndarray
    q: np.ndarray
    p: np.ndarray


def two_runs(
    course: Course,
    places: Places,
    t0: float,
    duration: float,
    first: int,
    radians: float,
    tol: float,
) -> Found | int:
    """A run whose error is below tol by the difference to a coarser one; NOT_PROVED where that
    cannot be shown, NOT_SHORT where a run is too long, or another loop should go on.

    Parameters
    ----------
    course : Course
    places : Places
        The start, and parameters.
    t0, duration : float
    first : int
        Steps to begin with.
    radians : float
        How far the fastest small motions turn.
    tol : float
    """
    many, take = two_runs_entries()
    asked = _ASKED.pack(first, t0, duration, radians, tol)
    status = many(course.head + places.head + asked)
    if status != PROVED:
        return status
    steps, runs, estimate, iterations, residual, rows = _FOUND.unpack_from(places.told.data)
    n, nodes = course.n, steps + 1
    both, t, k = np.empty((2, nodes, n)), np.empty(nodes), np.empty(nodes, np.int64)
    at = new_address(both)
    done = take(
        _TAKEN.pack(
            rows,
            at,
            at + 8 * n * nodes,
            new_address(t),
            new_address(k),
            n,
            steps,
            t0,
            duration / steps,
        )
    )
    assert done == DONE
    return Found(steps, runs, estimate, int(iterations), residual, k, t, both[0], both[1])

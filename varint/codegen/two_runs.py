"""Two runs and their difference in one call of c/two_runs_core.c."""

from __future__ import annotations

import struct
from typing import NamedTuple

import numpy as np

from varint.codegen.arguments import DONE
from varint.codegen.core import two_runs_entries
from varint.codegen.few_steps import Entries, entries_of
from varint.codegen.kernel import Kernel, address_of, new_address
from varint.codegen.rows import RowFunction
from varint.numerics.limits import FIXED_POINT_ITERATIONS

_FOUND = struct.Struct("qq3dP")  # Proved
_ASKED = struct.Struct("11P8q4d")  # TwoRuns
_TAKEN = struct.Struct("4PPqq2d")  # Taken
FOUND = _FOUND.size // 8  # numbers that the core tells
PROVED, NOT_PROVED, NOT_SHORT = range(3)


class Course(NamedTuple):
    """What runs, and how its errors are measured; see `course_of`."""

    entries: Entries
    limits: int
    body: int
    turns: int
    order: int
    linear: int
    pilot: int
    longest: int
    held: tuple  # what lies at these addresses


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
    return Course(
        entries_of(kernel, energy),
        address_of(limits),
        address_of(body),
        address_of(turns),
        order,
        int(linear),
        *pieces,
        (limits, body, turns),
    )


class Places(NamedTuple):
    """Addresses of q and p at the start, of the diagonal of the mass matrix, of parameters, and of
    `FOUND` numbers that are told, which are this memory.
    """

    start: int
    mass: int
    c: int
    found: int
    told: np.ndarray


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
    *,
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
    entries = course.entries
    n, (start, mass, c, found, memory) = entries.n, places
    many, take = two_runs_entries()
    status = many(
        _ASKED.pack(
            entries.run,
            entries.scene,
            entries.rows,
            entries.energy,
            course.limits,
            start,
            c,
            mass,
            course.body,
            course.turns,
            found,
            n,
            entries.carry,
            course.order,
            first,
            course.linear,
            FIXED_POINT_ITERATIONS,
            course.pilot,
            course.longest,
            t0,
            duration,
            radians,
            tol,
        )
    )
    if status != PROVED:
        return status
    steps, runs, estimate, iterations, residual, rows = _FOUND.unpack_from(memory.data)
    nodes = steps + 1
    q, p = np.empty((nodes, n)), np.empty((nodes, n))
    t, k = np.empty(nodes), np.empty(nodes, np.int64)
    done = take(
        _TAKEN.pack(
            rows,
            new_address(q),
            new_address(p),
            new_address(t),
            new_address(k),
            n,
            steps,
            t0,
            duration / steps,
        )
    )
    assert done == DONE
    return Found(steps, runs, estimate, int(iterations), residual, k, t, q, p)

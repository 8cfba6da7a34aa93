"""Two runs and their difference in one call of c/two_runs_core.c."""

from __future__ import annotations

import struct
from collections.abc import Callable
from ctypes import c_void_p, cast
from typing import Any, NamedTuple

import numpy as np

from varint.codegen.arguments import DONE
from varint.codegen.beside import NOTHING_BESIDE, Beside
from varint.codegen.core import look_ahead_entry, two_runs_entries
from varint.codegen.few_steps import TOLD, Place, entries_of
from varint.codegen.kernel import Kernel, address_of, new_address
from varint.codegen.look_ahead import Look
from varint.codegen.rows import RowFunction
from varint.numerics.limits import FIXED_POINT_ITERATIONS

_FOUND = struct.Struct("qq3dPqqd")  # Proved
# TwoRuns, what belongs to the course, to the mass matrix and the room for nodes, and to what is
# asked; the place of the start stands behind the first
_COURSE, _MASS, _ASKED = struct.Struct("9P11q"), struct.Struct("PqPq"), struct.Struct("q4dP")
_RATES = struct.Struct("4P2q3d")  # Rates
MOST_RATES = 2
_TAKEN = struct.Struct("2P3q")  # Taken
ROOM = 2048  # numbers of nodes that lie where they are copied from, for what two calls take
_ARRAY, _FLOAT = np.ndarray, np.dtype(float)
assert _FOUND.size == 8 * TOLD
# VARIES and more: the error is not proved, since the first of the rates varies, or the next one
PROVED, NOT_PROVED, NOT_SHORT, DOUBTED, VARIES = range(5)
# proved by steps of more than one size, the first one but for a closer look; see `graded_run`
GRADED_DOUBTED, GRADED = -2, -1


class HeldLooks(NamedTuple):
    """How runs that constraint rows hold are looked at.

    Attributes
    ----------
    pivots : RowFunction, optional
        (q, t) → the least pivot of rows that may come to depend on one another.
    leaps : array, optional
        Limits of energies that may leap from one node to the next, in c/held.h.
    """

    pivots: RowFunction | None
    leaps: np.ndarray | None


class Course(NamedTuple):
    """The entry of the core, the loop that it calls, how many numbers each of so many parts of a
    node has, what runs, how its errors are measured, and what lies at its addresses; see
    `course_of`.
    """

    entry: Callable[[bytes], int]
    kernel: Kernel
    n: int
    parts: int
    head: bytes
    held: tuple


def course_of(
    kernel: Kernel,
    energy: RowFunction,
    order: int,
    pieces: tuple[int, int],
    linear: bool,
    by_velocity: bool,
    exact: bool,
    body: np.ndarray,
    turns: np.ndarray,
    limits: np.ndarray,
    looks: HeldLooks | None = None,
) -> Course:
    """How a motion is run.

    Parameters
    ----------
    kernel : Kernel
    energy : RowFunction
        (q, p, t) → energy and |p·v|; by velocity (q, v, t).
    order : int
        Of the rule.
    pieces : tuple of int
        Steps of the first piece of a run, after which its iteration must have contracted (0: it
        need not); most steps of a run.
    linear : bool
        Whether the order is sure.
    by_velocity : bool
        Whether velocities, which have no formula, are made by the runs. Nodes have them where no
        constraint rows hold the motion.
    exact : bool
        Whether all steps are one map, which keeps energies but for round-off.
    body, turns : array (n,) of int64
        The first coordinate of each one's body; whether it is an angle.
    limits : array
        Limits in c/two_runs_core.c.
    looks : HeldLooks, optional
        Of a motion that constraint rows hold.

    Raises
    ------
    CompileError
        If the loop was not built with the package and cannot be compiled.
    """
    entry = two_runs_entries()[0]
    on = entries_of(kernel, energy)
    arrays = limits, body, turns
    numbers = on.n, on.carry, order, int(linear), FIXED_POINT_ITERATIONS, *pieces
    kind = int(by_velocity), int(exact), int(looks is not None), kernel.note[1]
    calls = on.run, on.scene, on.rows, on.energy
    pivots, leaps = looks or (None, None)
    looked = 0 if pivots is None else pivots.at, 0 if leaps is None else address_of(leaps)
    head = _COURSE.pack(*calls, *(address_of(x) for x in arrays), *looked, *numbers, *kind)
    parts = 3 if by_velocity and looks is None else 2
    return Course(entry, kernel, on.n, parts, head, (on, looks, *arrays))


class Places(NamedTuple):
    """Where the start and the diagonal of the mass matrix lie, and nodes will; see `places_of`.

    Attributes
    ----------
    head : bytes
    told : memoryview
    room : array
    views : dict
        Nodes as they lie there, by the number of the last one.
    """

    head: bytes
    told: memoryview
    room: np.ndarray
    views: dict[int, np.ndarray]


def places_of(start: Place, mass: int, apart: int) -> Places:
    """A start, and the address of the diagonal of the mass matrix, its numbers so far apart."""
    room = np.empty(ROOM)
    head = start.head + _MASS.pack(mass, apart, address_of(room), ROOM)
    return Places(head, start.told, room, {})


class Rates(NamedTuple):
    """Where rates lie that steps could follow, 0 if there are none, and what lies there; see
    `rates_of`.
    """

    at: int
    held: tuple


def rates_of(
    rows: RowFunction, looks: list[Look], steps: int, angle: float, astray: float, worth: float
) -> Rates:
    """How runs that went astray are looked at: by (q, p) → each of the rates, velocities, and ahead
    by each of them in so many steps of an angle, until the energy is astray by so much of p·v, for
    one that becomes so many times as large as it is in the mean.
    """
    ahead = cast(look_ahead_entry(), c_void_p).value or 0  # type: ignore[arg-type]
    places = [*(look.at for look in looks), 0][:MOST_RATES]
    numbers = len(looks), steps, angle, astray, worth
    return _rates(_RATES.pack(rows.at, ahead, *places, *numbers), rows, looks)


def _rates(packed: bytes, *held: Any) -> Rates:
    block = np.frombuffer(packed, np.uint8).copy()
    return Rates(address_of(block), (block, *held))


UNASKED = _rates(bytes(_RATES.size))  # nobody has needed them
NO_RATES = Rates(0, ())


# steps of a run, runs that were made, its estimated error, iterations, residual; coordinates and
# momenta of its nodes, with velocities where these have no formula; whether more is to be looked at
# before it is proved; and zeros that were looked for, see `Sought` (a tuple is made in a tenth of
# the time of one with names)
Found = tuple[int, int, float, float, float, np.ndarray, bool, np.ndarray | None]


def runs_made(places: Places) -> int:
    """How many runs the last call has made."""
    return _FOUND.unpack_from(places.told)[1]  # type: ignore[no-any-return]


def graded_run(course: Course, places: Places) -> tuple[int, int, float, float, float, np.ndarray]:
    """The run that the last call has found by steps of more than one size: steps, runs, estimate,
    iterations, residual; coordinates, momenta, and times in the place of the first velocity.
    """
    *told, rows, last, _, _ = _FOUND.unpack_from(places.told)
    return *told, _taken(rows, course.n, last, 3)  # type: ignore[return-value]


def _taken(rows: int, n: int, last: int, parts: int) -> np.ndarray:
    """Nodes from memory of the core, which is given back."""
    nodes = np.empty((parts, last + 1, n))
    done = two_runs_entries()[1](_TAKEN.pack(rows, new_address(nodes), n, last, parts))
    assert done == DONE
    return nodes


def two_runs(
    course: Course,
    places: Places,
    t0: float,
    duration: float,
    first: int,
    radians: float,
    tol: float,
    rates: Rates = NO_RATES,
    beside: Beside = NOTHING_BESIDE,
) -> Found | int:
    """A run whose error is below tol by the difference to a coarser one; NOT_PROVED where that
    cannot be shown, NOT_SHORT where a run is too long, or another loop should go on, VARIES where
    one of the rates varies so much along a run that went astray that steps should follow it.

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
    rates : Rates, optional
        That steps could follow.
    beside : Beside, optional
    """
    asked = _ASKED.pack(first, t0, duration, radians, tol, rates.at)
    status = course.entry(course.head + places.head + asked + beside.opening + beside.search)
    if status != PROVED and status != DOUBTED:
        return status
    told = _FOUND.unpack_from(places.told)
    steps, runs, estimate, iterations, residual, rows, last, some, _ = told
    shape, zeros = (course.parts, last + 1, course.n), beside.zeros
    if rows:
        nodes = _taken(rows, course.n, last, shape[0])
    else:
        view = places.views.get(last)
        if view is None:
            view = places.views[last] = _ARRAY(shape, _FLOAT, places.room)
        nodes = view.copy()
    found = None if zeros is None else zeros[:some].copy()
    return steps, runs, estimate, iterations, residual, nodes, status == DOUBTED, found

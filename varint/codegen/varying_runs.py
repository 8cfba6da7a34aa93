"""Two runs with steps that follow the scene, and their difference, in one call of
c/varying_core.c.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from ctypes import c_void_p, cast
from typing import Any, NamedTuple

import numpy as np

from varint.codegen.core import nearness_entries, until_entry, varying_runs_entry
from varint.codegen.kernel import address_of
from varint.codegen.nearness import Nearness, Places
from varint.codegen.two_runs import DOUBTED, NOT_PROVED, NOT_SHORT, PROVED
from varint.codegen.until import PROVED_AT, Entries, Until, found_in, give_back, take_room

# Varying: what belongs to the course, before what is known of nearness and of a run; what is asked
_COURSE, _ASKED = struct.Struct("4Pq3d"), struct.Struct("Pq3d")
_FOUND = struct.Struct("2q2d2q")  # Proved


class Course(NamedTuple):
    """The entry of the core, how runs are made and looked at, and what lies at its addresses."""

    entry: Callable[[bytes], int]
    head: bytes
    held: tuple


def varying_course(
    nearness: Nearness, order: int, patience: tuple[float, float, float], limits: np.ndarray
) -> Course:
    """How motions are run.

    Parameters
    ----------
    nearness : Nearness
    order : int
        Of the rule.
    patience : tuple of float
        A run is given up after so many times the steps that are expected and so many more, or
        where a step takes more iterations than that.
    limits : array
        Limits in c/proof.h.

    Raises
    ------
    CompileError
        If the loop was not built with the package and cannot be compiled.
    """
    entries: tuple[Any, ...] = (until_entry(), *nearness_entries())
    calls = (cast(entry, c_void_p).value or 0 for entry in entries)
    head = _COURSE.pack(address_of(limits), *calls, order, *patience) + nearness.head
    return Course(varying_runs_entry(), head, (nearness, limits))


class Found(NamedTuple):
    """Steps of a run over the duration at the pace that was foreseen, runs that were made, the
    estimated error, the run, and where the start's round-off is to be looked at the error that its
    iterations were made for, and whether it may be more than was seen; else None.
    """

    steps: int
    runs: int
    estimate: float
    run: Until
    doubt: tuple[float, bool] | None


def varying_runs(
    course: Course,
    places: Places,
    entries: Entries,
    asked: bytes,
    first: int,
    radians: float,
    span: float,
    tol: float,
) -> Found | int:
    """A run whose error is below tol by the difference to a coarser one; NOT_PROVED where that
    cannot be shown, NOT_SHORT where another loop should go on.

    Parameters
    ----------
    course : Course
    places : Places
        Parameters and masses.
    entries : Entries
    asked : bytes
        By `asked_of`, for any step.
    first : int
        Steps to begin with.
    radians, span : float
        How far the fastest small motions turn; fictitious time that the duration takes.
    tol : float
    """
    memory = take_room()
    try:
        at = _ASKED.pack(memory.at + 8 * PROVED_AT, first, radians, span, tol)
        status = course.entry(course.head + places.head + entries.head + memory.where + asked + at)
        steps, runs, estimate, wanted, unseen, failed = _FOUND.unpack_from(
            memory.room, 8 * PROVED_AT
        )
        if status not in (PROVED, DOUBTED):
            return NOT_SHORT if failed else NOT_PROVED
        run = found_in(memory, entries)
    finally:
        give_back(memory)
    doubt = (wanted, bool(unseen)) if status == DOUBTED else None
    return Found(steps, runs, estimate, run, doubt)

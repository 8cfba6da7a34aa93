"""Default calls of the same start and duration as the one before: all that is looked up for them is
there, and one call of c/direct.c makes the motion.
"""

from __future__ import annotations

import struct
from typing import NamedTuple

import casadi as ca
import numpy as np

from varint.codegen.beside import Beside
from varint.codegen.built import built_module
from varint.codegen.kernel import Kernel
from varint.codegen.two_runs import Places, Rates
from varint.integration.even_motion import Made
from varint.integration.plain_start import Room, Watched
from varint.integration.tolerance import DEFAULT_TOL
from varint.rules.rule import Rule
from varint.scene.system import System

PLACE = "_repeated"  # of a system's attributes
BY_DEFAULT = "auto", "raise", 1  # backend, on_failure, save_every
_LAST = struct.Struct("6d")


class Repeated(NamedTuple):
    """What a call was asked for, and what was looked up for it. The fields are those of
    c/repeated.h.

    Attributes
    ----------
    last : bytes
        t0, duration, tol and the one by default, radians and steps that the first run begins with.
    state : bytes
        Coordinates and velocities of the start.
    rule : Rule or None
    by_default : tuple
        What must be asked for besides.
    room, pool, known
        Where the start is, where that lies when nobody uses it, and the start that is known there.
    high, kernel
        The compiled loop as it is now, and as it was.
    how, places, c, rates, beside
        As `proved_motion` takes them.
    watched : tuple
        Expressions that were watched for, and what tells whether one has been changed since.
    """

    last: bytes
    state: bytes
    rule: Rule | None
    by_default: tuple[str, str, int]
    room: Room
    pool: list[Room]
    known: tuple[bytes, float] | None
    high: list[Kernel]
    kernel: Kernel
    how: Made
    places: Places
    c: np.ndarray
    rates: list[Rates]
    beside: Beside | None
    watched: tuple[tuple[ca.SX, int], ...]


def remember(
    system: System,
    rule: Rule | None,
    room: Room,
    pool: list[Room],
    high: list[Kernel],
    how: Made,
    rates: list[Rates],
    c: np.ndarray,
    asked: tuple[float, float, int, float, float],
    beside: Beside | None,
    watched: Watched | None,
) -> None:
    """That a call for t0, duration, first steps, radians and tol went so, from the start in a room;
    by the compiled loop that is the high gear now. Of a start that is met once it is not.
    """
    if room.known is None or built_module() is None:
        return
    expressions = () if watched is None else watched.expressions()
    if not all(type(x) is ca.SX for x in expressions):
        return
    if room.known is not room.met:
        room.met = room.known
        return
    t0, duration, first, radians, tol = asked
    last = _LAST.pack(t0, duration, tol, DEFAULT_TOL, radians, first)
    there = room, pool, room.known, high, how.course.kernel, how, room.places
    kept = tuple((x, x.element_hash()) for x in expressions)
    ready = Repeated(last, room.known[0], rule, BY_DEFAULT, *there, c, rates, beside, kept)
    system.__dict__[PLACE] = ready

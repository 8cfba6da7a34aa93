"""A rough look along the first steps of a motion, in one call of c/look_ahead_core.c."""

from __future__ import annotations

import struct
from typing import NamedTuple

import casadi as ca
import numpy as np

from varint.codegen.block import block_of, start_of
from varint.codegen.cache import CompileError
from varint.codegen.core import look_ahead_entry
from varint.codegen.graph import NotCompilable
from varint.codegen.kernel import address_of, new_address
from varint.codegen.native import tapes_of
from varint.codegen.routines import routines

_ASKED = struct.Struct("4P2q4d")  # LookAhead


class Look(NamedTuple):
    """Operations of a rate and of a step, and where they begin; coordinates."""

    n: int
    block: np.ndarray
    at: int


def look_of(
    n: int, rate: tuple[ca.SX, ca.SX], step: tuple[list[ca.SX], list[ca.SX]], constants: ca.SX
) -> Look | None:
    """A look at n coordinates by ((q, v), ω) and by ((q, v, dt), sign) → ((q, v, dt) after it; dt,
    ω there, energy and p·v before it); None where they have no form as data, or the loop was not
    built with the package and cannot be compiled.
    """
    try:
        look_ahead_entry()
        at, omega = rate
        tapes = tapes_of(routines(constants, {"rate": ([at], [omega]), "step": step}))
    except (NotCompilable, CompileError):
        return None
    block = block_of([tapes["rate"], tapes["step"]])
    return Look(n, block, start_of(block))


def look_ahead(
    look: Look,
    start: np.ndarray,
    c: np.ndarray,
    *,
    steps: int,
    angle: float,
    backwards: bool,
    total: float,
    astray: float,
) -> tuple[float, float, float, float] | None:
    """Mean of ω over time, its largest value, the time that was seen and ω at the start, in so many
    steps of an angle ω dt, from the coordinates and velocities `start` for `total` at most, until
    the energy is astray by so much of p·v; None where there is no step.
    """
    told = np.empty(4)
    sign = -1.0 if backwards else 1.0
    places = look.at, address_of(start), address_of(c) if c.size else 0, new_address(told)
    numbers = angle, sign, total, astray
    seen = look_ahead_entry()(_ASKED.pack(*places, look.n, steps, *numbers))
    if seen < 2:
        return None
    mean, largest, duration, first = told.tolist()
    return mean, largest, duration, first

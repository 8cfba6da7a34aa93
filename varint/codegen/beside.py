"""What is asked beside the runs that prove an error: what their loop must be told at a fresh start,
and what is looked for on the way.
"""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from varint.codegen.kernel import address_of, new_address
from varint.codegen.rows import RowFunction
from varint.numerics.limits import FIXED_POINT_ITERATIONS

if TYPE_CHECKING:
    from varint.codegen.sought import Sought

_OPENING = struct.Struct("2Pq")
_SEARCH = struct.Struct("4P3q2P")  # Search
NO_OPENING = _OPENING.pack(0, 0, 0)
UNSEARCHED = _SEARCH.pack(*[0] * 9)


class Beside(NamedTuple):
    """What is asked beside the runs that prove an error, of one start. The fields are those of
    c/direct.c.

    Attributes
    ----------
    opening : bytes
        Of a loop that must be told more at a fresh start, see `opening_for`.
    search : bytes
        What is looked for along the run.
    stops : bool
        Whether that ends with the first zero of the first expression.
    names : tuple of str
        Of the expressions.
    zeros : array, optional
        Where zeros lie that were found.
    held : tuple
        What lies behind that.
    """

    opening: bytes
    search: bytes = UNSEARCHED
    stops: bool = False
    names: tuple[str, ...] = ()
    zeros: np.ndarray | None = None
    held: tuple = ()


NOTHING_BESIDE = Beside(NO_OPENING)


def searched_beside(
    opening: bytes,
    what: Sought,
    speed: np.ndarray,
    velocities: RowFunction | None,
    longest: int,
    typical: tuple[int, int],
    stops: bool,
    names: tuple[str, ...],
) -> Beside:
    """A search along runs from a start with this velocity, of so many steps at most.

    `velocities` is (q, p, t) → v for loops that look for none, `typical` how others are told
    typical sizes.
    """
    zeros = np.empty((what.room, what.width))
    places = what.at, address_of(speed), velocities.at if velocities else 0, new_address(zeros)
    numbers = what.room, longest, FIXED_POINT_ITERATIONS
    search = _SEARCH.pack(*places, *numbers, *typical)
    return Beside(opening, search, stops, names, zeros, (what, speed, velocities))


def opening_for(open_at: int, told: np.ndarray) -> bytes:
    """What the core is told of a loop that must be told more at a fresh start: the address of a
    function of steps h, and where it writes that.
    """
    return _OPENING.pack(open_at, address_of(told), told.size)

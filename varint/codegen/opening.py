"""What Newton's loops are told besides at fresh starts: typical sizes, and the velocity."""

from __future__ import annotations

import math
from collections.abc import Callable
from ctypes import CFUNCTYPE, c_double, c_int, c_int64, c_void_p, cast
from typing import NamedTuple

import numpy as np

from varint.codegen.arguments import c_number, c_source
from varint.codegen.beside import opening_for
from varint.codegen.kernel import address_of
from varint.discrete.scales import opening_function
from varint.numerics.arrays import over_columns, trigger_on
from varint.scene.system import System


def opening_values(system: System) -> Callable[..., np.ndarray]:
    """(q0, p0, u, t, h, c) → typical sizes and velocity at fresh starts, a row each; u are the
    sizes of the controls.
    """
    none = np.zeros(system.control.numel())

    def told(
        q: np.ndarray,
        p: np.ndarray,
        u: np.ndarray | None,
        t: np.ndarray,
        h: np.ndarray,
        c: np.ndarray,
    ) -> np.ndarray:
        used = none if u is None else u
        return over_columns(opening_function(system), q, p, used, t[:, None], h[:, None], c)[0]

    return told


_OPEN, _SIZES = CFUNCTYPE(c_int, c_double), CFUNCTYPE(c_int, c_int64)
SEEN = c_number(c_source("sought.h"), "SEEN")


class Opening(NamedTuple):
    """The same at one start, which has memory of its own.

    Attributes
    ----------
    u, h : array
        To be written: sizes of controls, and the step.
    told : array (3n,)
    look : callable
        () → whether it is there.
    by_core : bytes
        How the core asks for it.
    typical : tuple
        How the core is told typical sizes at nodes of a run from there.
    raised : list
        What was raised meanwhile.
    held : tuple
        What lies behind that.
    """

    u: np.ndarray
    h: np.ndarray
    told: np.ndarray
    look: Callable[[], bool]
    by_core: bytes
    typical: tuple[int, int]
    raised: list[BaseException]
    held: tuple


def opening_on(
    system: System, q: np.ndarray, p: np.ndarray, t: np.ndarray, c: np.ndarray
) -> Opening:
    """Of the start in this memory; in a third of the time of `opening_values`."""
    n, u, h = len(q), np.zeros(system.control.numel()), np.zeros(1)
    told, size = np.zeros(3 * n), 2 * n - 1
    find, one = trigger_on(opening_function(system), (q, p, u, t, h, c), (told,))

    def look() -> bool:
        told[size] = told[-1] = math.nan  # where an iteration comes to no end
        find()
        return not (math.isnan(told[size]) or math.isnan(told[-1]))

    raised: list[BaseException] = []

    def look_for(step: float) -> bool:
        try:
            h[0] = step
            return look()
        except BaseException as error:  # nothing is raised through the core
            raised.append(error)
            return False

    block, found = np.zeros(SEEN * (1 + 2 * n) + 2 * n), np.zeros(3 * n)
    times, places, momenta, largest = np.split(block, np.cumsum([SEEN, SEEN * n, SEEN * n]))
    first = places[:n], momenta[:n], np.zeros(u.size), times[:1], h, c
    find_there, there = trigger_on(opening_function(system), first, (found,))
    sizes = found[: 2 * n]

    def largest_at(count: int) -> bool:
        try:
            for i in range(count):  # one by one: mostly it is one
                if i:
                    some = slice(n * i, n * (i + 1))
                    times[0], places[:n], momenta[:n] = times[i], places[some], momenta[some]
                sizes[-1] = math.nan
                find_there()
                largest[:] = np.maximum(largest, sizes) if i else sizes
            return not math.isnan(largest[-1])
        except BaseException as error:
            raised.append(error)
            return False

    asked, looking = _OPEN(look_for), _SIZES(largest_at)
    open_at, looks = (cast(x, c_void_p).value or 0 for x in (asked, looking))  # type: ignore[arg-type]
    held = one, there, asked, looking, block
    typical = looks, address_of(block)
    return Opening(u, h, told, look, opening_for(open_at, told), typical, raised, held)

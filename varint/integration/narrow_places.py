"""Errors that are made at once: in the one step, of each run, that meets a narrow place.

Steps that resolve all but a narrow bump or a short passage err there and nowhere else, and by how
much depends on where their nodes happen to lie: of two runs the finer one may err by a thousandth
as much as the other, or by a half. What differences tell of an order is luck then. The steps at
that place, done once more in parts, show what the finer run makes there: its error is to the
difference of the runs as this to their difference at that place.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

# times what runs are apart before the place, and part of their largest difference; parts of steps
AT_ONCE, PART_OF_IT, PARTS = 10.0, 0.05, 2
# times what the first such place shows, where nodes that are compared are few of those that err: of
# 1440 runs over narrow bumps 16 erred by more than was wanted, 6 do, for 4 in a thousand more steps
UNCERTAIN = 3.0


def made_at_once(
    one: np.ndarray,
    other: np.ndarray,
    off: float,
    scales: np.ndarray,
    again: Callable[[int, int], np.ndarray | None],
) -> float:
    """Error of the finer one of two runs where it is made at a narrow place, 0 where it is not.

    Parameters
    ----------
    one : array (M + 1, 2 or more, n)
        q and p of the coarser run where both have nodes.
    other : array (N + 1, 2 or more, n)
        Those of the finer one.
    off : float
        The largest difference.
    scales : array (n,)
    again : callable
        (node, count) → nodes of so many of the `PARTS` of steps from there; None where they fail.
    """
    each, rows = (len(other) - 1) // (len(one) - 1), other[:, :2]
    both = scales_with_momenta(rows, scales)
    differ = parted_by(one[:, :2], rows[::each], both)
    k = narrow_place(differ)
    if not k:
        return 0.0
    end = min(k + 1, len(differ) - 1)  # it may end in the next part
    fine = again(each * (k - 1), PARTS * each * (end - k + 1))
    if fine is None:
        return math.inf
    made = parted_by(fine[-1, :2], rows[each * end], both)
    return float(UNCERTAIN * off * made / differ[k])


def narrow_place(apart: np.ndarray) -> int:
    """Number of the node, of those (nodes,) at which two runs are so far apart, with which a
    difference begins that is made at once; 0 where it grows bit by bit.
    """
    k = int(np.argmax(apart >= PART_OF_IT * apart.max()))
    return k if k and apart[k] > AT_ONCE * apart[k - 1] else 0


def parted_by(one: np.ndarray, other: np.ndarray, scales: np.ndarray) -> np.ndarray:
    """Largest differences (...,) of coordinates and momenta (..., 2, n) by their scales (2, n)."""
    apart: np.ndarray = (np.abs(one - other) / scales).max(axis=(-2, -1))
    return apart


def scales_with_momenta(rows: np.ndarray, scales: np.ndarray) -> np.ndarray:
    """Scales (2, n) of coordinates, which are known, and of momenta: the largest ones in `rows`."""
    largest = np.abs(rows[:, 1]).max(axis=0)
    return np.stack((scales, np.where(largest > 0, largest, np.inf)))

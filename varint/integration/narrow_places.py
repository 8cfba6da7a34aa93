"""Errors that are made at once: in the one step, of each run, that meets a narrow place.

Steps that resolve all but a narrow bump or a short passage err there and nowhere else, and by how
much depends on where their nodes happen to lie: of two runs the finer one may err by a thousandth
as much as the other, or by a half. What differences tell of an order is luck then. The steps at
that place, done once more in parts, show what the finer run makes there: its error is to the
difference of the runs as this to their difference at that place.
"""

from __future__ import annotations

import numpy as np

# times what runs are apart before the place, and part of their largest difference; parts of steps
AT_ONCE, PART_OF_IT, PARTS = 10.0, 0.05, 2
# times what the first such place shows, where nodes that are compared are few of those that err: of
# 1440 runs over narrow bumps 16 erred by more than was wanted, 6 do, for 4 in a thousand more steps
UNCERTAIN = 3.0


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

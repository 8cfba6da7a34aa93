"""What Newton's loops are told besides at fresh starts: typical sizes, and the velocity."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from varint.discrete.legendre import velocity_function
from varint.discrete.scales import scale_function
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
        scale = over_columns(scale_function(system), q, p, used, t[:, None], h[:, None], c)[0]
        return np.hstack([scale, over_columns(velocity_function(system), q, p, t[:, None], c)[0]])

    return told


class Opening(NamedTuple):
    """The same at one start, which has memory of its own.

    Attributes
    ----------
    u, h : array
        To be written: sizes of controls, and the step.
    told : array (3n,)
    look : callable
        () → whether it is there.
    held : tuple
        What lies behind that.
    """

    u: np.ndarray
    h: np.ndarray
    told: np.ndarray
    look: Callable[[], bool]
    held: tuple


def opening_on(
    system: System, q: np.ndarray, p: np.ndarray, t: np.ndarray, c: np.ndarray
) -> Opening:
    """Of the start in this memory; in a third of the time of `opening_values`."""
    n, u, h = len(q), np.zeros(system.control.numel()), np.zeros(1)
    told = np.zeros(3 * n)
    sizes, v = told[: 2 * n], told[2 * n :]
    find_sizes, one = trigger_on(scale_function(system), (q, p, u, t, h, c), (sizes,))
    find_velocity, other = trigger_on(velocity_function(system), (q, p, t, c), (v,))

    def look() -> bool:
        sizes[-1] = v[-1] = math.nan  # where an iteration comes to no end
        find_sizes()
        find_velocity()
        return not (math.isnan(sizes[-1]) or math.isnan(v[-1]))

    return Opening(u, h, told, look, (one, other))

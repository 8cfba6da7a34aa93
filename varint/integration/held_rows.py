"""The start of a run that constraint rows hold: its momentum along them, where the start lies on
them beyond doubt.

`put_on_manifold` does the same for all starts, and says what is wrong.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from varint.codegen.held import HeldStart, is_clear
from varint.discrete.constraints import (
    every_row_function,
    position_rows_function,
    tangent_function,
)
from varint.discrete.projection import LEAST, OFF
from varint.integration.start import STEEPEST
from varint.numerics.arrays import trigger_on
from varint.scene.memory import per_scene
from varint.scene.system import System


@per_scene
def is_held(system: System) -> bool:
    """Whether constraint rows hold the motion, always the same ones."""
    s = system.structure
    held = s.constraints or s.nonholonomic
    return bool(held) and not (s.contacts or s.degenerate or system.rays)


def momentum_put_on_rows(
    system: System,
    q: np.ndarray,
    v: np.ndarray,
    t: np.ndarray,
    c: np.ndarray,
    p: np.ndarray,
    mass: np.ndarray,
) -> tuple[Callable[[], bool], tuple]:
    """() → whether the start in this memory lies on the rows, they are independent and it
    determines a motion, beyond doubt, and its momentum has lost its round-off across them; and what
    lies behind that.

    Raises
    ------
    CompileError
        If the look at it was not built with the package and cannot be compiled.
    """
    n, m, rows = system.structure.n, system.structure.constraints, system.structure.velocity_rows
    sizes = m, m * n, rows, rows * n, n, n
    g, across, speeds, slopes, along, change = np.split(
        np.zeros(sum(sizes)), np.cumsum(sizes[:-1]).tolist()
    )
    functions = (
        (every_row_function, (q, v, t, c), (speeds, slopes)),
        (position_rows_function, (q, t, c), (g, across)),
        (tangent_function, (q, p, t, c), (along, change)),
    )
    triggers, behind = zip(
        *(trigger_on(of(system), given, found) for of, given, found in functions), strict=True
    )
    look_at_rows, look_at_places, look_along = triggers
    start = HeldStart(q, v, mass, g, speeds, slopes, along, change, p, (OFF, STEEPEST, LEAST))
    clear = is_clear(start)

    def put() -> bool:
        look_at_rows()
        look_at_places()
        change[-1] = math.nan  # where the linear solve comes to no end
        look_along()
        return clear()

    return put, (behind, start)

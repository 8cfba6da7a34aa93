"""Runs for a wanted accuracy whose controls follow a table, as most are asked for: a start, a
duration, an accuracy, and rows that follow one another.

`to_tolerance` does the same where more is asked for, or something is not as it should be, and says
what.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from varint.integration.cuts import clear_of_cuts
from varint.integration.plain_start import begin_in, room_of
from varint.integration.short_call import is_plainly_asked
from varint.integration.short_scenes import fastest_of
from varint.integration.small_motions import angles_turned
from varint.integration.table_trials import by_table, fits, known_of
from varint.integration.tolerance import DEFAULT_TOL
from varint.numerics.limits import check_steps
from varint.results.trajectory import Trajectory
from varint.rules.rule import Rule
from varint.scene.parameters import ParameterValues
from varint.scene.system import System


def table_call(
    system: System,
    rule: Rule | None,
    start: tuple[Any, Any, Any, ParameterValues | None],
    p0: Any,
    duration: Any,
    tol: float | None,
    u: Any,
    began: float,
) -> Trajectory | int | None:
    """The motion from a start (q0, v0, t0, params), or from momenta in place of v0, under the
    controls of a table, if a few runs prove its error; what `by_table` says if not; None where
    another way is to be taken.
    """
    t0, tol = start[2], DEFAULT_TOL if tol is None else tol
    if not is_plainly_asked(rule, t0, duration, tol):
        return None
    known = known_of(system, rule)
    if known is None or not (p0 is None or known.by_momentum):
        return None
    table = _table(u, known.controls)
    if table is None or not fits(known, table):
        return None
    pool = known.rooms
    room = pool.pop() if pool else room_of(system, True)
    try:
        room.u[:], room.known = table[0, 0], None
        c = begin_in(room, system, start, p0)
        room.known = None  # it does not tell of controls
        if c is None:
            return None
        t0, duration = float(t0), float(duration)
        check_steps(t0, duration, 1)
        assert room.look is not None
        room.look()
        fastest = fastest_of(known.n, known.last, room.local)
        radians, _ = angles_turned(duration, fastest, 0.0)
        asked = t0, duration, radians, tol
        found = by_table(system, known, table, room.places, c, asked, "auto", began)
        return clear_of_cuts(found)  # type: ignore[no-any-return]
    finally:
        pool.append(room)


def _table(u: Any, controls: int) -> np.ndarray | None:
    """The user's table as (rows, 1 or r, k); None where it is none, or something of it is not
    finite, and that is told elsewhere.
    """
    try:
        table = np.array(u, dtype=float)
    except (TypeError, ValueError, RuntimeError):
        return None
    if table.ndim == 1 and controls == 1:
        table = table[:, None]
    if table.ndim == 2:
        table = table[:, None, :]
    if table.ndim != 3 or not math.isfinite(table.sum()):
        return None
    return np.ascontiguousarray(table)

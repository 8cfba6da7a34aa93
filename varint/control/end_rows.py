"""Which rows are imposed at an end: those that given coordinates, velocities and links do not say
already.
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from varint.control.phase import CheckedPhase
from varint.discrete.consistency import rows_beyond
from varint.discrete.constraints import velocity_rows
from varint.errors import InputError


def find_kept_rows(
    phase: CheckedPhase, t0: float, tied: bool, q: np.ndarray, last: bool
) -> tuple[np.ndarray, np.ndarray]:
    """Which rows of g(q) = 0 and of W v + w = 0 are independent of the given coordinates and
    velocities.
    """
    m, held = phase.system.structure.constraints, phase.system.structure.velocity_rows
    if not held or tied:
        return np.zeros(m, dtype=bool), np.zeros(held, dtype=bool)
    s, end = phase.system, phase.end if last else phase.start
    slope = ca.Function("W", [s.q, s.t, s.c], [ca.densify(ca.jacobian(velocity_rows(s), s.v))])
    W = np.array(slope(q, t0 + (phase.duration[0] if last else 0.0), phase.c))
    given = [bounds[1] == bounds[2] for bounds in (end.q, end.v)]
    kept = [
        rows_beyond(np.eye(s.structure.n)[fixed], rows)
        for fixed, rows in zip(given, (W[:m], W), strict=True)
    ]
    if not given[0].all() and not kept[0].all():
        names = [name for name, y in zip(s.names, given[0], strict=True) if y]
        raise InputError(
            f"at the {'end' if last else 'start'} the coordinates {names} and constraint "
            f"{int(np.flatnonzero(~kept[0])[0])} say the same at q = {q.tolist()}: give all "
            "coordinates, or others"
        )
    return kept[0], kept[1]


def bounded_at_end(phase: CheckedPhase, last: bool) -> np.ndarray:
    """Which expressions of `at_points` are bounded at an end: those of given coordinates hold or do
    not, and gaps that a link closes are 0.
    """
    end, rows = phase.end if last else phase.start, ca.vertsplit(phase.bounds.at_points)
    q = phase.system.q
    chosen = ca.vertcat(ca.SX(0, 1), *(q[int(i)] for i in np.flatnonzero(end.q[1] < end.q[2])))
    if not chosen.numel():
        return np.zeros(len(rows), dtype=bool)
    bounded = np.array([ca.depends_on(row, chosen) for row in rows], dtype=bool)
    touching = phase.contacts.touching[int(last)]
    bounded[len(bounded) - len(touching) :] &= ~touching
    return bounded

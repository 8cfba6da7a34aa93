"""Conditions that cannot hold together, found before a solver is troubled."""

from __future__ import annotations

import casadi as ca
import numpy as np

from varint.control.phase import CheckedPhase
from varint.discrete.projection import velocity_gaps
from varint.errors import InputError

# constraints and bounds at given ends hold to this, relative to the size of the coordinates
HELD = 1e-9


def check_feasibility(phase: CheckedPhase, t0: float) -> None:
    """Given ends must lie within the bounds along the path and on the constraints."""
    s, bounds = phase.system, phase.bounds
    if phase.end.periodic is not None:
        _periodic(phase, phase.end.periodic)
    for what, end, t in (("start", phase.start, t0), ("end", phase.end, t0 + phase.duration[0])):
        for names, given, along in (
            (s.names, end.q, bounds.q),
            ([f"the velocity of {name}" for name in s.names], end.v, bounds.v),
            (phase.states.names(s), end.states, bounds.u[:, phase.states.index]),
        ):
            low, high = np.maximum(given[1], along[0]), np.minimum(given[2], along[1])
            for i in np.flatnonzero(low > high):
                asked = dict.fromkeys(f"{x:g}" for x in given[1:, i])
                raise InputError(
                    f"the {what} has {names[i]} = {' … '.join(asked)}, "
                    f"outside its bounds {along[0][i]:g} … {along[1][i]:g}"
                )
        if not (end.q[1] == end.q[2]).all() or not (
            s.structure.velocity_rows + bounds.at_points.numel()
        ):
            continue
        moving = what == "end" and phase.free_duration
        q, size = end.q[1], HELD * (1 + np.abs(end.q[1]).max())
        at = ca.Function("at", [s.q, s.t, s.c], [bounds.at_points, s.constraint])
        bounded, gap = (np.array(x) for x in at(q, t, phase.c))
        m = len(gap)
        free_c = len(phase.free_parameters) > 0
        if not moving and not free_c:
            _refuse_rows(what, bounded.ravel(), bounds, size)
            for i in np.flatnonzero(np.abs(gap.ravel()) > size):
                raise InputError(
                    f"the {what} violates constraint {i}: g = {gap.ravel()[i]:.3g} at q = "
                    f"{q.tolist()}"
                )
            if (end.v[1] == end.v[2]).all():
                hidden, W = velocity_gaps(s, q, end.v[1], t, phase.c)
                size = 1 + np.abs(W).max(initial=0.0) * np.abs(end.v[1]).max()
                for i in np.flatnonzero(np.abs(hidden) > HELD * size):
                    kind = f"constraint {i}: G v" if i < m else f"non-holonomic row {i - m}: A v"
                    raise InputError(
                        f"the {what} velocity violates {kind} = {hidden[i]:.3g}; it must be 0"
                    )


def _refuse_rows(what: str, bounded: np.ndarray, bounds, size: float) -> None:
    for i, value in enumerate(bounded):
        low, high = bounds.points_low[i], bounds.points_high[i]
        if value < low - size or value > high + size:
            raise InputError(
                f"at the {what} {bounds.at_points[i]} = {value:g}, outside its bounds {low:g} … "
                f"{high:g}"
            )


def _periodic(phase: CheckedPhase, offset: np.ndarray) -> None:
    start, end = phase.start.q, phase.end.q
    both = (start[1] == start[2]) & (end[1] == end[2]) & ~np.isnan(offset)
    for i in np.flatnonzero(both):
        raise InputError(
            f"{phase.system.names[i]} is given at both ends and periodic; leave it out (None) at "
            "one of them"
        )

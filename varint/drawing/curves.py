"""What is drawn as a line: a motion's nodes, and where they are few the motion between them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from varint.results.records import IMPACTS, changed

if TYPE_CHECKING:
    from varint.results.trajectory import Trajectory

SMOOTH = 400  # points that a line has at least
MARKED = 40  # nodes at most that are shown as dots on their line


def curve_of(motion: Trajectory) -> Trajectory:
    """The motion at its nodes and, where these make no smooth line, at times between them by dense
    output; at its nodes alone where a shorter step has no solution. Impacts have both of their
    sides, so that a line jumps where the motion does.
    """
    parts, t = _parts(motion), motion.t
    if parts == 1:
        return _with_jumps(motion, motion)
    within = t[:-1, None] + np.diff(t)[:, None] * (np.arange(parts) / parts)
    found = motion.at(np.append(within.ravel(), t[-1]))
    solved = np.isfinite(found.q).all() and np.isfinite(found.p).all()
    return _with_jumps(motion, found if solved else motion)


def marks_of(motion: Trajectory, t: np.ndarray) -> dict[str, Any]:
    """How a line through points at these times shows where the nodes are, while there are few."""
    if len(motion) > MARKED:
        return {}
    way = np.sign(motion.h)
    return dict(
        marker="o",
        markersize=3,
        markevery=(np.searchsorted(way * t, way * motion.t, side="right") - 1).tolist(),
    )


def _parts(motion: Trajectory) -> int:
    """Pieces of a line from one node to the next."""
    return -(-SMOOTH // max(len(motion) - 1, 1)) if len(motion) > 1 else 1


def _with_jumps(motion: Trajectory, curve: Trajectory) -> Trajectory:
    """The curve and, in front of the node behind each impact, the state before it; that after it
    as well where no node has it.
    """
    way, rows = np.sign(motion.h), []
    clock = way * curve.t
    for hit in motion.events:
        k = int(clock.searchsorted(way * hit.time))
        if hit.kind in IMPACTS and hit.q and 0 < k < len(clock):
            rows.append((k, hit.time, hit.q, hit.p_before))
            if curve.t[k] != hit.time:
                rows.append((k, hit.time, hit.q, hit.p_after))
    if not rows:
        return curve
    behind, t, q, p = (np.array(column) for column in zip(*rows, strict=True))
    sides = dict(t=t, q=q, p=p, k=curve.k[behind - 1])
    if curve.active_set is not None:
        sides["active_set"] = curve.active_set[behind - 1]
    merged = {x: np.insert(getattr(curve, x), behind, side, axis=0) for x, side in sides.items()}
    return changed(curve, **merged)

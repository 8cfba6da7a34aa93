"""What is drawn as a line: a motion's nodes, and where they are few the motion between them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from varint.results.trajectory import Trajectory

SMOOTH = 400  # points that a line has at least
MARKED = 40  # nodes at most that are shown as dots on their line


def curve_of(motion: Trajectory) -> Trajectory:
    """The motion at its nodes and, where these make no smooth line, at times between them by dense
    output; at its nodes alone where a shorter step has no solution.
    """
    parts, t = _parts(motion), motion.t
    if parts == 1:
        return motion
    within = t[:-1, None] + np.diff(t)[:, None] * (np.arange(parts) / parts)
    found = motion.at(np.append(within.ravel(), t[-1]))
    return found if np.isfinite(found.q).all() and np.isfinite(found.p).all() else motion


def marks_of(motion: Trajectory, curve: Trajectory) -> dict[str, Any]:
    """How its line shows where the nodes are, while there are few."""
    if curve is motion or len(motion) > MARKED:
        return {}
    return dict(marker="o", markersize=3, markevery=_parts(motion))


def _parts(motion: Trajectory) -> int:
    """Pieces of a line from one node to the next."""
    return -(-SMOOTH // max(len(motion) - 1, 1)) if len(motion) > 1 else 1

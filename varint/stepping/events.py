"""Zero crossings along a trajectory, located with the rule's own accuracy."""

from __future__ import annotations

import numpy as np

from varint.trajectory import Trajectory

LOCATED = 4 * np.finfo(float).eps  # relative to the larger of |t| and |h|
MOST_ITERATIONS = 200


def first_crossing(trajectory: Trajectory, expression) -> tuple[int, float] | None:
    """(i, t): the expression first crosses zero between nodes i and i + 1, at time t; None if it never does.

    A zero at the first node does not count; a zero at a later node does.
    """
    values = trajectory.value(expression)
    changes = np.flatnonzero((values[:-1] * values[1:] < 0) | ((values[1:] == 0) & (values[:-1] != 0)))
    if not len(changes):
        return None
    i = int(changes[0])
    if values[i + 1] == 0:
        return i, float(trajectory.t[i + 1])

    def at(t: float) -> float:
        return float(trajectory.at([t]).value(expression)[0])

    return i, _root(at, float(trajectory.t[i]), float(trajectory.t[i + 1]), float(values[i]), float(values[i + 1]))


def _root(f, a: float, b: float, fa: float, fb: float) -> float:
    """Root in [a, b] by the Illinois variant of the secant method: superlinear, and never outside."""
    tolerance = LOCATED * max(abs(a), abs(b), abs(b - a))
    for _ in range(MOST_ITERATIONS):
        c = b - fb * (b - a) / (fb - fa)
        if not min(a, b) < c < max(a, b):
            c = (a + b) / 2
        fc = f(c)
        if fc == 0 or abs(b - a) <= tolerance:
            return c
        if fc * fb < 0:
            a, fa = b, fb
        else:
            fa /= 2
        b, fb = c, fc
        if abs(b - a) <= tolerance:
            break
    return b

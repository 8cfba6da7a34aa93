"""Zero crossings along a trajectory, located with the rule's own accuracy."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from varint.errors import InputError
from varint.trajectory import Event, Trajectory

LOCATED = 4 * np.finfo(float).eps  # relative to the larger of |t| and |h|
MOST_ITERATIONS = 200


@dataclass(frozen=True, eq=False)
class Watch:
    """An expression whose zeros are wanted: those where it rises (+1), falls (−1), or both (0)."""

    name: str
    expression: Any
    direction: int


def watched(what: str, wanted: Any) -> Watch:
    """`expression` or `(expression, direction)` as the user gave it."""
    expression, direction = wanted if isinstance(wanted, tuple) and len(wanted) == 2 else (wanted, 0)
    if direction not in (-1, 0, 1):
        raise InputError(f"the direction of {what} must be +1 (rising), -1 (falling) or 0 (both), got {direction!r}")
    if not isinstance(expression, ca.SX) or expression.numel() != 1:
        raise InputError(f"{what} must be one SX expression, or (expression, direction), got {wanted!r}")
    return Watch(what, expression, direction)


def watched_events(events: Any) -> list[Watch]:
    """The expressions of `events`, a dictionary by name or None."""
    if events is None:
        return []
    if not isinstance(events, Mapping):
        raise InputError(f"events must be a dictionary of names and expressions, got {type(events).__name__}")
    return [watched(name, wanted) for name, wanted in events.items()]


def crossings(trajectory: Trajectory, watch: Watch) -> list[tuple[int, float]]:
    """(i, t) of each zero: between nodes i and i + 1, at time t.

    A zero at the first node does not count; a zero at a later node does. Two zeros between neighbouring nodes are not
    seen: they leave the sign as it was.
    """
    values = trajectory.value(watch.expression)
    before, after = values[:-1], values[1:]
    changes = (before * after < 0) | ((after == 0) & (before != 0))
    if watch.direction:
        changes &= np.sign(before) == -watch.direction

    def at(t: float) -> float:
        return float(trajectory.at([t]).value(watch.expression)[0])

    found = []
    for i in np.flatnonzero(changes):
        ends = float(trajectory.t[i]), float(trajectory.t[i + 1])
        t = ends[1] if after[i] == 0 else root(at, *ends, float(before[i]), float(after[i]))
        found.append((int(i), t))
    return found


def logged(trajectory: Trajectory, watch: Watch) -> list[Event]:
    """The zeros of a watched expression as records."""
    times = [t for _, t in crossings(trajectory, watch)]
    if not times:
        return []
    energies = trajectory.at(times).energy
    return [Event(t, watch.name, None, 0.0, float(e), float(e)) for t, e in zip(times, energies, strict=True)]


def root(f, a: float, b: float, fa: float, fb: float) -> float:
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

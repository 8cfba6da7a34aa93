"""Zero crossings along a trajectory, located with the rule's own accuracy."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import casadi as ca
import numpy as np

from varint.errors import InputError
from varint.expressions import in_own_symbols
from varint.trajectory import Event, Trajectory

LOCATED = 4 * np.finfo(float).eps  # relative to the larger of |t| and |h|
MOST_ITERATIONS = 200
NEAR_ZERO = 1e-2  # of the lower end: a cubic that comes so near to zero is looked at
TURNS = 8


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

    A zero at the first node does not count; a zero at a later node does. Two zeros between neighbouring nodes leave the
    sign as it was: they are seen by the slopes, which expressions of q and t alone have here.
    """
    values = trajectory.value(watch.expression)
    before, after = values[:-1], values[1:]
    changes = (before * after < 0) | ((after == 0) & (before != 0))

    def at(t: float) -> float:
        return float(trajectory.at([t]).value(watch.expression)[0])

    found = []
    dips = _dips(trajectory, watch.expression, values) & ~changes
    for i in np.flatnonzero(changes | dips):
        ends = [(float(trajectory.t[i + k]), float(values[i + k])) for k in (0, 1)]
        if dips[i]:
            turn = _turn(trajectory, watch.expression, int(i))
            ends = [ends[0], turn, ends[1]] if turn[1] * ends[0][1] < 0 else []
        for (a, fa), (b, fb) in pairwise(ends):
            if not watch.direction or np.sign(fa) == -watch.direction:
                found.append((int(i), b if fb == 0 else root(at, a, b, fa, fb)))
    return found


def _rate(trajectory: Trajectory, expression: ca.SX) -> ca.SX | None:
    """d/dt of an expression of q and t along the motion; None where it depends on velocities or controls."""
    s = trajectory.system
    expression = in_own_symbols(expression, s)
    if ca.depends_on(expression, ca.vertcat(s.v, s.control)):
        return None
    return ca.jtimes(expression, s.q, s.v) + ca.jacobian(expression, s.t)


def _dips(trajectory: Trajectory, expression: ca.SX, values: np.ndarray) -> np.ndarray:
    """Intervals with one sign at both ends, in which the cubic through values and slopes turns near or beyond zero."""
    rate = _rate(trajectory, expression)
    if rate is None:
        return np.zeros(len(values) - 1, dtype=bool)
    h, side = np.diff(trajectory.t), np.sign(values[:-1])
    slopes = trajectory.value(rate)
    a, b = side * values[:-1], side * values[1:]
    ra, rb = side * slopes[:-1] * h, side * slopes[1:] * h
    _, least = lowest(a, b, ra, rb)
    return (a > 0) & (b > 0) & (least < NEAR_ZERO * np.minimum(a, b))


def _turn(trajectory: Trajectory, expression: ca.SX, i: int) -> tuple[float, float]:
    """(t, value) where the expression turns between nodes i and i + 1, as soon as it is beyond zero."""
    rate = _rate(trajectory, expression)
    both = ca.vertcat(in_own_symbols(expression, trajectory.system), rate)
    a, b = float(trajectory.t[i]), float(trajectory.t[i + 1])
    (fa, ra), (fb, rb) = trajectory[i : i + 2].value(both)
    side = np.sign(fa)
    t, f = b, float(fb)
    for _ in range(TURNS):
        s, _ = lowest(*(np.array([side * x]) for x in (fa, fb, ra * (b - a), rb * (b - a))))
        t = a + float(s[0]) * (b - a)
        f, r = (float(x) for x in trajectory.at([t]).value(both)[0])
        if side * f < 0 or abs(b - a) <= LOCATED * max(abs(a), abs(b)):
            break
        if side * r * (b - a) < 0:
            a, fa, ra = t, f, r
        else:
            b, fb, rb = t, f, r
    return t, f


def lowest(a: np.ndarray, b: np.ndarray, ra: np.ndarray, rb: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Where in (0, 1) cubics with values a, b and slopes ra < 0 < rb are least, and how much; infinity for an end."""
    inner = (ra < 0) & (rb > 0)
    if not inner.any():
        return np.full(len(a), 0.5), np.full(len(a), np.inf)
    c3, c2 = 2 * (a - b) + ra + rb, 3 * (b - a) - 2 * ra - rb
    spread = np.sqrt(np.maximum(c2**2 - 3 * c3 * ra, 0))
    with np.errstate(divide="ignore", invalid="ignore"):
        s = np.where(c2 + spread != 0, -ra / (c2 + spread), 0.5)
    s = np.clip(np.nan_to_num(s, nan=0.5), 0, 1)
    return s, np.where(inner, a + s * (ra + s * (c2 + s * c3)), np.inf)


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

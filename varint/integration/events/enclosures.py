"""What an expression can be along a piece of the motion, from the states at its two ends.

Between them the motion is Hermite's cubic, up to what its own third derivative j says of the error:
cubics through values and slopes are off by max |q⁗| w⁴/384, their first and second derivatives by
√3/216 w³ and 1/12 w² (Birkhoff & Priver, J. Math. and Phys. 46 (1967)), and a step that resolves
the motion has w |q⁗| ≤ |j|.
"""

from __future__ import annotations

from typing import NamedTuple

import casadi as ca
import numpy as np

from varint.integration.events.intervals import WHOLE, ZERO, Interval, point
from varint.integration.events.jets import Jet, enclosures
from varint.numerics.arrays import over_columns
from varint.scene.memory import per_system
from varint.scene.system import System

PATH_ERROR, VELOCITY_ERROR, ACCELERATION_ERROR = 1 / 384, 3**0.5 / 216, 1 / 12
AT_ONCE = 8192  # coordinates of pieces whose boxes are made together: they stay in the cache
STILL = Interval(ca.SX(1.0), ca.SX(1.0))


class Pieces(NamedTuple):
    """Pieces of a motion: q and v at both ends (M, n), when they begin and how long they take."""

    q0: np.ndarray
    v0: np.ndarray
    q1: np.ndarray
    v1: np.ndarray
    t: np.ndarray
    w: np.ndarray


class Enclosure(NamedTuple):
    """Bounds along pieces, (M, m): of values, rates and curvatures of m expressions."""

    low: np.ndarray
    high: np.ndarray
    rate_low: np.ndarray
    rate_high: np.ndarray
    bend_low: np.ndarray
    bend_high: np.ndarray

    def negative(self) -> Enclosure:
        """Those of the expressions with the other sign."""
        low, high, rate_low, rate_high, bend_low, bend_high = self
        return Enclosure(-high, -low, -rate_high, -rate_low, -bend_high, -bend_low)


@per_system
def gap_enclosure_function(system: System) -> ca.Function:
    """`enclosure_function` of the gaps."""
    return enclosure_function(system, system.contact)


def enclosure_function(system: System, expression: ca.SX) -> ca.Function:
    """(q0, v0, q1, v1, t, w, controls and their rates: low, high, c) → an `Enclosure`.

    Expressions of the velocities have a curvature that the ends of a piece do not show.
    """
    s = system
    n, k = s.q.numel(), s.control.numel()
    q0, v0, q1, v1 = (ca.SX.sym(name, n) for name in ("q0", "v0", "q1", "v1"))
    t, w, u = ca.SX.sym("t"), ca.SX.sym("w"), ca.SX.sym("u", 4 * k)
    q, v = _paths(q0, v0, q1, v1, w)
    clock = Jet(Interval(ca.fmin(t, t + w), ca.fmax(t, t + w)), STILL, ZERO)
    jets = _jets(s, expression, q, v, clock, u)
    bounds = [
        ca.vertcat(*(ca.densify(getattr(jet[i], end)) for jet in jets))
        for i in range(3)
        for end in ("low", "high")
    ]
    return ca.Function(
        "enclosure", [q0, v0, q1, v1, t, w, u, s.c], [ca.densify(x) for x in bounds], {"cse": True}
    )


def box_function(system: System, expression: ca.SX) -> ca.Function:
    """(q, v, dv/dt, t: low and high; controls and their rates: low, high; c) → value and rate of an
    expression in such a box: low, high.
    """
    s = system
    n, k = s.q.numel(), s.control.numel()
    sides = [ca.SX.sym(name, n) for name in ("q0", "q1", "v0", "v1", "a0", "a1")]
    begin, end, u = ca.SX.sym("begin"), ca.SX.sym("end"), ca.SX.sym("u", 4 * k)
    q, v, a = (
        [Interval(*x) for x in zip(*map(ca.vertsplit, sides[i : i + 2]), strict=True)]
        for i in (0, 2, 4)
    )
    path = [Jet(x, y, z) for x, y, z in zip(q, v, a, strict=True)]
    speed = [Jet(y, z, WHOLE) for y, z in zip(v, a, strict=True)]
    clock = Jet(Interval(begin, end), STILL, ZERO)
    (jet,) = _jets(system, expression, path, speed, clock, u)
    bounds = [jet.value.low, jet.value.high, jet.rate.low, jet.rate.high]
    return ca.Function(
        "box",
        [*sides, begin, end, u, s.c],
        [ca.vertcat(*(ca.densify(x) for x in bounds))],
        {"cse": True},
    )


def _jets(
    system: System,
    expression: ca.SX,
    path: list[Jet],
    speed: list[Jet],
    clock: Jet,
    u: ca.SX,
) -> list[Jet]:
    """What an expression can be where coordinates, velocities, time and controls are in these
    intervals.
    """
    s, k = system, system.control.numel()
    controls = [
        Jet(Interval(u[i], u[k + i]), Interval(u[2 * k + i], u[3 * k + i]), WHOLE) for i in range(k)
    ]
    constants = [Jet(point(x), ZERO, ZERO) for x in ca.vertsplit(s.c)]
    value = ca.Function("value", [s.q, s.v, s.t, s.control, s.c], [ca.densify(expression)])
    return enclosures(value, [path, speed, [clock], controls, constants])


def _paths(q0: ca.SX, v0: ca.SX, q1: ca.SX, v1: ca.SX, w: ca.SX) -> tuple[list[Jet], list[Jet]]:
    """Jets of coordinates and of velocities along the cubics: hulls of their Bernstein points."""
    size, middle = ca.fabs(w), 3 * (q1 - q0) / w - v0 - v1
    third = ca.fabs(12 * (q0 - q1) + 6 * w * (v0 + v1))
    positions = _hulls([q0, q0 + w * v0 / 3, q1 - w * v1 / 3, q1], PATH_ERROR * third)
    velocities = _hulls([v0, middle, v1], VELOCITY_ERROR * third / size)
    bends = [2 * (middle - v0) / w, 2 * (v1 - middle) / w]
    accelerations = _hulls(bends, ACCELERATION_ERROR * third / size**2)
    q = [Jet(*x) for x in zip(positions, velocities, accelerations, strict=True)]
    return q, [Jet(*x, WHOLE) for x in zip(velocities, accelerations, strict=True)]


def _hulls(points: list[ca.SX], error: ca.SX) -> list[Interval]:
    low = high = points[0]
    for x in points[1:]:
        low, high = ca.fmin(low, x), ca.fmax(high, x)
    return [
        Interval(a, b)
        for a, b in zip(ca.vertsplit(low - error), ca.vertsplit(high + error), strict=True)
    ]


def enclosure(
    function: ca.Function, pieces: Pieces, controls: np.ndarray, c: np.ndarray
) -> Enclosure:
    """The bounds along every piece; `controls` as `enclosure_function` wants them."""
    *ends, t, w = pieces
    return Enclosure(*over_columns(function, *ends, t[:, None], w[:, None], controls, c))


@per_system
def gap_floor_function(system: System) -> ca.Function:
    """(q: low, high, t: low, high, c) → lower bounds of the gaps in such a box."""
    s, n = system, system.q.numel()
    low, high = ca.SX.sym("low", n), ca.SX.sym("high", n)
    begin, end = ca.SX.sym("begin"), ca.SX.sym("end")
    sides = zip(ca.vertsplit(low), ca.vertsplit(high), strict=True)
    coordinates = [Jet(Interval(*side), ZERO, ZERO) for side in sides]
    clock = Jet(Interval(begin, end), ZERO, ZERO)
    constants = [Jet(point(x), ZERO, ZERO) for x in ca.vertsplit(s.c)]
    gaps = ca.Function("gaps", [s.q, s.t, s.c], [ca.densify(s.contact)])
    floors = [
        ca.densify(jet.value.low) for jet in enclosures(gaps, [coordinates, [clock], constants])
    ]
    return ca.Function("floors", [low, high, begin, end, s.c], [ca.vertcat(*floors)], {"cse": True})


class Box(NamedTuple):
    """Least and largest coordinates, velocities, accelerations (M, n) and times (M, 1) of some
    pieces each.
    """

    q_low: np.ndarray
    q_high: np.ndarray
    v_low: np.ndarray
    v_high: np.ndarray
    a_low: np.ndarray
    a_high: np.ndarray
    t_low: np.ndarray
    t_high: np.ndarray


def grouped(low: np.ndarray, size: int) -> np.ndarray:
    """The least of every `size` numbers along the last axis, (…, M) → (…, ⌈M / size⌉)."""
    if size == 1:
        return low
    whole = low.shape[-1] // size * size
    least = low[..., 0:whole:size].copy()
    for i in range(1, size):  # NumPy takes forty times as long for minima of ten numbers each
        np.minimum(least, low[..., i:whole:size], out=least)
    if whole == low.shape[-1]:
        return least
    return np.concatenate([least, low[..., whole:].min(axis=-1, keepdims=True)], axis=-1)


def boxes_around(pieces: Pieces, size: int) -> Box:
    """The boxes around every `size` pieces, of the cubics and their errors."""
    some = size * max(AT_ONCE // (size * pieces.q0.shape[1]), 1)
    parts = range(0, len(pieces.t), some)
    found = [_boxes_around(Pieces(*(x[i : i + some] for x in pieces)), size) for i in parts]
    return Box(*(np.concatenate(x, axis=1).T for x in zip(*found, strict=True)))


def _boxes_around(pieces: Pieces, size: int) -> Box:
    """Of few pieces, and every array (n, M): NumPy is fast along long axes in the cache."""
    q0, v0, q1, v1 = (np.ascontiguousarray(x.T) for x in pieces[:4])
    t, w = pieces.t, pieces.w
    middle = 3 * (q1 - q0) / w - v0 - v1
    third = np.abs(12 * (q0 - q1) + 6 * w * (v0 + v1))
    bends = 2 * (middle - v0) / w, 2 * (v1 - middle) / w
    points = (
        ((q0, q0 + w * v0 / 3, q1 - w * v1 / 3, q1), PATH_ERROR * third),
        ((v0, middle, v1), VELOCITY_ERROR / np.abs(w) * third),
        (bends, ACCELERATION_ERROR / w**2 * third),
        ((t[None], (t + w)[None]), 0.0),
    )
    sides = []
    for those, error in points:
        low = high = those[0]
        for x in those[1:]:
            low, high = np.minimum(low, x), np.maximum(high, x)
        sides += [grouped(low - error, size), -grouped(-high - error, size)]
    return Box(*sides)


def boxes(pieces: Pieces) -> tuple[np.ndarray, ...]:
    """Least and largest coordinates and times of every piece: (M, n), (M, n), (M,), (M,)."""
    q0, v0, q1, v1, t, w = pieces
    w = w[:, None]
    points = np.stack([q0, q0 + w * v0 / 3, q1 - w * v1 / 3, q1])
    error = PATH_ERROR * np.abs(12 * (q0 - q1) + 6 * w * (v0 + v1))
    times = t, t + w[:, 0]
    return points.min(0) - error, points.max(0) + error, np.minimum(*times), np.maximum(*times)


def lower_bound(ends: tuple[np.ndarray, ...], w: np.ndarray, e: Enclosure) -> np.ndarray:
    """A number that an expression is not less than between the ends of a piece.

    The best of three: the enclosure's own; the least value on the cones of all rates from both
    ends; and, where the rates at the ends are known, that on the parabolas of least curvature C:
    f(s) − C s²/2 is convex, so it lies above its tangents at both ends.

    Parameters
    ----------
    ends : arrays a, b, and rates there or NaN
    w : array
        Durations.
    e : Enclosure
    """
    a, b, ra, rb = ends
    slopes = e.rate_low * w, e.rate_high * w
    cone = _on_cones(a, b, np.minimum(*slopes), np.maximum(*slopes))
    parabola = _on_parabolas(a, b, ra * w, rb * w, e.bend_low * w**2)
    return np.fmax(np.fmax(e.low, cone), parabola)


def _on_cones(a: np.ndarray, b: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Least value in [0, 1] of f with f(0) = a, f(1) = b and low ≤ f' ≤ high."""
    with np.errstate(all="ignore"):
        s = np.clip((b - high - a) / (low - high), 0, 1)
        return np.where(low >= 0, a, np.where(high <= 0, b, a + low * s))


def _on_parabolas(
    a: np.ndarray, b: np.ndarray, ra: np.ndarray, rb: np.ndarray, bend: np.ndarray
) -> np.ndarray:
    """Least value in [0, 1] of f with these values and slopes at the ends and f'' ≥ bend.

    f − bend s²/2 is convex, so above its tangents at both ends; s is where they meet.
    """
    with np.errstate(all="ignore"):
        s = (b + bend / 2 - rb - a) / (ra - rb + bend)
        s = np.clip(np.nan_to_num(s, nan=0.5), 0, 1)
        left = _lowest(a, ra, bend, s)
        right = _lowest(b, -rb, bend, 1 - s)
        return np.minimum(left, right)


def _lowest(value: np.ndarray, slope: np.ndarray, bend: np.ndarray, far: np.ndarray) -> np.ndarray:
    """Least value in [0, far] of value + slope s + bend s²/2."""
    turn = np.where(bend > 0, np.clip(-slope / bend, 0, far), far)
    return np.minimum(value, value + turn * (slope + turn * bend / 2))

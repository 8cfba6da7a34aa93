"""Zeros in brackets: of one function, or of an expression in many pieces of a motion at once."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from varint.numerics.limits import ROOT_ITERATIONS

LOCATED = 4 * np.finfo(float).eps  # relative to the larger of |t| and |h|
SECANTS = 8  # iterations after which a zero is no simple one: bisect
STRAIGHT = np.finfo(float).eps  # of a piece's width squared: what bends less is a straight line
GUESSES = 6  # Newton's iterations for the cubic that starts the search
POLE = 1e3  # what grows by this factor where it changes its sign has a pole there


class Points(NamedTuple):
    """Instants of the motion within intervals between nodes, arrays over them: the interval's first
    node, time, q, v, p, and value and rate of an expression.
    """

    node: np.ndarray
    t: np.ndarray
    q: np.ndarray
    v: np.ndarray
    p: np.ndarray
    value: np.ndarray
    rate: np.ndarray

    def at(self, which: Any) -> Points:
        """Some of them."""
        return Points(*(a[which] for a in self))


def join_points(*points: Points) -> Points:
    """All of them, one after the other."""
    return Points(*(np.concatenate(a) for a in zip(*points, strict=True)))


def find_root(f: Callable[[float], float], a: float, b: float, fa: float, fb: float) -> float:
    """Root in [a, b] by the Illinois variant of the secant method: superlinear, and never
    outside.
    """
    tolerance = LOCATED * max(abs(a), abs(b), abs(b - a))
    for _ in range(ROOT_ITERATIONS):
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


THIRDS = np.linalg.inv(np.vander([0, 1 / 3, 2 / 3, 1], increasing=True))


def locate_roots(
    left: Points,
    right: Points,
    near: Callable[[np.ndarray], Points],
    instants: Callable[[np.ndarray, np.ndarray], Points],
    moved: Callable[[np.ndarray, Points, np.ndarray], tuple[Points, np.ndarray]],
) -> tuple[Points, np.ndarray]:
    """The zero in each piece of a motion whose ends have values of different sign, and which of
    them are zeros: a pole is none.

    It starts at the zero along the motion that the states around tell, goes on by rates, or by
    secants where they are not known, and bisects what does not follow them. Where the zero is so
    near to an instant that the states around tell the way from there up to round-off, or so near to
    two that the motion between is a straight line, it is found on that way.

    Parameters
    ----------
    left, right : Points (M,)
        Ends of the pieces.
    near : callable
        Times (M,) → about the motion there.
    instants : callable
        (nodes, times) → the motion there.
    moved : callable
        (which pieces, instants in them, times) → the motion at these times from the instants, and
        where it is known up to round-off.
    """
    a, b, fa, fb = (x.copy() for x in (left.t, right.t, left.value, right.value))
    largest = np.maximum(np.abs(fa), np.abs(fb))
    tolerance = LOCATED * np.maximum(np.maximum(np.abs(a), np.abs(b)), np.abs(b - a))
    found, active = Points(*(x.copy() for x in right)), np.arange(len(a))
    t, slope = _guesses(left, right, near)
    width, last = np.abs(b - a), None
    for i in range(ROOT_ITERATIONS):
        if not len(active):
            break
        there = instants(left.node[active], t)
        f = there.value
        for kept, new in zip(found, there, strict=True):
            kept[active] = new
        same = f * fa[active] > 0
        a[active], fa[active] = np.where(same, t, a[active]), np.where(same, f, fa[active])
        b[active], fb[active] = np.where(same, b[active], t), np.where(same, fb[active], f)
        with np.errstate(all="ignore"):
            if last is not None:
                slope = (f - last.value) / (t - last.t)
                on_secant = t - f / slope  # velocities of low orders are not slopes of a sub-step
            slope = np.where(np.isfinite(there.rate), there.rate, slope)
            ahead = t - f / slope
        inside = (ahead - a[active]) * (b[active] - ahead) > 0
        close = tolerance[active]
        done = (f == 0) | (np.abs(b[active] - a[active]) <= close)
        done |= (np.abs(ahead - t) <= close) & (i < SECANTS)
        on_line = inside & ~done & (i < SECANTS)
        if last is None:
            some = np.flatnonzero(on_line)
            ahead_of, known = moved(some, there.at(some), ahead[some])
            for kept, new in zip(found, ahead_of, strict=True):
                kept[some[known]] = new[known]
            done[some] |= known
        else:
            on_line &= np.abs((ahead - t) * (ahead - last.t)) <= STRAIGHT * width[active] ** 2
            _move_along(found, active, there, last, on_secant, on_line)
            done |= on_line
        last = there.at(~done)
        middle = (a[active] + b[active]) / 2
        t = np.where(inside & (i < SECANTS), ahead, middle)[~done]
        slope, active = slope[~done], active[~done]
    narrow = np.abs(b - a) <= tolerance
    pole = narrow & (np.minimum(np.abs(fa), np.abs(fb)) > POLE * largest) & (found.value != 0)
    return found, ~pole


def _move_along(
    found: Points,
    active: np.ndarray,
    there: Points,
    last: Points,
    ahead: np.ndarray,
    which: np.ndarray,
) -> None:
    """Put in place what the lines through two instants each say of later times."""
    at = active[which]
    found.t[at] = ahead[which]
    part = ((ahead - there.t)[which] / (there.t - last.t)[which])[:, None]
    for name in ("q", "v", "p"):
        x, y = getattr(there, name)[which], getattr(last, name)[which]
        getattr(found, name)[at] = x + part * (x - y)


def _guesses(
    left: Points, right: Points, near: Callable[[np.ndarray], Points]
) -> tuple[np.ndarray, np.ndarray]:
    """Where the zeros are along about the motion, and the slopes there: those of cubics, polished
    twice.
    """
    a, w = left.t, right.t - left.t
    third = (20 * left.value + 7 * right.value + w * (4 * left.rate - 2 * right.rate)) / 27
    two_thirds = (7 * left.value + 20 * right.value + w * (2 * left.rate - 4 * right.rate)) / 27
    if not np.isfinite(third + two_thirds).all():
        third, two_thirds = (near(a + s * w).value for s in (1 / 3, 2 / 3))
    values = np.stack([left.value, third, two_thirds, right.value], axis=1)
    s, slope = _zeros_of_cubics(values)
    s = np.where((s > 0) & (s < 1), s, 0.5)  # no number near a pole
    t, slope = a + s * w, slope / w
    for _ in range(2):
        there = near(t)
        with np.errstate(all="ignore"):
            slope = np.where(np.isfinite(there.rate), there.rate, slope)
            ahead = t - there.value / slope
        t = np.where((ahead - a) * (right.t - ahead) > 0, ahead, t)
    return t, slope


def _zeros_of_cubics(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Zero in [0, 1] of each cubic with values (M, 4) at 0, 1/3, 2/3 and 1, and the slope there."""
    low, high = np.zeros(len(values)), np.ones(len(values))
    with np.errstate(all="ignore"):
        c = values @ THIRDS.T
        s = values[:, 0] / (values[:, 0] - values[:, 3])
        for _ in range(GUESSES):
            f = c[:, 0] + s * (c[:, 1] + s * (c[:, 2] + s * c[:, 3]))
            slope = c[:, 1] + s * (2 * c[:, 2] + s * 3 * c[:, 3])
            before = f * values[:, 0] > 0
            low, high = np.where(before, s, low), np.where(before, high, s)
            ahead = s - f / slope
            s = np.where((ahead >= low) & (ahead <= high), ahead, (low + high) / 2)
    return s, slope

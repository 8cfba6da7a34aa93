"""Interval arithmetic as expressions (Moore, Kearfott & Cloud, Introduction to Interval Analysis,
2009, §§2 and 5).

Bounds are not rounded outwards: who compares them with zero allows for round-off.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import casadi as ca

# Stands for infinity: squares of it and sums of those are numbers, so bounds never become NaN,
# which minima and maxima would forget.
HUGE = 1e150


class Interval(NamedTuple):
    """low ≤ x ≤ high; `wild` where bounds may be as large as `HUGE`."""

    low: ca.SX
    high: ca.SX
    wild: bool = False


def point(x: ca.SX | float) -> Interval:
    """The interval of one number."""
    x = ca.SX(x)
    return Interval(x, x)


ZERO, ONE = point(0.0), point(1.0)
WHOLE = Interval(ca.SX(-HUGE), ca.SX(HUGE), True)


def is_point(a: Interval) -> bool:
    """Whether both ends are the same expression."""
    return a.low is a.high


def is_number(a: Interval, number: float) -> bool:
    return is_point(a) and a.low.is_constant() and float(a.low) == number


def finite_interval(low: ca.SX, high: ca.SX) -> Interval:
    """The interval, infinite ends cut."""
    return Interval(ca.fmax(low, -HUGE), ca.fmin(high, HUGE), True)


def where(condition: ca.SX, a: Interval, b: Interval) -> Interval:
    """a where the condition holds, else b."""
    low, high = ca.if_else(condition, a.low, b.low), ca.if_else(condition, a.high, b.high)
    return Interval(low, high, a.wild or b.wild)


def hull(a: Interval, b: Interval) -> Interval:
    """The least interval that holds both."""
    return Interval(ca.fmin(a.low, b.low), ca.fmax(a.high, b.high), a.wild or b.wild)


def negative(a: Interval) -> Interval:
    if is_point(a):
        return point(-a.low)
    return Interval(-a.high, -a.low, a.wild)


def plus(a: Interval, b: Interval) -> Interval:
    if is_point(a) and is_point(b):
        return point(a.low + b.low)
    return Interval(a.low + b.low, a.high + b.high, a.wild or b.wild)


def times(a: Interval, b: Interval) -> Interval:
    if is_number(a, 0.0) or is_number(b, 0.0):
        return ZERO
    if a is b:
        return square(a)
    if is_point(a):
        if is_point(b):
            return point(a.low * b.low)
        ends = a.low * b.low, a.low * b.high
        if a.low.is_constant():
            low, high = ends if float(a.low) > 0 else ends[::-1]
        else:
            low, high = ca.fmin(*ends), ca.fmax(*ends)
    elif is_point(b):
        return times(b, a)
    else:
        one, other = (a.low * b.low, a.high * b.low), (a.low * b.high, a.high * b.high)
        low = ca.fmin(ca.fmin(*one), ca.fmin(*other))
        high = ca.fmax(ca.fmax(*one), ca.fmax(*other))
    return finite_interval(low, high) if a.wild or b.wild else Interval(low, high)


def sizes(a: Interval) -> tuple[ca.SX, ca.SX]:
    """Least and largest |x|."""
    return ca.fmax(ca.fmax(a.low, -a.high), 0), ca.fmax(a.high, -a.low)


def square(a: Interval) -> Interval:
    if is_point(a):
        return point(a.low**2)
    least, largest = sizes(a)
    return finite_interval(least**2, largest**2) if a.wild else Interval(least**2, largest**2)


def inverse(a: Interval) -> Interval:
    """1/x; anything where x may be zero."""
    if is_point(a) and a.low.is_constant() and float(a.low) != 0:
        return point(1 / a.low)
    apart = ca.logic_or(a.low > 0, a.high < 0)
    return where(apart, finite_interval(1 / a.high, 1 / a.low), WHOLE)


def inverse_of_positive(a: Interval) -> Interval:
    """1/x of an x > 0, however near to zero."""
    return finite_interval(1 / a.high, ca.if_else(a.low > 0, 1 / a.low, HUGE))


def increasing(f: Callable[[ca.SX], ca.SX]) -> Callable[[Interval], Interval]:
    """The range of a function that grows."""

    def ranges(a: Interval) -> Interval:
        return point(f(a.low)) if is_point(a) else Interval(f(a.low), f(a.high), a.wild)

    return ranges


def root(a: Interval) -> Interval:
    return increasing(lambda x: ca.sqrt(ca.fmax(x, 0)))(a)


def exponential(a: Interval) -> Interval:
    return finite_interval(ca.exp(a.low), ca.exp(a.high))


def sine(a: Interval, ahead: float = 0.0) -> Interval:
    """sin(x + ahead)."""
    low, high = a.low + ahead, a.high + ahead
    if is_point(a):
        return point(ca.sin(low))

    def passes(angle: float) -> ca.SX:
        turn = 2 * math.pi
        return ca.floor((high - angle) / turn) > ca.floor((low - angle) / turn)

    ends = ca.sin(low), ca.sin(high)
    return Interval(
        ca.if_else(passes(-math.pi / 2), -1, ca.fmin(*ends)),
        ca.if_else(passes(math.pi / 2), 1, ca.fmax(*ends)),
    )

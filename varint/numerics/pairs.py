"""Matrices in pairs of numbers, whose sum has twice the digits of one, and products of them by
libraries for single ones.

A factor is cut into slices of so few bits that every product of two slices is exact, whatever the
order in which it is summed up (Ozaki, Ogita, Oishi & Rump, Numerical Algorithms 59 (2012) 95).
"""

from __future__ import annotations

from fractions import Fraction
from typing import Any, NamedTuple

import numpy as np

BITS = 22  # of a slice: sums of 257 products are exact
SLICES = 5
# of the largest of a row times the largest of a column, and a number of a row: what a product
# leaves out, or rounds
LEFT_OUT = 2.0**-94
# multiplications in a product: of larger ones libraries make threads, which wait for each other a
# hundred times as long where other processes run
AT_ONCE = 150_000
REFINED = 2  # times that a solution is mended, each of which gives as many digits as one number has


class Pair(NamedTuple):
    """high + low, arrays of one shape, of which low is no more than high's last digit."""

    high: np.ndarray
    low: np.ndarray

    @property
    def T(self) -> Pair:
        """The transposed."""
        return Pair(self.high.T, self.low.T)


def pair_of(rows: list[list[Fraction]]) -> Pair:
    """A matrix of exact numbers."""
    high = [[float(x) for x in row] for row in rows]
    low = [
        [0.0 if x == y else float(x - Fraction(y)) for x, y in zip(row, rounded, strict=True)]
        for row, rounded in zip(rows, high, strict=True)
    ]
    return Pair(np.array(high), np.array(low))


def single(x: np.ndarray) -> Pair:
    """Numbers as they are."""
    return Pair(x, np.zeros_like(x))


def scaled(x: Pair, by: float | np.ndarray) -> Pair:
    """x by powers of two, or signs, which round nothing."""
    return Pair(x.high * by, x.low * by)


def part(x: Pair, index: Any) -> Pair:
    """x[index]."""
    return Pair(x.high[index], x.low[index])


def total(x: Pair, y: Pair) -> Pair:
    """x + y."""
    high, low = _sum(x.high, y.high)
    return Pair(*_sum(high, low + (x.low + y.low)))


def block(rows: list[list[Pair]]) -> Pair:
    """A matrix of matrices."""
    return Pair(*(np.block([[x[i] for x in row] for row in rows]) for i in (0, 1)))


def product(x: Pair, y: Pair) -> Pair:
    """x y, (a, b) by (b, c), b ≤ 257, but for `LEFT_OUT`."""
    left, right = _slices(x, 1), _slices(y, 0)
    sums = [
        [matmul(left[i], right[order - i]) for i in range(order + 1)] for order in range(SLICES)
    ]
    small = sum([*sums[3], *sums[4]], start=np.zeros(1))
    found = total(single(sums[0][0]), Pair(*_sum(*sums[1])))
    return total(found, Pair(*_sum(sum(sums[2], start=np.zeros(1)), small)))


def matmul(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """x y, some rows after the other."""
    rows = max(1, AT_ONCE // max(y.size, 1))
    if len(x) <= rows:
        return x @ y
    return np.concatenate([x[k : k + rows] @ y for k in range(0, len(x), rows)])


def solved(a: Pair, b: Pair) -> Pair:
    """a⁻¹ b; raises LinAlgError where a has no inverse."""
    inverse = np.linalg.inv(a.high)
    found = single(matmul(inverse, b.high))
    for _ in range(REFINED):
        left = total(b, scaled(product(a, found), -1.0))
        found = total(found, single(matmul(inverse, left.high)))
    return found


def _sum(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """x + y and what that rounds (Knuth)."""
    high = x + y
    other = high - x
    return high, (x - (high - other)) + (y - other)


def _slices(x: Pair, axis: int) -> list[np.ndarray]:
    """Numbers of so few bits each, multiples of one unit along the axis, whose sum is x."""
    (high, low), found = x, []
    exponent = np.frexp(np.abs(high).max(axis=axis, keepdims=True))[1]
    for k in range(1, SLICES + 1):
        rounds = np.ldexp(1.5, exponent + (52 - BITS * k))
        part = (high + rounds) - rounds
        found.append(part)
        high, low = _sum(high - part, low)
    return found

"""Steps of linear equations x' = A x + b as one map, and its powers."""

from __future__ import annotations

from collections.abc import Sequence
from math import factorial

import numpy as np

from varint.numerics.pairs import (
    AT_ONCE,
    Pair,
    matmul,
    part,
    product,
    scaled,
    single,
    solved,
    total,
)

TOGETHER = 64  # steps whose maps are known before all of them are taken at once


def gauss_change(a: np.ndarray, stages: int) -> np.ndarray:
    """R(A) − 1 of a step by Gauss collocation with so many stages, (d, d): R is the diagonal Padé
    approximant of exp, P(A)/P(−A) (Hairer & Wanner, Solving Ordinary Differential Equations II,
    IV.3), of whose odd terms twice the sum is P(A) − P(−A).
    """
    even, odd = np.eye(len(a)), np.zeros_like(a)
    power, factor = np.eye(len(a)), 1.0
    for k in range(1, stages + 1):
        factor *= (stages - k + 1) / (k * (2 * stages - k + 1))
        power = power @ a
        if k % 2:
            odd += factor * power
        else:
            even += factor * power
    return np.linalg.solve(even - odd, 2 * odd)


def orbit(change: np.ndarray, x: np.ndarray, steps: int) -> np.ndarray:
    """x, R x, R² x, …, (steps + 1, d) for R − 1 = `change`: a block of steps at once by the powers
    of R, and its ends in the same way.
    """
    powers = _powers(change, min(steps, TOGETHER))
    each = len(powers)
    ends = orbit(powers[-1], x, steps // each) if steps > each else x[None]
    found = np.empty((len(ends), each + 1, len(x)))
    found[:, 0] = ends
    flat = powers.reshape(-1, len(x)).T
    count = max(1, AT_ONCE // flat.size)
    for k in range(0, len(ends), count):
        some = ends[k : k + count]
        found[k : k + count, 1:] = some[:, None] + (some @ flat).reshape(-1, each, len(x))
    return np.concatenate((x[None], found[:, 1:].reshape(-1, len(x))))[: steps + 1]


def _powers(change: np.ndarray, count: int) -> np.ndarray:
    """R − 1, R² − 1, … Rᵏ − 1, (count, d, d)."""
    found = change[None]
    while len(found) < count:
        last = found[-1]
        found = np.concatenate((found, last + found + found @ last))
    return found[:count]


def exact_gauss_change(a: Pair, stages: int) -> Pair:
    """`gauss_change` with twice the digits, of an A whose norm is about one or less. By whole
    numbers, P(A) = Σ (2s − k)!/(k! (s − k)!) Aᵏ.
    """
    s, one = stages, np.eye(len(a.high))
    parts = [factorial(2 * s - k) // (factorial(k) * factorial(s - k)) for k in range(s + 1)]
    square = product(a, a)
    even, odd = (_polynomial(parts[k::2], square, one) for k in (0, 1))
    odd = product(a, odd)
    return solved(total(even, scaled(odd, -1.0)), scaled(odd, 2.0))


def _polynomial(parts: list[int], x: Pair, one: np.ndarray) -> Pair:
    """Σ parts_k xᵏ."""
    found = single(parts[-1] * one)
    for number in reversed(parts[:-1]):
        found = total(product(found, x), single(number * one))
    return found


def squared(change: Pair) -> Pair:
    """R² − 1 = 2 (R − 1) + (R − 1)²."""
    return total(scaled(change, 2.0), product(change, change))


def spread(changes: Sequence[Pair], x: np.ndarray) -> np.ndarray:
    """x, R x, R² x, …, (2ᵐ, d), for the changes R − 1, R² − 1, R⁴ − 1, … of m powers: each state
    by as many of them as its number has digits, the largest first.
    """
    found = x[None]
    for change in reversed(changes):
        moved = found + matmul(found, change.high.T)
        found = np.stack((found, moved), axis=1).reshape(-1, len(x))
    return found


def moved(changes: Sequence[Pair], x: np.ndarray, steps: np.ndarray) -> np.ndarray:
    """Rᵏ x for as many states (N, d) and numbers of steps k (N,), in the same way."""
    found = x.copy()
    for j, change in reversed([*enumerate(changes)]):
        some = np.flatnonzero(steps >> j & 1)
        found[some] += matmul(found[some], change.high.T)
    return found


def exactly_moved(changes: Sequence[Pair], x: np.ndarray, steps: np.ndarray) -> np.ndarray:
    """`moved` with twice the digits, rounded once."""
    found = single(x.copy())
    for j, change in reversed([*enumerate(changes)]):
        some = np.flatnonzero(steps >> j & 1)
        begin = part(found, some)
        end = total(begin, product(begin, change.T))
        found.high[some], found.low[some] = end
    return found.high

"""Steps of linear equations x' = A x + b as one map, and its powers."""

from __future__ import annotations

import numpy as np

TOGETHER = 64  # steps whose maps are known before all of them are taken at once
# multiplications in a product: of larger ones libraries make threads, which wait for each other a
# hundred times as long where other processes run
AT_ONCE = 150_000


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

"""Arithmetic modulo a prime m ≡ 3 (mod 4), over many columns at once, and in its extension by
i² = −1.

A `Residue` is a + b i with arrays a and b of integers below m < 2³¹; b is None where it is zero.
Products fit 64 bits. No rounding: what is zero here is zero.
"""

from __future__ import annotations

from fractions import Fraction
from typing import NamedTuple

import numpy as np

DIGITS = 12  # of a constant: what is within its rounding error of so few is meant to be that
ROUNDED = 4  # units in the last place
LARGEST_DENOMINATOR = 1000
LARGEST_RECONSTRUCTED = 10_000  # numerators and denominators; m is beyond twice its square


class Residue(NamedTuple):
    """a + b i modulo a prime."""

    a: np.ndarray
    b: np.ndarray | None = None


def add(x: Residue, y: Residue, m: int) -> Residue:
    """x + y."""
    if x.b is None or y.b is None:
        return Residue((x.a + y.a) % m, y.b if x.b is None else x.b)
    return Residue((x.a + y.a) % m, (x.b + y.b) % m)


def negative(x: Residue, m: int) -> Residue:
    """−x."""
    return Residue(-x.a % m, None if x.b is None else -x.b % m)


def times(x: Residue, y: Residue, m: int) -> Residue:
    """x y."""
    if x.b is None and y.b is None:
        return Residue(x.a * y.a % m)
    if x.b is None or y.b is None:
        real, other = (x, y) if x.b is None else (y, x)
        return Residue(real.a * other.a % m, real.a * other.b % m)
    return Residue((x.a * y.a + (m - x.b) * y.b) % m, (x.a * y.b + x.b * y.a) % m)


def inverse(x: Residue, m: int) -> Residue:
    """1/x; 0 for 0."""
    if x.b is None:
        return Residue(power_modulo(x.a, m - 2, m))
    norm = power_modulo((x.a * x.a + x.b * x.b) % m, m - 2, m)
    return Residue(x.a * norm % m, -x.b % m * norm % m)


def power_modulo(base: np.ndarray, exponent: np.ndarray | int, m: int) -> np.ndarray:
    """base^exponent for whole exponents that are not negative."""
    power, square = np.ones_like(base), base
    exponent = np.asarray(exponent, dtype=np.int64)
    while exponent.any():
        power = np.where(exponent % 2 == 1, power * square % m, power)
        square, exponent = square * square % m, exponent // 2
    return power


def is_square(x: np.ndarray, m: int) -> np.ndarray:
    """Whether x ≠ 0 has a root without i (Euler's criterion)."""
    return power_modulo(x, (m - 1) // 2, m) == 1


def signs(x: Residue, m: int) -> np.ndarray:
    """1 for squares, −1 for others (Legendre's symbol, so that signs multiply), 0 for 0; with i,
    opposite ones for x and −x.
    """
    if x.b is None:
        return power_modulo(x.a, (m - 1) // 2, m)
    leading = np.where(x.a == 0, x.b, x.a)
    return np.where(is_zero(x), 0, np.where(leading <= m // 2, 1, m - 1))


def is_zero(x: Residue) -> np.ndarray:
    """Whether a + b i = 0."""
    return x.a == 0 if x.b is None else (x.a == 0) & (x.b == 0)


def rational(x: float) -> tuple[Fraction, bool]:
    """The number that a floating-point constant is meant to be, and whether that is clear: a
    decimal of few digits or a simple fraction within its rounding error. Otherwise as it is
    written.
    """
    short = f"{x:.{DIGITS}g}"
    if abs(float(short) - x) <= ROUNDED * np.spacing(abs(x)):
        return Fraction(short), True
    simple = Fraction(x).limit_denominator(LARGEST_DENOMINATOR)
    meant = abs(float(simple) - x) <= ROUNDED * np.spacing(abs(x))
    return (simple if meant else Fraction(repr(x))), meant


def residue(x: Fraction, m: int) -> int:
    """x modulo m."""
    return x.numerator * pow(x.denominator, -1, m) % m


def reconstruct(x: int, m: int) -> Fraction | None:
    """The simple fraction that is x modulo m (Wang 1981), or None."""
    (r0, s0), (r1, s1) = (m, 0), (x, 1)
    while r1 > LARGEST_RECONSTRUCTED:
        quotient = r0 // r1
        (r0, s0), (r1, s1) = (r1, s1), (r0 - quotient * r1, s0 - quotient * s1)
    return Fraction(r1, s1) if 0 < abs(s1) <= LARGEST_RECONSTRUCTED else None


def null_space(rows: np.ndarray, m: int) -> tuple[np.ndarray, list[int]]:
    """Null space of a matrix modulo m as columns in reduced form, and their free columns."""
    rows = rows.copy() % m
    pivots: list[int] = []
    for column in range(rows.shape[1]):
        k = len(pivots)
        candidates = np.flatnonzero(rows[k:, column])
        if not len(candidates):
            continue
        best = k + int(candidates[0])
        rows[[k, best]] = rows[[best, k]]
        rows[k] = rows[k] * pow(int(rows[k, column]), -1, m) % m
        factor = rows[:, column].copy()
        factor[k] = 0
        rows = (rows - factor[:, None] * rows[k] % m) % m
        pivots.append(column)
    free = [j for j in range(rows.shape[1]) if j not in pivots]
    basis = np.zeros((rows.shape[1], len(free)), dtype=np.int64)
    for i, j in enumerate(free):
        basis[j, i] = 1
        basis[pivots, i] = -rows[: len(pivots), j] % m
    return basis, free


def integer_power(x: Residue, exponent: int, m: int) -> Residue:
    """x^exponent for a whole exponent that is not negative."""
    power, square = Residue(np.ones_like(x.a)), x
    while exponent:
        power = times(power, square, m) if exponent % 2 else power
        square, exponent = times(square, square, m), exponent // 2
    return power

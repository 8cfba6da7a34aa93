"""Floating-point constants as the exact numbers that they stand for, and back."""

from __future__ import annotations

import math
from fractions import Fraction
from typing import Any

from varint.errors import InputError
from varint.notation.extra import sympy_module

SHORT = 12  # digits of a decimal that somebody wrote
SMALL = 1000  # denominators of fractions, and …
LARGEST = 10**9  # whole numbers that are written out
TURN = 360  # … of fractions of π
ROOT = 100  # denominators of what stands under a root
CLOSE = 4e-16  # relative: one rounding


def exact_number(x: float) -> Any:
    """The SymPy number that a constant stands for: 1/3, 9.81, π/6, √3/2, or all of its bits.

    Evaluated it is x again, but for a rounding.

    Raises
    ------
    InputError
        If it is no number.
    """
    sp = sympy_module("exact_number()")
    if math.isnan(x):
        raise InputError("an expression with the constant NaN cannot be written down")
    if math.isinf(x):
        return sp.oo if x > 0 else -sp.oo
    if x.is_integer():
        return sp.Integer(int(x))
    if len(repr(x).partition("e")[0].lstrip("-0.").replace(".", "")) <= SHORT:
        return sp.Rational(repr(x))
    plain = Fraction(x).limit_denominator(SMALL)
    if plain and float(plain) == x:
        return sp.Rational(plain.numerator, plain.denominator)
    turn = Fraction(x / math.pi).limit_denominator(TURN)
    if abs(float(turn) * math.pi - x) <= CLOSE * abs(x):
        return sp.pi * sp.Rational(turn.numerator, turn.denominator)
    square = Fraction(x * x).limit_denominator(ROOT)
    if abs(math.sqrt(square) - abs(x)) <= CLOSE * abs(x):
        return int(math.copysign(1, x)) * sp.sqrt(sp.Rational(square.numerator, square.denominator))
    return sp.Rational(x)


def decimal_text(p: int, q: int) -> str | None:
    """p/q as the decimal that one writes, ``9.81``; None where it reads better as a fraction."""
    if q == 1 and abs(p) < LARGEST:
        return None
    written = f"{p / q:.{SHORT}g}"
    exact = q % 5 == 0 and Fraction(written) == Fraction(p, q)
    return written if exact or q > SMALL or abs(p) >= LARGEST else None

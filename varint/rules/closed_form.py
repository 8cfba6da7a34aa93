"""Numbers of rules as books print them: fractions, and fractions with one square root."""

from __future__ import annotations

from fractions import Fraction
from math import sqrt

import numpy as np

DENOMINATOR = 360  # divided by all denominators of Gauss and Lobatto rules up to three stages
ROOTS = (3, 5, 15, 21)
CLOSE = 1e-15  # a wrong match has a chance of 1e-9


def closed_form(x: float) -> str:
    r"""x in LaTeX: a fraction, p + q √d, or ten digits.

    Examples
    --------
    >>> from varint.rules.closed_form import closed_form
    >>> closed_form(0.25), closed_form(0.5 - 3**0.5 / 6), closed_form(0.123456789)
    ('\\frac{1}{4}', '\\frac{1}{2} - \\frac{\\sqrt{3}}{6}', '0.123456789')
    """
    near = Fraction(x).limit_denominator(DENOMINATOR)
    if abs(near - Fraction(x)) <= CLOSE:
        return _fraction(near)
    parts = np.arange(-DENOMINATOR, DENOMINATOR + 1)
    for root in ROOTS:
        rest = (x - parts * sqrt(root) / DENOMINATOR) * DENOMINATOR
        hits = np.flatnonzero(np.abs(rest - np.round(rest)) <= CLOSE * DENOMINATOR)
        if len(hits):
            k = hits[np.argmin(np.abs(parts[hits]))]
            plain = Fraction(int(np.round(rest[k])), DENOMINATOR)
            factor = Fraction(int(parts[k]), DENOMINATOR)
            surd = _fraction(abs(factor), rf"\sqrt{{{root}}}")
            if not plain:
                return f"-{surd}" if factor < 0 else surd
            return f"{_fraction(plain)} {'-' if factor < 0 else '+'} {surd}"
    return f"{x:.10g}"


def _fraction(x: Fraction, times: str = "") -> str:
    """A fraction, times what stands in its numerator."""
    sign, p, q = "-" if x < 0 else "", abs(x.numerator), x.denominator
    above = f"{p}{times}" if not times or p != 1 else times
    return f"{sign}{above}" if q == 1 else rf"{sign}\frac{{{above}}}{{{q}}}"

"""A motion within its steps, at many times in each: tables of c/within_steps.c, and its entry."""

from __future__ import annotations

from collections.abc import Sequence
from ctypes import c_void_p, cast
from decimal import Decimal, localcontext
from fractions import Fraction
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from varint.codegen.kept import code_of, keep_content, kept_content, key_of
from varint.codegen.kernel import Kernel, address_of
from varint.rules import polynomials
from varint.rules.polynomials import PRECISE, gauss_nodes, value


class Within(NamedTuple):
    """How motions are looked at within their steps, by a rule of more stages than their own.

    Attributes
    ----------
    entry, scene : int
        Where c/within_steps.c is, and the scene.
    tables : int
        See `tables_of`.
    order : int
        Power of a step in which the motion's own rule errs.
    fewest : int
        Times that a step holds which is looked at: fewer take no longer one by one.
    """

    entry: int
    scene: int
    tables: int
    order: int
    fewest: int


NOTHING_WITHIN = Within(0, 0, 0, 0, 0)


def within(kernel: Kernel, order: int, fewest: int) -> Within:
    """By this loop, of motions by a rule of this order; nothing of them where it cannot."""
    if kernel.within_steps is None or kernel.opening:
        return NOTHING_WITHIN
    entry: Any = kernel.within_steps
    tables = address_of(tables_of(kernel.nodes))
    return Within(cast(entry, c_void_p).value or 0, kernel.scene, tables, order + 1, fewest)


@lru_cache(maxsize=8)
def tables_of(stages: int) -> np.ndarray:
    """The rates at Gauss points, times their weights, in Legendre polynomials of 2 x − 1, x from 0
    to 1; the integrals of these from 0 to x, divided by x, in powers of 2 x − 1; and the integrals
    of these, divided by x². Three matrices, column after column; kept on the disk.

    ``f(x) = Σ a_k P_k(2x − 1), a_k = (2k + 1) Σ_j P_k(2c_j − 1) b_j f_j``
    """
    key = key_of("within", str(stages), code=code_of(__file__, polynomials.__file__))
    if len(kept := kept_content(key)) == 3 * 8 * stages**2:
        return np.frombuffer(kept, float)
    tables = _computed(stages)
    keep_content(key, tables.tobytes())
    return tables


def _computed(stages: int) -> np.ndarray:
    legendre = [[Fraction(1)], [Fraction(0), Fraction(1)]]
    for k in range(1, stages - 1):
        ahead = [Fraction(0), *((2 * k + 1) * a for a in legendre[k])]
        before = [k * a for a in legendre[k - 1]] + [Fraction(0)] * 2
        legendre.append([(a - b) / (k + 1) for a, b in zip(ahead, before, strict=True)])
    with localcontext(PRECISE):
        at = [2 * c - 1 for c in gauss_nodes(stages)]
        decimal = [[Decimal(a.numerator) / Decimal(a.denominator) for a in p] for p in legendre]
        modes = [[float((2 * k + 1) * value(p, y)) for k, p in enumerate(decimal)] for y in at]
    first = [_divided(_integral(p)) for p in legendre]
    second = [_divided(_divided(_integral(_integral(p)))) for p in legendre]
    rows = [_padded(p, stages) for p in (*first, *second)]
    return np.array([*modes, *rows]).ravel()


def _integral(p: Sequence[Fraction]) -> list[Fraction]:
    """From −1 on."""
    found = [Fraction(0), *(a / (k + 1) for k, a in enumerate(p))]
    found[0] = -sum(a * (-1) ** k for k, a in enumerate(found))
    return found


def _divided(p: Sequence[Fraction]) -> list[Fraction]:
    """By (y + 1) / 2 and, as x is half of y, once by 2: where p is zero at −1."""
    found = [Fraction(0)] * (len(p) - 1)
    for k in range(len(p) - 1, 0, -1):
        found[k - 1] = p[k] - (found[k] if k < len(found) else 0)
    return found


def _padded(p: Sequence[Fraction], size: int) -> list[float]:
    return [float(a) for a in p] + [0.0] * (size - len(p))

"""Legendre and Lagrange polynomials in 50-digit decimal arithmetic: quadrature nodes, weights and
tables of values.

Polynomials are lists of coefficients, lowest power first. Everything is rounded to double once, at
the end, so that a rule's tables are exact to the last bit however many control points it has.
"""

from __future__ import annotations

from collections.abc import Sequence
from decimal import Context, Decimal, localcontext
from fractions import Fraction
from functools import cache, lru_cache

import numpy as np

PRECISE = Context(prec=50)  # 17 control points lose fewer than 20 of the digits

# of Gauss rules: two vectors of eight lanes; beyond, double precision has nothing left to gain
MOST_STAGES = 16

_EXACT: dict[float, Decimal] = {}  # the 50-digit value behind each rounded node


def gauss_nodes(stages: int) -> list[Decimal]:
    """Zeros of the Legendre polynomial of degree s, mapped to (0, 1)."""
    with localcontext(PRECISE):
        return _roots(_legendre(stages))


def lobatto_nodes(stages: int) -> list[Decimal]:
    """0, the extrema of the Legendre polynomial of degree s − 1 mapped to (0, 1), and 1."""
    with localcontext(PRECISE):
        inner = [k * a for k, a in enumerate(_legendre(stages - 1))][1:]
        return [Decimal(0), *(_roots(inner) if stages > 2 else []), Decimal(1)]


def interpolatory_weights(nodes: list[Decimal]) -> tuple[float, ...]:
    """b_j = ∫ ℓ_j from 0 to 1 of the Lagrange polynomials through the nodes."""
    with localcontext(PRECISE):
        return tuple(
            float(value(derivative(p, -1), Decimal(1))) for p in lagrange_polynomials(nodes)
        )


def rounded(nodes: list[Decimal]) -> tuple[float, ...]:
    """The nodes as doubles; `lagrange_table` goes on using their 50-digit values."""
    _EXACT.update({float(x): x for x in nodes})
    return tuple(float(x) for x in nodes)


def lagrange_table(points: Sequence, at: Sequence, derivative: int = 0) -> np.ndarray:
    """ℓ_j^(derivative)(x_i) of the Lagrange polynomials through `points` (derivative −1:
    integral from 0 to x_i).
    """
    return _table(tuple(points), tuple(at), derivative)


@lru_cache(maxsize=256)
def _table(points: tuple, at: tuple, times: int) -> np.ndarray:
    with localcontext(PRECISE):
        polynomials = [
            derivative(p, times) for p in lagrange_polynomials([_decimal(x) for x in points])
        ]
        table = [[float(value(p, _decimal(x))) for p in polynomials] for x in at]
    result = np.array(table).reshape(len(at), len(points))
    result.flags.writeable = False
    return result


def _decimal(x) -> Decimal:
    if isinstance(x, float) and 0 < x < 1 and x not in _EXACT:
        # a rule that came from a file or another process must have the tables it had there
        _learn_the_families()
    if x in _EXACT:
        return _EXACT[x]
    x = Fraction(x)
    return Decimal(x.numerator) / Decimal(x.denominator)


@cache
def _learn_the_families() -> None:
    """The 50-digit values behind the nodes of every rule of the library."""
    for stages in range(1, MOST_STAGES + 1):
        rounded(gauss_nodes(stages))
        rounded(lobatto_nodes(stages + 1))


def lagrange_polynomials(points: list[Decimal]) -> list[list[Decimal]]:
    """The Lagrange polynomials through the points."""
    polynomials = []
    for j, x_j in enumerate(points):
        p = [Decimal(1)]
        for k, x_k in enumerate(points):
            if k != j:
                p = [
                    (a - x_k * b) / (x_j - x_k)
                    for a, b in zip([Decimal(0), *p], [*p, Decimal(0)], strict=True)
                ]
        polynomials.append(p)
    return polynomials


def derivative(p: list[Decimal], times: int) -> list[Decimal]:
    """The derivative of p, `times` over; −1: the antiderivative that vanishes at 0."""
    if times < 0:
        return [Decimal(0), *(a / (k + 1) for k, a in enumerate(p))]
    for _ in range(times):
        p = [k * a for k, a in enumerate(p)][1:] or [Decimal(0)]
    return p


def value(p: list[Decimal], x: Decimal) -> Decimal:
    """p(x) by Horner's rule."""
    result = Decimal(0)
    for a in reversed(p):
        result = result * x + a
    return result


def _legendre(degree: int) -> list[Fraction]:
    """The Legendre polynomial on [−1, 1], by Bonnet's recursion."""
    p, q = [Fraction(1)], [Fraction(0), Fraction(1)]
    for k in range(1, degree):
        shifted = [Fraction(0), *((2 * k + 1) * a for a in q)]
        old = [k * a for a in p] + [Fraction(0)] * 2
        p, q = q, [(a - b) / (k + 1) for a, b in zip(shifted, old, strict=True)]
    return p if degree == 0 else q


def _roots(coefficients: list[Fraction]) -> list[Decimal]:
    """Real simple roots on (−1, 1) mapped to (0, 1), polished by Newton's method in decimal
    arithmetic.
    """
    p = [Decimal(a.numerator) / Decimal(a.denominator) for a in coefficients]
    slope = derivative(p, 1)
    roots = []
    for start in np.sort(np.roots([float(a) for a in reversed(coefficients)]).real):
        x = Decimal(float(start))
        for _ in range(6):  # each iteration doubles the digits: 12 → 50 takes three
            x -= value(p, x) / value(slope, x)
        roots.append((1 + x) / 2)
    return roots


def lagrange_values(points: np.ndarray, at: np.ndarray) -> np.ndarray:
    """ℓ_j(x_i) in double precision at any times, (len(at), len(points)); for interpolation at
    run time.
    """
    ratios = (at[:, None, None] - points) / (points[:, None] - points + np.eye(len(points)))
    return np.where(np.eye(len(points), dtype=bool), 1.0, ratios).prod(axis=2)


def lagrange_slopes(points: np.ndarray, at: np.ndarray) -> np.ndarray:
    """ℓ_j'(x_i), as `lagrange_values`."""
    r, others = len(points), ~np.eye(len(points), dtype=bool)
    found = np.zeros((len(at), r))
    for j in range(r):
        for i in np.flatnonzero(others[j]):
            rest = points[others[j] & others[i]]
            factors = (at[:, None] - rest) / (points[j] - rest)
            found[:, j] += factors.prod(axis=1) / (points[j] - points[i])
    return found

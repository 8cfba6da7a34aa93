"""Matrices with twice the digits of a number, and maps of steps by Gauss rules."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest

from varint.numerics.linear_maps import exact_gauss_change, gauss_change
from varint.numerics.pairs import LEFT_OUT, Pair, pair_of, product, single, solved

random = np.random.default_rng(5)


@pytest.mark.parametrize("stages", [1, 2, 3, 8])
def test_the_map_of_a_step_is_that_of_the_rule(stages):
    a = random.standard_normal((4, 4)) / 4
    found = exact_gauss_change(single(a), stages)
    assert found.high == pytest.approx(gauss_change(a, stages), abs=1e-14)
    # R(z) R(−z) = 1, with twice the digits
    back = exact_gauss_change(single(-a), stages)
    both = product(found, back)
    left = found.high + back.high + both.high + (found.low + back.low + both.low)
    assert np.abs(left).max() < 1e-15
    for i, j in np.ndindex(4, 4):
        parts = [x[i, j] for pair in (found, back, both) for x in pair]
        assert abs(sum(map(Fraction, parts))) < 1e-26


def whole(x: Pair) -> list[list[Fraction]]:
    return [
        [Fraction(a) + Fraction(b) for a, b in zip(*rows, strict=True)]
        for rows in zip(x.high.tolist(), x.low.tolist(), strict=True)
    ]


def test_products_of_pairs_are_exact_but_for_what_they_leave_out():
    x, y = (
        [
            [Fraction(int(k), 3**41) * 10 ** int(e) for k, e in zip(*row, strict=True)]
            for row in both
        ]
        for both in (
            zip(
                random.integers(-(2**62), 2**62, (5, 6)),
                random.integers(-6, 6, (5, 6)),
                strict=True,
            ),
            zip(
                random.integers(-(2**62), 2**62, (6, 4)),
                random.integers(-6, 6, (6, 4)),
                strict=True,
            ),
        )
    )
    a, b = pair_of(x), pair_of(y)
    found = whole(product(a, b))
    for i, row in enumerate(whole(a)):
        for j, column in enumerate(zip(*whole(b), strict=True)):
            left = found[i][j] - sum(s * t for s, t in zip(row, column, strict=True))
            most = max(map(abs, row)) * max(map(abs, column))
            assert abs(left) <= LEFT_OUT * len(row) * most


def test_solutions_of_pairs_have_twice_the_digits():
    a = single(random.standard_normal((6, 6)) + 4 * np.eye(6))
    b = single(random.standard_normal((6, 3)))
    found = whole(solved(a, b))
    for i, row in enumerate(whole(a)):
        for j in range(3):
            left = sum(x * found[k][j] for k, x in enumerate(row)) - Fraction(float(b.high[i, j]))
            assert abs(left) < 1e-25

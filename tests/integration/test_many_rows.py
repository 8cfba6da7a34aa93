"""Functions over many rows: every number of rows, by few calls."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from varint.numerics.arrays import CALL, LARGEST_ROWS, MANY, ROW, call, over_columns, row_blocks

X, C = ca.SX.sym("x", 2), ca.SX.sym("c")
FUNCTION = ca.Function("f", [X, C], [ca.vertcat(ca.sin(X[0]) * C, X[1] ** 2), X[0] / X[1]])


@pytest.mark.parametrize("count", [0, 1, 3, 10, 11, 16, 63, 64, 100, 172, 255, 500, 1025, 5003])
def test_every_row_has_its_own_value(count):
    x = np.random.default_rng(count).uniform(1, 2, (count, 2))
    both, quotient = over_columns(FUNCTION, x, np.array([3.0]))
    assert both.shape == (count, 2) and quotient.shape == (count, 1)
    np.testing.assert_allclose(both, np.stack([3 * np.sin(x[:, 0]), x[:, 1] ** 2], 1), rtol=1e-15)
    np.testing.assert_allclose(quotient[:, 0], x[:, 0] / x[:, 1], rtol=1e-15)


@pytest.mark.parametrize("operations", [1, 100, 10_000, MANY])
def test_blocks_hold_all_rows_and_are_filled_up_only_where_that_is_cheaper(operations):
    powers = 4.0 ** np.arange(12)
    for count in range(1, 3000, 7):
        sizes = row_blocks(count, operations)
        assert set(sizes) <= set(powers) and max(sizes) <= LARGEST_ROWS
        more = sum(sizes) - count
        assert 0 <= more < sizes[-1]
        digits = sum(int(d) for d in np.base_repr(count % LARGEST_ROWS, 4)) + count // LARGEST_ROWS
        assert more * (ROW + operations) <= (digits - len(sizes)) * CALL
    assert sum(row_blocks(172, MANY)) == 172 and row_blocks(172, 4) == (256,)


@pytest.mark.parametrize("size", [2, 40])
def test_a_call_that_comes_to_no_result_gives_no_numbers(size):
    """An exactly singular system ends CasADi's call; what was in memory is no result."""
    a, b = ca.MX.sym("a", size, size), ca.MX.sym("b", size)
    solve = ca.Function("solve", [a, b], [ca.solve(a, b, "qr"), ca.sum1(b)])
    good, right = np.eye(size), np.arange(1.0, size + 1)
    np.testing.assert_allclose(call(solve, good.ravel(), right)[0], right)
    assert all(np.isnan(x).all() for x in call(solve, 0 * good.ravel(), right))
    for count in (3, 64, 300):  # one row without a result costs the others none
        rows = np.repeat(good.ravel()[None], count, axis=0)
        rows[1] = 0
        found = over_columns(solve, rows, right)[0]
        assert np.isnan(found[1]).all()
        np.testing.assert_allclose(np.delete(found, 1, 0), np.tile(right, (count - 1, 1)))
    np.testing.assert_allclose(call(solve, good.ravel(), right)[0], right)

"""Identities are decided by the rules of algebra: true ones hold, others do not, whatever their
size and wherever they live.
"""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from varint.symmetry.finite_field import null_space, rational, reconstruct, residue
from varint.symmetry.identities import P, evaluate

X, Y, A = (ca.SX.sym(name) for name in "xya")


def vanishes(expression: ca.SX) -> bool:
    function = ca.Function("f", [X, Y, A], [expression])
    values = evaluate(function, [None] * 3).values
    assert values.decided or not values.rows.any()
    return not values.rows.any()


TRUE = {
    "binomial": (X + Y) ** 3 - X**3 - 3 * X**2 * Y - 3 * X * Y**2 - Y**3,
    "quotients": (X / Y + Y / X) * X * Y - X**2 - Y**2,
    "squares of sine and cosine": ca.sin(X * Y) ** 2 + ca.cos(Y * X) ** 2 - 1,
    "double angle": ca.sin(2 * X) - 2 * ca.sin(X) * ca.cos(X),
    "half angle": ca.cos(X) - 1 + 2 * ca.sin(X / 2) ** 2,
    "sum of angles": ca.cos(X + Y) - ca.cos(X) * ca.cos(Y) + ca.sin(X) * ca.sin(Y),
    "tangent": ca.tan(X) * ca.cos(X) - ca.sin(X),
    "product of exponentials": ca.exp(X + Y) - ca.exp(X) * ca.exp(Y),
    "hyperbolic": ca.cosh(X) ** 2 - ca.sinh(X) ** 2 - 1,
    "roots": ca.power(X * X + Y, 1.5) - ca.sqrt(Y + X * X) ** 3,
    "nested roots": ca.sqrt(1 + ca.sqrt(X)) ** 2 - 1 - ca.sqrt(X),
    "cube root": ca.power(X + Y, 1 / 3) ** 3 - X - Y,
    "decimal powers": ca.power(X, 0.3) * ca.power(X, 0.2) - ca.sqrt(X),
    "symbolic power": ca.power(X, A) * X - ca.power(X, A + 1),
    "norm in an exponent": ca.exp(ca.sqrt(X * X + Y * Y)) * ca.exp(-ca.hypot(X, Y)) - 1,
    "larger and smaller": ca.fmax(X - 20, Y) + ca.fmin(X - 20, Y) - X + 20 - Y,
    "absolute value": ca.fabs(-X * Y) * ca.fabs(X) - X * X * ca.fabs(Y),
    "branches": ca.if_else(X > 3, Y, A) - ca.if_else(X <= 3, A, Y),
    "decimals": 0.1 * X + 0.2 * X - 0.3 * X,
    "tiny terms": 1e-30 * X * (X + 1) - 1e-30 * X**2 - 1e-30 * X,
}
# the first four beyond the reach of any sample in double precision
FALSE = {
    "a far well": ca.exp(-4 * (X - 1000) ** 2),
    "a far wall": ca.fmax(X - 1e9, 0) ** 2,
    "a tiny term": (X + Y) ** 2 - X**2 - 2 * X * Y - (1 + 1e-11) * Y**2,
    "a vanishing power": X**200 / (1 + X**2) ** 400,
    "sines": ca.sin(3 * X) - 3 * ca.sin(X) * ca.cos(X),
    "roots": ca.sqrt(X * X + Y) - ca.sqrt(X * X - Y),
    "branches": ca.if_else(X > 50, Y, A) - A,
    "exponentials": ca.exp(X * Y) - ca.exp(X) * ca.exp(Y),
}


@pytest.mark.parametrize("name", TRUE)
def test_true_identities_vanish(name):
    assert vanishes(TRUE[name])


@pytest.mark.parametrize("name", FALSE)
def test_others_do_not(name):
    assert not vanishes(FALSE[name])


def test_a_function_without_rules_leaves_the_answer_open():
    function = ca.Function("f", [X, Y], [ca.log(X * Y) - ca.log(X) - ca.log(Y)])
    values = evaluate(function, [None] * 2).values
    assert values.rows.any() and not values.decided


def test_equal_arguments_of_such_a_function_give_equal_values():
    function = ca.Function("f", [X, Y], [ca.atan2(X + Y, Y) - ca.atan2(Y + X, X + Y - X)])
    assert not evaluate(function, [None] * 2).values.rows.any()


def test_numbers_may_be_given_for_arguments():
    function = ca.Function("f", [X, Y], [X * Y - 3 * X])
    assert not evaluate(function, [None, np.array([3.0])]).values.rows.any()
    assert evaluate(function, [None, np.array([3.1])]).values.rows.any()


@pytest.mark.parametrize(
    ("x", "text", "clear"),
    [
        (0.1 + 0.2, "3/10", True),
        (2 / 7, "2/7", True),
        (1e-30, f"1/{10**30}", True),
        (1e30 * (1 + 2e-16), f"{10**30}", True),
        (np.pi, "3141592653589793/1000000000000000", False),
    ],
)
def test_constants_are_what_was_typed(x, text, clear):
    value, meant = rational(x)
    assert (str(value), meant) == (text, clear)


def test_fractions_come_back_from_residues():
    rng = np.random.default_rng(5)
    for top, bottom in rng.integers(-5000, 5000, (200, 2)).tolist():
        if bottom:
            fraction = rational(top / 1.0)[0] / bottom
            assert reconstruct(residue(fraction, P), P) == fraction


def test_the_null_space_of_a_random_matrix_of_given_rank_is_exact():
    rng = np.random.default_rng(6)
    left, right = rng.integers(0, 50, (12, 4)), rng.integers(0, 50, (4, 9))
    basis, free = null_space(left @ right, P)
    assert basis.shape == (9, 5) and len(free) == 5
    assert not ((left @ right) @ basis % P).any()

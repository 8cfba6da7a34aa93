"""Functions of a scene at many points at once, as data: the values are those of CasADi."""

import casadi as ca
import numpy as np
import pytest

from varint.codegen.rows import row_function_or_none

x, y, w = ca.SX.sym("x", 3), ca.SX.sym("y"), ca.SX.sym("w", 2)
RESULTS = [
    ca.vertcat(ca.sin(x[0]) * x[2] - w[0] * y, ca.sqrt(1 + x[1] ** 2) / (2 + ca.cos(y))),
    ca.if_else(x[0] > w[1], ca.exp(-x[1]), ca.log(3 + y)),
]
FUNCTION = ca.Function("f", [x, y, w], RESULTS)
PARAMETERS = np.array([0.7, -0.2])


@pytest.mark.parametrize("count", [0, 1, 7, 8, 9, 100])
def test_values_at_many_points_are_those_of_each_alone(count):
    numbers = np.random.default_rng(count)
    wide = numbers.uniform(-1, 1, (count, 3, 3))  # what is asked for lies apart in memory
    f = row_function_or_none("f", [x, y], w, RESULTS)
    found = f.values(PARAMETERS, wide[:, 1], wide[:, 2, :1])
    assert [len(each) for each in f.values(PARAMETERS, wide[:0, 1][[]], wide[:0, 2, :1])] == [0, 0]
    wanted = [FUNCTION(row[1], row[2, 0], PARAMETERS) for row in wide]
    for k, width in enumerate((2, 1)):
        assert found[k].shape == (count, width)
        if not count:  # picked rows of none have no strides
            continue
        np.testing.assert_allclose(
            found[k], [np.array(each[k]).ravel() for each in wanted], rtol=1e-14, atol=1e-15
        )


def test_an_argument_of_one_row_is_the_same_at_all_points():
    points = np.random.default_rng(1).uniform(-1, 1, (20, 3))
    f = row_function_or_none("f", [x, y], w, RESULTS)
    one = f.values(PARAMETERS, points, np.array([[0.4]]))
    many = f.values(PARAMETERS, points, np.full((20, 1), 0.4))
    for a, b in zip(one, many, strict=True):
        np.testing.assert_array_equal(a, b)


def test_what_has_no_form_as_data_is_none():
    assert row_function_or_none("f", [x], w, [ca.erfinv(x)]) is None

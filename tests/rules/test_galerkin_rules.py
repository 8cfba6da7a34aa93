"""Gauss and Lobatto rules as data: quadratures, collocation matrices, tables."""

from __future__ import annotations

import math
from decimal import Context

import numpy as np
import pytest

import varint as vi
from varint.rules.compositions import COMPOSITIONS
from varint.rules.polynomials import lagrange_table, lagrange_values, lobatto_nodes

PRECISE = Context(prec=60)
NAMES = list(COMPOSITIONS)
GAUSS, LOBATTO = range(1, 17), range(2, 11)
ROUND_OFF = 4e-15  # of sums of ten products of size 1
EVERY_RULE = [*map(vi.gauss, GAUSS), *map(vi.lobatto, LOBATTO), *map(vi.composition, NAMES)]


@pytest.mark.parametrize("s", GAUSS)
def test_gauss_quadrature_is_exact_to_degree_2s_minus_1_and_not_beyond(s):
    nodes, weights = np.array(vi.gauss(s).nodes), np.array(vi.gauss(s).weights)
    for k in range(2 * s):
        assert weights @ nodes**k == pytest.approx(1 / (k + 1), abs=ROUND_OFF)
    # = ∫ Π (x − c_i)², 1e-12 for s = 10
    missing = math.factorial(s) ** 4 / ((2 * s + 1) * math.factorial(2 * s) ** 2)
    tolerance = pytest.approx(missing, rel=1e-2, abs=0 if s <= 10 else ROUND_OFF)
    assert 1 / (2 * s + 1) - weights @ nodes ** (2 * s) == tolerance


@pytest.mark.parametrize("s", LOBATTO)
def test_lobatto_quadrature_is_exact_to_degree_2s_minus_3_and_not_beyond(s):
    nodes, weights = np.array(vi.lobatto(s).nodes), np.array(vi.lobatto(s).weights)
    for k in range(2 * s - 2):
        assert weights @ nodes**k == pytest.approx(1 / (k + 1), abs=ROUND_OFF)
    assert abs(weights @ nodes ** (2 * s - 2) - 1 / (2 * s - 1)) > 1e-12


@pytest.mark.parametrize("s", LOBATTO)
def test_lobatto_weights_are_those_of_the_closed_form(s):
    legendre = np.polynomial.legendre.Legendre.basis(s - 1)(2 * np.array(vi.lobatto(s).nodes) - 1)
    assert vi.lobatto(s).weights == pytest.approx(1 / (s * (s - 1) * legendre**2), rel=1e-13)


@pytest.mark.parametrize("s", GAUSS)
def test_gauss_nodes_agree_with_numpy(s):
    x, w = np.polynomial.legendre.leggauss(s)
    assert vi.gauss(s).nodes == pytest.approx((1 + x) / 2, abs=1e-15)
    assert vi.gauss(s).weights == pytest.approx(w / 2, abs=1e-15)


@pytest.mark.parametrize("s", GAUSS)
def test_gauss_matrix_satisfies_the_simplifying_assumptions_of_collocation(s):
    a, b, c = vi.gauss(s).collocation, np.array(vi.gauss(s).weights), np.array(vi.gauss(s).nodes)
    for k in range(1, s + 1):
        assert a @ c ** (k - 1) == pytest.approx(c**k / k, abs=ROUND_OFF), f"C({k})"
        assert (b * c ** (k - 1)) @ a == pytest.approx(b * (1 - c**k) / k, abs=ROUND_OFF), f"D({k})"
    if s <= 10:  # C(s + 1) fails: s stages cannot do more
        assert np.abs(a @ c**s - c ** (s + 1) / (s + 1)).max() > 1e-10


@pytest.mark.parametrize("s", GAUSS)
def test_gauss_matrix_is_symplectic(s):
    a, b = vi.gauss(s).collocation, np.array(vi.gauss(s).weights)
    m = b[:, None] * a
    assert np.abs(m + m.T - np.outer(b, b)).max() < 5e-16


@pytest.mark.parametrize("s", LOBATTO)
def test_lobatto_pair_of_collocation_and_galerkin_tables_is_symplectic(s):
    rule = vi.lobatto(s)
    a, b = rule.collocation, np.array(rule.weights)
    partner = b * (1 - a.T / b[:, None])  # Lobatto IIIB from IIIA: b_i â_ij + b_j a_ji = b_i b_j
    c = np.array(rule.nodes)
    for k in range(1, s - 1):  # IIIB satisfies C(s − 2), IIIA does by construction C(s)
        assert partner @ c ** (k - 1) == pytest.approx(c**k / k, abs=1e-13)
    # IIIB: last column 0, first column b_1
    assert partner[:, -1] == pytest.approx(np.zeros(s), abs=1e-15)
    assert partner[:, 0] == pytest.approx(np.full(s, b[0]), abs=1e-15)


@pytest.mark.parametrize("s", GAUSS)
def test_gauss_galerkin_tables_are_those_of_collocation(s):
    """q(c_i) = q_0 + Σ a_ij q'(c_j) for the polynomial through the control points: Galerkin =
    Runge–Kutta.
    """
    rule = vi.gauss(s)
    first = np.zeros((s, s + 1))
    first[:, 0] = 1
    assert rule.basis == pytest.approx(first + rule.collocation @ rule.slopes, abs=ROUND_OFF)
    assert rule.weights @ rule.slopes == pytest.approx(
        np.r_[-1, np.zeros(s - 1), 1], abs=20 * ROUND_OFF
    )


@pytest.mark.parametrize("rule", EVERY_RULE, ids=repr)
def test_rule_is_self_adjoint(rule):
    assert rule.nodes == pytest.approx(1 - np.array(rule.nodes)[::-1], abs=ROUND_OFF)
    assert rule.weights == pytest.approx(rule.weights[::-1], abs=2.3e-16)
    assert rule.points == pytest.approx(1 - np.array(rule.points)[::-1], abs=2.3e-16)
    if rule.points:
        assert rule.basis == pytest.approx(rule.basis[::-1, ::-1], abs=1e-15)
        assert rule.slopes == pytest.approx(-rule.slopes[::-1, ::-1], abs=1e-13)


@pytest.mark.parametrize("rule", EVERY_RULE, ids=repr)
def test_weights_sum_to_one_and_the_order_is_even(rule):
    assert math.fsum(rule.weights) == pytest.approx(1, abs=ROUND_OFF)
    assert rule.order % 2 == 0


@pytest.mark.parametrize("rule", [r for r in EVERY_RULE if r.points], ids=repr)
def test_extrapolation_continues_a_polynomial_path_exactly(rule):
    tau, d = np.array(rule.points), rule.degree
    path = np.polynomial.Polynomial(1 / np.arange(1.0, d + 2))
    ahead = path(1 + tau[1:]) - path(1.0)
    increments = path(tau[1:]) - path(0.0)
    row_sums = np.abs(rule.extrapolation).sum(axis=1)
    assert np.all(
        np.abs(rule.extrapolation @ increments - ahead)
        <= 1e-15 * d * (1 + row_sums) * abs(increments).max()
    )


def test_tables_keep_double_precision_with_seventeen_control_points():
    """Monomials are reproduced by the tables of the largest rule: no cancellation from the order
    of the points.
    """
    rule = vi.gauss(16)
    c, tau = np.array(rule.nodes), np.array(rule.points)
    for k in range(17):
        assert rule.basis @ tau**k == pytest.approx(c**k, abs=1e-15)
        assert rule.slopes @ tau**k == pytest.approx(k * c ** max(k - 1, 0), abs=3e-14)


@pytest.mark.parametrize("s", GAUSS)
def test_interpolation_at_run_time_agrees_with_the_exact_tables(s):
    points = np.array(vi.gauss(s).points)
    at = np.array([-0.25, 0.0, 0.375, points[s // 2], 1.0, 1.5])
    exact = lagrange_table(points, at)
    assert np.all(np.abs(lagrange_values(points, at) - exact) <= 1e-14 * (1 + np.abs(exact)))


def test_midpoint_and_trapezoidal_are_members_of_the_families():
    assert vi.midpoint() == vi.gauss(1) and vi.trapezoidal() == vi.lobatto(2)
    assert (vi.trapezoidal().kicks, vi.trapezoidal().drifts) == (
        vi.composition("verlet").kicks,
        (1.0,),
    )
    assert lobatto_nodes(2) == [0, 1]


def test_rules_are_made_once_and_compare_by_value():
    assert vi.gauss(3) is vi.gauss(np.int64(3)) and vi.gauss(3) != vi.gauss(4)
    assert vi.composition("Blanes–Moan 6") is vi.composition("blanes-moan6")
    assert len({vi.gauss(2), vi.gauss(2), vi.lobatto(3)}) == 2


def test_tables_cannot_be_written_to():
    with pytest.raises(ValueError, match="read-only"):
        lagrange_table((0, 1), (0.5,))[0, 0] = 7


@pytest.mark.parametrize(
    ("s", "limit"), [(2, 2.0), (3, math.sqrt(8)), (4, 3.112718), (5, 6.054050), (6, 6.253008)]
)
@pytest.mark.filterwarnings("ignore:.*h = .* is too large")
def test_lobatto_rules_are_stable_up_to_their_limit_and_not_beyond(s, limit):
    """A step of an oscillator is a matrix of determinant 1: stable where its trace is below 2."""
    q, v = vi.coordinates("x")
    oscillator = vi.System(q, v, (v**2 - q**2) / 2)

    def trace(h):
        runs = [
            vi.simulate(oscillator, vi.lobatto(s), q0=[x], v0=[1 - x], h=h, steps=1) for x in (1, 0)
        ]
        return runs[0].q[-1, 0] + runs[1].p[-1, 0]

    assert abs(trace(limit * (1 - 1e-6))) < 2 < abs(trace(limit * (1 + 1e-6)))

"""Rules as data: quadratures, collocation matrices and composition sequences satisfy their order
conditions.

The order conditions of compositions are those of Nyström trees (Hairer, Lubich & Wanner, III.2.3
and IV.2.3): a kick i at time c_i has the weight Φ_i(τ) = c_i^m Π_k Σ_j b_j (c_i − c_j)_+ Φ_j(τ_k)
for a tree with m leaves and subtrees τ_k, and order p means Σ b_i Φ_i(τ) = ∫ of the same with an
integral for each sum, for every tree of at most p nodes.
"""

from __future__ import annotations

import math
from decimal import Context, Decimal, localcontext
from functools import cache
from itertools import pairwise

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


# --- compositions
# ------------------------------------------------------------------------------


@cache
def nyström_trees(nodes: int) -> list[tuple]:
    """All (leaves, subtrees) with the given number of nodes; a subtree of m nodes hangs on one
    more.
    """
    found = set()

    def grow(free: int, largest: tuple, subtrees: tuple):
        found.add((free, subtrees))
        for m in range(1, free):
            for tree in nyström_trees(m):
                if (m, tree) <= largest:
                    grow(free - m - 1, (m, tree), (*subtrees, tree))

    grow(nodes - 1, (nodes,), ())
    return sorted(found)


def nodes_of(tree: tuple) -> int:
    leaves, subtrees = tree
    return 1 + leaves + sum(nodes_of(s) + 1 for s in subtrees)


def exact_coefficient(tree: tuple) -> Decimal:
    """Φ(τ)(t) = coefficient t^(nodes − 1) when every sum is an integral."""
    value = Decimal(1)
    for s in tree[1]:
        value *= exact_coefficient(s) / (nodes_of(s) * (nodes_of(s) + 1))
    return value


def defect_of_order(order: int, kicks: list, drifts: list) -> Decimal:
    """Largest defect of the order conditions of the trees with exactly `order` nodes."""
    times = [Decimal(0)]
    for a in drifts:
        times.append(times[-1] + a)
    weights = {}

    def weight(tree):
        if tree not in weights:
            leaves, subtrees = tree
            value = [c**leaves if leaves else Decimal(1) for c in times]
            for s in subtrees:
                moment0 = moment1 = Decimal(0)
                for i, (b, c, phi) in enumerate(zip(kicks, times, weight(s), strict=True)):
                    value[i] *= c * moment0 - moment1
                    moment0, moment1 = moment0 + b * phi, moment1 + b * phi * c
            weights[tree] = value
        return weights[tree]

    return max(
        abs(
            sum(b * phi for b, phi in zip(kicks, weight(t), strict=True))
            - exact_coefficient(t) / order
        )
        for t in nyström_trees(order)
    )


def test_nyström_trees_are_as_many_as_the_literature_counts():
    assert [len(nyström_trees(n)) for n in range(1, 11)] == [1, 1, 2, 3, 6, 10, 20, 36, 72, 137]


@pytest.mark.parametrize("name", NAMES)
def test_composition_satisfies_the_order_conditions_of_its_order_and_not_of_the_next(name):
    order, kicks, drifts = COMPOSITIONS[name]()
    with localcontext(PRECISE):
        for n in range(1, order + 1):
            assert defect_of_order(n, kicks, drifts) < Decimal("1e-38")
        assert defect_of_order(order + 1, kicks, drifts) > Decimal("1e-7")


@pytest.mark.parametrize("name", NAMES[1:])
def test_order_conditions_see_one_wrong_digit(name):
    order, kicks, drifts = COMPOSITIONS[name]()
    for position in range(len(drifts) // 2):
        with localcontext(PRECISE):
            wrong = list(drifts)
            # and its mirror image, so that symmetry and consistency survive
            wrong[position] += Decimal("1e-20")
            wrong[-1 - position] += Decimal("1e-20")
            wrong[position + 1] -= Decimal("1e-20")
            wrong[-2 - position] -= Decimal("1e-20")
            if wrong == drifts:  # the middle two of an even number cancel
                continue
            # 1e-20 times at least 1e-7
            assert max(defect_of_order(n, kicks, wrong) for n in range(1, order + 1)) > Decimal(
                "1e-27"
            )


@pytest.mark.parametrize("name", NAMES)
def test_composition_is_symmetric_and_consistent(name):
    rule = vi.composition(name)
    assert rule.kicks == rule.kicks[::-1] and rule.drifts == rule.drifts[::-1]
    assert len(rule.kicks) == len(rule.drifts) + 1
    assert math.fsum(rule.kicks) == pytest.approx(1, abs=ROUND_OFF)
    assert math.fsum(rule.drifts) == pytest.approx(1, abs=ROUND_OFF)


@pytest.mark.parametrize("name", NAMES)
def test_kick_times_are_the_sums_of_the_drifts(name):
    rule = vi.composition(name)
    assert rule.nodes[0] == 0 and rule.nodes[-1] == 1 and rule.weights == rule.kicks
    assert np.diff(rule.nodes) == pytest.approx(rule.drifts, abs=ROUND_OFF)


def hénon_heiles(q):
    x, y = q
    return [-x - 2 * x * y, -y - x * x + y * y]


def composed(kicks, drifts, q, p, h, steps):
    for _ in range(steps):
        for i, b in enumerate(kicks):
            p = [x + b * h * f for x, f in zip(p, hénon_heiles(q), strict=True)]
            if i < len(drifts):
                q = [x + drifts[i] * h * v for x, v in zip(q, p, strict=True)]
    return q, p


def by_taylor_series(q, p, h, steps, terms=44):
    """Hénon–Heiles by the recursion of its Taylor coefficients: (k + 1)(k + 2) x_{k+2} =
    coefficient k of the force.
    """
    for _ in range(steps):
        x, y = [q[0], p[0]], [q[1], p[1]]
        for k in range(terms):
            xy = sum(x[j] * y[k - j] for j in range(k + 1))
            squares = sum(y[j] * y[k - j] - x[j] * x[k - j] for j in range(k + 1))
            x.append((-x[k] - 2 * xy) / ((k + 1) * (k + 2)))
            y.append((-y[k] + squares) / ((k + 1) * (k + 2)))
        powers = [h**k for k in range(len(x))]
        q = [sum(a * b for a, b in zip(c, powers, strict=True)) for c in (x, y)]
        p = [
            sum(k * a * b for k, (a, b) in enumerate(zip(c[1:], powers, strict=False), 1))
            for c in (x, y)
        ]
    return q, p


@cache
def exact_hénon_heiles():
    with localcontext(PRECISE):
        return by_taylor_series(*start(), Decimal(1) / 16, 32)


def start():
    return [Decimal("0.12"), Decimal("0.12")], [Decimal("0.12"), Decimal("0.12")]


@pytest.mark.parametrize("name", NAMES)
def test_composition_converges_with_its_order_in_sixty_digit_arithmetic(name):
    order, kicks, drifts = COMPOSITIONS[name]()
    errors = []
    with localcontext(PRECISE):
        exact_q, exact_p = exact_hénon_heiles()
        for steps in (64, 128, 256):  # coarser ones leave Yoshida 8 short of its slope
            q, p = composed(kicks, drifts, *start(), Decimal(2) / steps, steps)
            errors.append(
                [
                    max(abs(a - b) for a, b in zip(x, y, strict=True))
                    for x, y in ((q, exact_q), (p, exact_p))
                ]
            )
    slopes = np.array(
        [[math.log2(a / b) for a, b in zip(*pair, strict=True)] for pair in pairwise(errors)]
    )
    assert slopes == pytest.approx(np.full((2, 2), order), abs=0.15)


def test_blanes_moan_is_the_most_accurate_of_its_order_at_equal_cost():
    # divisible by the stages of every method of order 4 and 6 but one
    def error(name, evaluations=1980):
        _, kicks, drifts = COMPOSITIONS[name]()
        steps = evaluations // len(drifts)
        q, _ = composed(kicks, drifts, *start(), Decimal(2) / steps, steps)
        return max(abs(a - b) for a, b in zip(q, exact_hénon_heiles()[0], strict=True))

    with localcontext(PRECISE):
        assert error("blanes-moan4") < min(error("yoshida4"), error("suzuki4")) / 3
        assert error("blanes-moan6") < min(error("yoshida6"), error("kahan-li6")) / 3


# --- Galerkin rules
# ------------------------------------------------------------------------------


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


# --- what is refused
# ------------------------------------------------------------------------------


@pytest.mark.parametrize("stages", [0, 17, -1, 2.0, 2.5, "x", [2], None, True, np.nan])
@pytest.mark.parametrize("family, least, most", [(vi.gauss, 1, 16), (vi.lobatto, 2, 10)])
def test_stages_out_of_range_are_refused_with_the_range(family, least, most, stages):
    # a cache that answers 2.0 or True from these would hide the error
    (
        vi.gauss(2),
        vi.lobatto(2),
        vi.gauss(1),
    )
    with pytest.raises(vi.InputError, match=rf"takes a whole number from {least} to {most}, got "):
        family(stages)


def test_one_lobatto_point_is_refused():
    with pytest.raises(vi.InputError, match="from 2 to 10, got 1"):
        vi.lobatto(1)


@pytest.mark.parametrize("name", ["yoshida5", "", None, 4, ["verlet"], {"verlet"}])
def test_unknown_compositions_are_refused_with_the_list_of_those_known(name):
    with pytest.raises(vi.InputError) as refused:
        vi.composition(name)
    assert all(known in str(refused.value) for known in NAMES) and repr(name) in str(refused.value)


@pytest.mark.parametrize("spelling", ["Störmer-Verlet", "STÖRMER–VERLET", "leapfrog", " verlet "])
def test_spelling_of_compositions_is_forgiving(spelling):
    assert vi.composition(spelling) is vi.composition("verlet")


@pytest.mark.parametrize(
    "fields, message",
    [
        (dict(nodes=(0.5,), weights=(0.9,), points=(0.0, 1.0)), "weights sum to 0.9"),
        (dict(nodes=(0.5, 0.7), weights=(1.0,), points=(0.0, 1.0)), "2 nodes but 1 weights"),
        (dict(nodes=(0.5,), weights=(1.0,), points=(0.0, 0.5)), "increase from 0 to 1"),
        (dict(nodes=(0.5,), weights=(1.0,), points=(0.0, 0.7, 0.3, 1.0)), "increase from 0 to 1"),
        (dict(nodes=(0.0,), weights=(1.0,), kicks=(1.0,), drifts=(1.0,)), "a kick may be 0"),
        (
            dict(nodes=(0.0, 1.0), weights=(0.5, 0.5), kicks=(0.5, 0.5), drifts=(1.1,)),
            "drifts sum to 1.1",
        ),
        (dict(nodes=(0.5,), weights=(1.0,)), "needs control points"),
    ],
)
def test_inconsistent_rules_are_refused(fields, message):
    with pytest.raises(vi.InputError, match=message):
        vi.Rule("mine", 2, **fields)

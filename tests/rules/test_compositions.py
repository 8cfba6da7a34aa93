"""Composition sequences satisfy their order conditions.

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

PRECISE = Context(prec=60)
NAMES = list(COMPOSITIONS)
GAUSS, LOBATTO = range(1, 17), range(2, 11)
ROUND_OFF = 4e-15  # of sums of ten products of size 1
EVERY_RULE = [*map(vi.gauss, GAUSS), *map(vi.lobatto, LOBATTO), *map(vi.composition, NAMES)]


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

"""Factors of symmetric matrices of a chain: inertia, solutions, what the matrix does not see."""

from __future__ import annotations

import numpy as np
import pytest

from varint.numerics.frontal import Symmetric, factorise


def kkt_chain(steps: int, unknowns: int, rows: int, shared: int, seed: int = 0):
    """[H Aᵀ; A 0] of a chain with some unknowns that all stages share; the stages; how many
    unknowns.
    """
    random = np.random.default_rng(seed)
    x = np.append(np.repeat(np.arange(steps), unknowns), np.full(shared, steps))
    g = np.repeat(np.arange(steps), rows)
    near = np.abs(np.subtract.outer(x, x)) <= 1
    near |= np.add.outer(x == steps, x == steps)
    H = random.normal(size=near.shape) * near
    A = random.normal(size=(len(g), len(x))) * (np.abs(np.subtract.outer(g, x)) <= 1)
    K = np.block([[H + H.T, A.T], [A, np.zeros((len(g), len(g)))]])
    return K, np.append(x, g), len(x)


def factors(K: np.ndarray, stages: np.ndarray):
    i, j = np.nonzero(K)
    return factorise(Symmetric(i, j, K[i, j], len(K)), stages)


@pytest.mark.parametrize("shape", [(30, 3, 2, 2), (12, 5, 2, 0), (1, 5, 2, 1), (40, 4, 3, 3)])
def test_signs_of_the_pivots_are_those_of_the_eigenvalues(shape):
    K, stages, n = kkt_chain(*shape)
    K[:n, :n] += np.eye(n)
    units = 10.0 ** np.random.default_rng(1).uniform(-2, 2, size=len(K))
    K = units[:, None] * K * units
    found = factors(K, stages)
    signs = np.linalg.eigvalsh(K / units[:, None] / units)
    assert (found.positive, found.negative, found.zero) == (
        (signs > 0).sum(),
        (signs < 0).sum(),
        0,
    )
    right = np.random.default_rng(2).normal(size=(len(K), 2))
    x = found.solve(right)
    assert units[:, None] ** -1 * (K @ x - right) == pytest.approx(0, abs=1e-7)


def test_a_long_chain_keeps_its_fronts_small():
    K, stages, _ = kkt_chain(60, 4, 3, 2)
    assert max(len(front.own) + len(front.later) for front in factors(K, stages).fronts) <= 40


def test_a_row_that_is_imposed_twice_is_not_seen_and_the_rest_is_solved():
    K, stages, n = kkt_chain(10, 4, 2, 0)
    K[n + 3], K[:, n + 3] = K[n + 7], K[:, n + 7]
    K[n + 3, n + 3] = K[n + 3, n + 7] = K[n + 7, n + 3] = 0
    stages[n + 3] = stages[n + 7]
    found = factors(K, stages)
    assert found.zero == 1
    x = np.random.default_rng(3).normal(size=(len(K), 1))
    assert K @ found.solve(K @ x) == pytest.approx(K @ x, abs=1e-8)


def test_convex_programs_have_as_many_positive_eigenvalues_as_unknowns():
    K, stages, n = kkt_chain(15, 4, 2, 1)
    A = K[n:, :n]
    basis = np.linalg.svd(A)[2][len(A) :].T
    least = np.linalg.eigvalsh(basis.T @ K[:n, :n] @ basis)[0]
    for shift, convex in ((-least + 1e-6, True), (-least - 1e-6, False)):
        shifted = K + np.diag(np.append(np.full(n, shift), np.zeros(len(A))))
        assert (factors(shifted, stages).positive == n) is convex

"""Eigenvalues of a product of maps, small ones as exactly as large ones."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

APART = 30.0  # ratio of absolute values of multipliers that are parted from each other
MOST_ROUNDS = 60
CONVERGED = 1e-14  # of directions: what is left of the fast ones among the slow ones


def graded_spectrum(maps: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Eigenvalues and eigenvectors of maps[-1] ⋯ maps[0], (M, r, r).

    A frame is carried round the product and made orthonormal after each map, Q_{i+1} R_i = Φ_i Q_i,
    until the fast directions come back among themselves (orthogonal iteration, the periodic QR
    method of Benettin and of Bojanczyk, Golub & Van Dooren). Then the product is block triangular,
    and each block a product of triangular matrices, in which nothing is cancelled: an eigenvalue of
    1e-8 beside one of 1e8 has its own digits.
    """
    r = maps.shape[1]
    if not r:
        return np.zeros(0, dtype=complex), np.zeros((0, 0), dtype=complex)
    # a frame in general position
    frame = np.linalg.qr(np.cos(np.outer(np.arange(1, r + 1), np.sqrt(np.arange(2, r + 2)))))[0]
    for _ in range(MOST_ROUNDS):
        start, whole = frame, np.eye(r)
        growth = np.zeros(r)
        for one in maps:
            frame, triangle = np.linalg.qr(one @ frame)
            whole = triangle @ whole
            growth += np.log(np.maximum(np.abs(np.diag(triangle)), np.finfo(float).tiny))
        turned = start.T @ frame
        cuts = [j for j in range(1, r) if growth[j - 1] - growth[j] > np.log(APART)]
        if all(np.abs(turned[j:, :j]).max() < CONVERGED for j in cuts):
            break
    for j in cuts:
        turned[j:, :j] = turned[:j, j:] = 0.0
    matrix = turned @ whole
    values, vectors = np.zeros(r, dtype=complex), np.zeros((r, r), dtype=complex)
    for a, b in pairwise([0, *cuts, r]):
        found, inner = np.linalg.eig(matrix[a:b, a:b])
        values[a:b] = found
        for j in range(b - a):
            lead = matrix[:a, :a] - found[j] * np.eye(a)
            above = np.linalg.solve(lead, -matrix[:a, a:b] @ inner[:, j]) if a else np.zeros(0)
            whole_vector = start[:, :b] @ np.concatenate([above, inner[:, j]])
            vectors[:, a + j] = whole_vector / np.linalg.norm(whole_vector)
    return values, vectors

"""Which rows add something new: conditions that others imply must not be imposed twice."""

from __future__ import annotations

import numpy as np

DEPENDENT = 1e-8  # part of a row that is new, relative to its length


def independent_rows(given: np.ndarray, candidates: np.ndarray) -> np.ndarray:
    """Greedy choice of the candidate rows that are linearly independent of the given ones and of each other, (m,)."""
    basis = np.linalg.qr(given.T)[0].T if len(given) else np.zeros((0, candidates.shape[1]))
    kept = np.zeros(len(candidates), dtype=bool)
    for i, row in enumerate(candidates):
        size = np.linalg.norm(row)
        new = row - basis.T @ (basis @ row)
        new = new - basis.T @ (basis @ new)  # twice is enough
        kept[i] = size > 0 and np.linalg.norm(new) > DEPENDENT * size
        if kept[i]:
            basis = np.vstack([basis, new / np.linalg.norm(new)])
    return kept

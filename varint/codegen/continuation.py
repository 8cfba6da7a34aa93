"""Start values of Newton's method: the unknowns of the last steps continued over the next one."""

from __future__ import annotations

import numpy as np

from varint.rules.rule import Rule

# steps that start values are continued from, by degree; else 1: more amplifies round-off
HISTORY = {1: 3, 2: 2, 3: 2}


def continuation_tables(rule: Rule, history: int) -> dict[str, np.ndarray]:
    """Coefficients that continue the unknowns of the last 1, 2 … `history` steps over the next one.

    The polynomial through all control points of those steps, in mean velocities (Q_j − q0)/h; the
    one through all multipliers. Start values only: they need no last digits.
    """
    points, degree = np.array(rule.points), rule.degree
    velocities, multipliers, rows = [], [], []
    for known in range(1, history + 1):
        at = np.array([points[j] - s for s in range(1, known + 1) for j in range(degree)])
        path = _lagrange(np.append(at, 0.0), points[1:])
        table = np.zeros((degree, known, degree))
        for s in range(known):
            for j in range(degree):
                weight = path[:, s * degree + j]
                if j:
                    table[:, s, j - 1] += weight
                # where the step begins: behind by the steps in between
                table[:, : s + 1, -1] -= weight[:, None]
        velocities.append(table.ravel())
        multipliers.append(_lagrange(at, points[:-1]).ravel())
        rows.append(_lagrange(-1.0 - np.arange(known), np.zeros(1)).ravel())
    return {
        "AHEAD_VELOCITIES": np.concatenate(velocities),
        "AHEAD_MULTIPLIERS": np.concatenate(multipliers),
        "AHEAD_ROWS": np.concatenate(rows),
    }


def _lagrange(at: np.ndarray, x: np.ndarray) -> np.ndarray:
    """ℓ_k(x_j) of the points `at`, (j, k)."""
    result = np.ones((len(x), len(at)))
    for k, a in enumerate(at):
        for i, b in enumerate(at):
            if i != k:
                result[:, k] *= (x - b) / (a - b)
    return result

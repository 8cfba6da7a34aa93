"""What the data tell: covariance from the information matrix, and directions that they leave
open.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from varint.estimation.gauss_newton import RANK, null_space, told
from varint.estimation.residuals import Residuals

NEGLIGIBLE = 1e-5  # part of an open direction that is none of it


class Information(NamedTuple):
    """Covariance of the unknowns with names (k, k), infinite on the diagonal where the data tell
    nothing, S with S Sᵀ that of all unknowns without those, and the directions that they leave open
    (open, k), relative to the sizes; `swamped`: some that seem open would show by more than σ, but
    for the round-off of others.
    """

    covariance: np.ndarray
    spread: np.ndarray
    open: np.ndarray
    swamped: bool


def information(found: Residuals, size: np.ndarray, held: np.ndarray, many: int) -> Information:
    """From the derivatives of residuals and defects at the solution, in the null space of the
    defects and of the bounds that hold.
    """
    spread, left, swamped = directions(found, size, held)
    covariance = spread[:many] @ spread[:many].T
    open_ones = reduced(left[:, :many])
    blind = (np.abs(open_ones) > 0).any(axis=0) if len(open_ones) else np.zeros(many, dtype=bool)
    covariance[blind, blind] = np.inf
    return Information(covariance, spread, open_ones, swamped)


def directions(
    found: Residuals, size: np.ndarray, held: np.ndarray
) -> tuple[np.ndarray, np.ndarray, bool]:
    """S with covariance S Sᵀ of all unknowns (size, known), directions that the data leave open,
    relative to the sizes (open, size), and whether some of them are round-off of others.
    """
    rows = np.vstack([found.of_d * size, np.eye(len(size))[held]])
    z = null_space(rows)[1] if len(rows) else np.eye(len(size))
    _, s, vt = np.linalg.svd(found.of_r * size @ z, full_matrices=True)
    known = np.zeros(len(vt), dtype=bool)
    known[: len(s)] = told(s, RANK * found.signal)
    spread = size[:, None] * (z @ vt[known].T / s[known[: len(s)]])
    return spread, (z @ vt[~known].T).T, bool((s[~known[: len(s)]] > 1).any())


def reduced(rows: np.ndarray) -> np.ndarray:
    """Rows of the same span with as many zeros as elimination gives, the largest entry ±1."""
    rows = rows.copy()
    done = 0
    while done < len(rows):
        i, j = np.unravel_index(np.abs(rows[done:]).argmax(), rows[done:].shape)
        if abs(rows[done + i, j]) <= NEGLIGIBLE:
            break
        rows[[done, done + i]] = rows[[done + i, done]]
        rows[done] /= rows[done, j]
        others = np.arange(len(rows)) != done
        rows[others] -= np.outer(rows[others, j], rows[done])
        done += 1
    rows = rows[:done]
    rows = rows / np.abs(rows).max(axis=1, keepdims=True, initial=1e-300)
    rows[np.abs(rows) <= NEGLIGIBLE] = 0.0
    return rows

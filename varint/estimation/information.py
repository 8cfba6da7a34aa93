"""What the data tell: covariance from the information matrix, and what they leave open, in
words.
"""

from __future__ import annotations

from typing import NamedTuple

import casadi as ca
import numpy as np

from varint.estimation.gauss_newton import RANK, null_space
from varint.estimation.problem import Estimation
from varint.scene.system import System

NEGLIGIBLE = 1e-5  # part of an open direction that is none of it
SAMPLES = 5  # states at which a direction is tried as a scaling of the Lagrangian
SCALES = 1e-9  # relative: what changes by no more than this is proportional


class Information(NamedTuple):
    """Covariance of the unknowns with names (k, k), infinite on the diagonal where the data tell
    nothing, and the directions that they leave open (open, k), relative to the sizes; `swamped`:
    some that seem open would show by more than σ, but for the round-off of others.
    """

    covariance: np.ndarray
    open: np.ndarray
    swamped: bool


def information(
    r_slope: np.ndarray, d_slope: np.ndarray, size: np.ndarray, held: np.ndarray, many: int
) -> Information:
    """From the derivatives of residuals and defects at the solution, in the null space of the
    defects and of the bounds that hold.
    """
    rows = np.vstack([d_slope * size, np.eye(len(size))[held]])
    z = null_space(rows)[1] if len(rows) else np.eye(len(size))
    _, s, vt = np.linalg.svd(r_slope * size @ z, full_matrices=True)
    known = np.zeros(len(vt), dtype=bool)
    known[: len(s)] = s > RANK * s.max(initial=0.0)
    spread = (z @ vt[known].T / s[known[: len(s)]])[:many]
    covariance = spread @ spread.T * np.outer(size[:many], size[:many])
    left = reduced((z @ vt[~known].T)[:many].T)
    blind = (np.abs(left) > 0).any(axis=0) if len(left) else np.zeros(many, dtype=bool)
    covariance[blind, blind] = np.inf
    return Information(covariance, left, bool((s[~known[: len(s)]] > 1).any()))


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


def in_words(p: Estimation, open_directions: np.ndarray, theta: np.ndarray) -> tuple[str, ...]:
    """A sentence for each direction that the data leave open."""
    found = []
    for row in open_directions:
        names = [p.names[i] for i in np.flatnonzero(row)]
        why = _why(p, row, theta)
        if len(names) == 1:
            found.append(f"{names[0]} does not show in the data{why}")
            continue
        parts = [f"{name} by {row[i]:+.3g}" for i, name in enumerate(p.names) if row[i]]
        found.append(
            f"{', '.join(names[:-1])} and {names[-1]} are not told apart: the data stay as they "
            f"are when {', '.join(parts)} of themselves change together{why}"
        )
    return tuple(found)


def _why(p: Estimation, row: np.ndarray, theta: np.ndarray) -> str:
    """The symmetry behind an open direction, where it is the scale of the Lagrangian."""
    many = len(p.theta)
    if row[many:].any() or p.system.structure.forced or not scales_lagrangian(p, row[:many], theta):
        return ""
    return " (they multiply the Lagrangian as a whole, which leaves the motion as it is)"


def scales_lagrangian(p: Estimation, row: np.ndarray, theta: np.ndarray) -> bool:
    """Whether Σ row_j θ_j ∂L/∂θ_j = κ L with a number κ ≠ 0, at random states."""
    s: System = p.system
    direction = np.zeros(len(p.c))
    direction[p.theta] = row * theta
    change = ca.dot(ca.gradient(s.lagrangian, s.c), ca.DM(direction))
    f = ca.Function("scaled", [s.q, s.v, s.t, s.c], [s.lagrangian, change])
    c, rng = p.c.copy(), np.random.default_rng(0)
    c[p.theta] = theta
    n = s.structure.n
    states = rng.uniform(-1, 1, (SAMPLES, 2, n))
    pairs = np.array([[float(x) for x in f(q, v, 0.3, c)] for q, v in states])
    lagrangian, changed = pairs.T
    kappa = changed @ lagrangian / (lagrangian @ lagrangian)
    return bool(
        abs(kappa) > SCALES and np.abs(changed - kappa * lagrangian).max() < SCALES * abs(kappa)
    )

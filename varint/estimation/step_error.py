"""What the error of a step does to estimates: how far steps of half the size would move them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from varint.errors import ConvergenceError
from varint.estimation.problem import Estimation, Motion
from varint.estimation.residuals import residuals
from varint.estimation.search import Minimum, sizes
from varint.rules.polynomials import lagrange_values

SHOWS = 0.1  # of a standard deviation: shifts by more are told


def shift_by_half_steps(minimum: Minimum, spread: np.ndarray) -> np.ndarray:
    """How far the estimates would move with half the step, (k,), to first order: by the
    Gauss–Newton step from the residuals r' and defects d' that half the step leaves at the fit,

        min |J δ + r' − r|  with  D δ + d' − d = 0.

    `spread` S gives the covariance S Sᵀ of all unknowns along D δ = 0. NaN where a half step cannot
    be solved.
    """
    shoot, solved = minimum.shoot, minimum.solved
    p, z, found = shoot.problem, solved.z, solved.found
    try:
        finer = residuals(replace(shoot, problem=with_half_steps(p)), z)
    except ConvergenceError:
        return np.full(p.many, np.nan)
    size, held = sizes(p, z), np.eye(len(z))[solved.held]
    rows = np.vstack([found.of_d * size, held])
    gap = np.concatenate([finer.d - found.d, np.zeros(len(held))])
    closing = -size * np.linalg.lstsq(rows, gap, rcond=None)[0] if len(rows) else np.zeros(len(z))
    left = found.of_r @ closing + finer.r - found.r
    if minimum.huber is not None:  # beyond it the slope of the loss does not change
        left = np.where(np.abs(found.r) <= minimum.huber, left, 0.0)
    moved = closing - spread @ (spread.T @ (found.of_r.T @ left))
    return moved[: p.many]


def with_half_steps(p: Estimation) -> Estimation:
    """The same problem on a grid with twice the steps."""
    return p._replace(h=p.h / 2, motions=tuple(_halved(p, m) for m in p.motions))


def _halved(p: Estimation, m: Motion) -> Motion:
    """Controls held over a step are held over both halves; of several a step the polynomial goes
    on.
    """
    steps, r, k = m.u.shape
    u = np.repeat(m.u, 2, axis=0)
    if k and r > 1:
        nodes = np.array(p.rule.nodes)
        halves = lagrange_values(nodes, np.concatenate([nodes, 1 + nodes]) / 2)
        u = (halves @ m.u).reshape(2 * steps, r, k)
    return m._replace(steps=2 * steps, cuts=2 * m.cuts, u=np.ascontiguousarray(u))


def moved_in_words(names: Sequence[str], shift: np.ndarray, sigma: np.ndarray) -> str:
    """A sentence on those that move by more than `SHOWS` of their standard deviations; "" where
    none does.
    """
    with np.errstate(invalid="ignore", divide="ignore"):
        parts = np.abs(shift) / sigma
    there = [i for i in np.argsort(-parts).tolist() if parts[i] > SHOWS]
    if not there:
        return ""
    moves = ", ".join(f"{names[i]} by {shift[i]:+.2g} ({parts[i]:.2g} σ)" for i in there[:4])
    more = f" and {len(there) - 4} more" if len(there) > 4 else ""
    return (
        f"the step's own error moves the estimates: half of h would change {moves}{more}; take a "
        "smaller h or a rule of higher order"
    )

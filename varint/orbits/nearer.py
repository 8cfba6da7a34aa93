"""From a guess that Newton's method makes nothing of to one near an orbit: the gaps made small by
Levenberg's and Marquardt's method.
"""

from __future__ import annotations

import numpy as np

from varint.errors import ConvergenceError
from varint.orbits.correct import Wanted, bordered, moved
from varint.orbits.shooting import Iterate, gaps, is_finite, linearise, runs
from varint.sensitivities.pieces import Piece

CLOSE = 1e-3  # in units: gaps that Newton's method closes
MOST_STEPS = 40
DAMPING, WEAKER, STRONGER = 1e-2, 0.2, 5.0  # of the largest singular value squared, and its changes
WEAKEST, STRONGEST = 1e-12, 1e6
LEAST = 1e-2  # relative gain of a step: less is a minimum that is no orbit


def nearer(wanted: Wanted, at: Iterate) -> Iterate:
    """An iterate with gaps as small as they become: (JᵀJ + λ) δ = −Jᵀr with r the gaps and what
    else is wanted.

    Steps along what is conserved make no difference, so that the integrals need no unfolding here,
    and every step of a large enough λ is shorter than what the linearisation is good for.
    """
    shooting, units, damping = wanted.shooting, wanted.units, DAMPING
    pieces = runs(shooting, at)
    left, slow = _left(wanted, at, pieces), 0
    for _ in range(MOST_STEPS):
        if left <= CLOSE or slow > 2:
            break
        linear = linearise(shooting, at, pieces, units, wanted.index)
        links = bordered(wanted, at, linear)
        matrix, right = links.matrix, links.whole_right
        many = linear.by_period.size + 2
        outward, values, across = np.linalg.svd(matrix[:, :many], full_matrices=False)
        parts, unit = outward.T @ right, values[0] ** 2
        while damping <= STRONGEST:
            step = across.T @ (values * parts / (values**2 + damping * unit))
            trial = moved(wanted, at, linear, step)
            found = _run(wanted, trial)
            after = np.inf if found is None else _left(wanted, trial, found)
            if found is not None and after < left:
                slow = slow + 1 if after > (1 - LEAST) * left else 0
                at, pieces, left = trial, found, after
                damping = max(damping * WEAKER, WEAKEST)
                break
            damping *= STRONGER
        else:
            break
    return at


def _run(wanted: Wanted, at: Iterate) -> list[Piece] | None:
    """The segments, where they can be run."""
    if not is_finite(at) or at.period <= 0:
        return None
    try:
        found = runs(wanted.shooting, at)
    except ConvergenceError:
        return None
    return found if all(np.isfinite(piece.x).all() for piece in found) else None


def _left(wanted: Wanted, at: Iterate, pieces: list[Piece]) -> float:
    """The norm of what is left."""
    missing = [row.missing for row in wanted.rows(at, None)]
    return float(
        np.linalg.norm(np.append(gaps(wanted.shooting, at, pieces, wanted.units), missing))
    )

"""Reduction of a linear flow by what it conserves, and signatures of its modes."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

INVOLUTION = 1e-7  # combinations of integrals whose brackets with all others vanish
TWISTED = 1e-6  # changes of phase with the value of an integral, in scaled coordinates


class Reduced(NamedTuple):
    """A linear map or flow where all integrals have the value of the orbit, without the directions
    that they generate.

    Attributes
    ----------
    basis : ndarray (d, r)
        Orthonormal, of the level set across its symmetry directions.
    matrix : ndarray (r, r)
        The map there.
    form : ndarray (r, r)
        The symplectic form there.
    """

    basis: np.ndarray
    matrix: np.ndarray
    form: np.ndarray


def reduce(
    matrix: np.ndarray, form: np.ndarray, gradients: np.ndarray, directions: np.ndarray
) -> Reduced:
    """The map on W/(V ∩ W), W = ker dJ of independent rows dJ and V the directions that the
    integrals generate.

    `matrix` maps W and V to themselves, so that its other eigenvalues, those of V and of what is
    dual to it, are split off without a tolerance: they are known (Marsden & Weinstein, Reports on
    Mathematical Physics 5 (1974) 121).
    """
    level = np.eye(len(matrix))
    if len(gradients):
        level = np.linalg.svd(gradients)[2][len(gradients) :].T
    if len(directions):
        _, size, right = np.linalg.svd(gradients @ directions.T)
        rank = int((size > INVOLUTION).sum())
        radical = directions.T @ right[rank:].T
        inside = level.T @ radical
        values, turned = np.linalg.svd(inside)[1::-1]
        level = level @ turned[:, int((values > INVOLUTION).sum()) :]
    return Reduced(level, level.T @ matrix @ level, level.T @ form @ level)


def twists(
    matrix: np.ndarray, reduced: Reduced, gradients: np.ndarray, directions: np.ndarray
) -> int:
    """Jordan blocks of size 2 of the multiplier 1 that the integrals make: the rank of the matrix
    of changes of their phases with their values.
    """
    if not len(gradients) or not len(directions):
        return 0
    change, across = matrix - np.eye(len(matrix)), gradients.T
    inner = reduced.matrix - np.eye(len(reduced.matrix))
    if len(inner):
        moved = reduced.basis.T @ change @ across
        across = across - reduced.basis @ np.linalg.lstsq(inner, moved, rcond=1e-9)[0]
    found = np.linalg.lstsq(directions.T, change @ across, rcond=1e-9)[0]
    size = np.linalg.svd(found, compute_uv=False)
    return int((size > TWISTED * max(float(size[0]), 1.0)).sum())


def signature(form: np.ndarray, vectors: np.ndarray) -> int:
    """Krein's signature of the eigenvectors (r, k) of one eigenvalue on the unit circle, or on the
    imaginary axis: that of −i uᴴΩu, +1 where e^{+iωt} has positive energy; 0 where it is mixed.
    """
    values = np.linalg.eigvalsh(-1j * vectors.conj().T @ form @ vectors)
    if (values > 0).all():
        return 1
    return -1 if (values < 0).all() else 0

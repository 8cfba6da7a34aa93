"""Piecewise polynomials on a mesh: paths and controls between the points where they are stored."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from varint.rules.polynomials import lagrange_values


@dataclass(frozen=True, eq=False)
class Piecewise:
    """On step k the polynomial through `values[k]` at the fractions `points` of the step.

    Attributes
    ----------
    mesh : ndarray (N + 1,)
        Ends of the steps, from 0 to 1.
    points : ndarray (d,)
        Places in a step, in [0, 1].
    values : ndarray (N, d, n)
    """

    mesh: np.ndarray
    points: np.ndarray
    values: np.ndarray

    def __call__(self, at: np.ndarray) -> np.ndarray:
        """Values at fractions of the whole, (M,) → (M, n)."""
        k = np.clip(np.searchsorted(self.mesh, at, side="right") - 1, 0, len(self.mesh) - 2)
        local = (at - self.mesh[k]) / (self.mesh[k + 1] - self.mesh[k])
        return np.einsum("md,mdn->mn", lagrange_values(self.points, local), self.values[k])

    def within_steps(self, local: np.ndarray) -> np.ndarray:
        """Values at the fractions `local` (m,) of every step, (N, m, n)."""
        return np.einsum("md,kdn->kmn", lagrange_values(self.points, local), self.values)

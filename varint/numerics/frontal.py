"""Symmetric indefinite matrices of a chain: factors, inertia and solutions, stage by stage.

The frontal method (Irons, Int. J. Numer. Methods Eng. 2 (1970) 5–32) with delayed pivots (Duff &
Reid, ACM TOMS 9 (1983) 302–325): what is complete at a stage is turned into its eigenvectors; those
whose eigenvalue outweighs their coupling to what comes later are eliminated, the others wait. Every
step is a congruence, so that by Sylvester's law the signs of the pivots are those of the matrix.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

THRESHOLD = 0.05  # of its coupling: an eigenvalue that is less waits for a later stage
ZERO = 1e-13  # of the largest entry: an eigenvalue that is less is none
PASSES = 4  # of equilibration
REFINEMENTS = 2


@dataclass(frozen=True, eq=False)
class Symmetric:
    """A symmetric matrix by the entries of both of its halves."""

    rows: np.ndarray
    columns: np.ndarray
    values: np.ndarray
    size: int

    def __matmul__(self, x: np.ndarray) -> np.ndarray:
        """Matrix times columns, (size, k)."""
        found = np.zeros(x.shape)
        np.add.at(found, self.rows, self.values[:, None] * x[self.columns])
        return found


@dataclass(frozen=True, eq=False)
class Front:
    """A stage of the elimination.

    Attributes
    ----------
    own, later : ndarray of int
        Places of what is complete, and of what it is coupled to.
    vectors : ndarray (own, own)
        Eigenvectors, those that wait first; they take the first places of `own`.
    values, coupling : ndarray (p,), (p, later)
        Of the others: eigenvalues, and coupling to what comes later.
    """

    own: np.ndarray
    later: np.ndarray
    vectors: np.ndarray
    values: np.ndarray
    coupling: np.ndarray


@dataclass(frozen=True, eq=False)
class Factors:
    """Factors of a symmetric matrix, and its inertia: the signs of its eigenvalues."""

    matrix: Symmetric
    scale: np.ndarray
    order: np.ndarray
    fronts: tuple[Front, ...]

    @property
    def positive(self) -> int:
        """Number of positive eigenvalues."""
        return sum(int((front.values > 0).sum()) for front in self.fronts)

    @property
    def negative(self) -> int:
        """Number of negative eigenvalues."""
        return sum(int((front.values < 0).sum()) for front in self.fronts)

    @property
    def zero(self) -> int:
        """Number of eigenvalues that are none to round-off."""
        return self.matrix.size - self.positive - self.negative

    def solve(self, right: np.ndarray) -> np.ndarray:
        """x with K x = right, (size, k), refined; without a part along directions that the matrix
        does not see.
        """
        x = self.substitute(right)
        for _ in range(REFINEMENTS):
            x = x + self.substitute(right - self.matrix @ x)
        return x

    def substitute(self, right: np.ndarray) -> np.ndarray:
        """The same as it comes."""
        b = (right * self.scale[:, None])[self.order]
        for front in self.fronts:
            b[front.own] = front.vectors.T @ b[front.own]
            mine = b[front.own[len(front.own) - len(front.values) :]]
            b[front.later] -= front.coupling.T @ (mine / front.values[:, None])
        for front in reversed(self.fronts):
            waited = len(front.own) - len(front.values)
            places = front.own[waited:]
            b[places] = (b[places] - front.coupling @ b[front.later]) / front.values[:, None]
            b[front.own] = front.vectors @ b[front.own]
        x = np.empty_like(b)
        x[self.order] = b
        return x * self.scale[:, None]


def factorise(matrix: Symmetric, stage: np.ndarray) -> Factors:
    """Factors of a matrix whose unknowns belong to stages 0, 1, …, most of them coupled to their
    neighbours only.

    Parameters
    ----------
    matrix : Symmetric
    stage : ndarray of int (size,)
    """
    scale = _equilibration(matrix)
    order = np.argsort(stage, kind="stable")
    place = np.argsort(order)
    a, b = place[matrix.rows], place[matrix.columns]
    values = matrix.values * scale[matrix.rows] * scale[matrix.columns]
    once = np.flatnonzero(a <= b)
    once = once[np.argsort(a[once], kind="stable")]
    a, b, values = a[once], b[once], values[once]
    ends = np.append(np.flatnonzero(np.diff(stage[order])) + 1, matrix.size)
    entries = np.searchsorted(a, ends)
    at = np.zeros(matrix.size, dtype=int)
    waiting = later = np.zeros(0, dtype=int)
    carried, fronts, begin, first = np.zeros((0, 0)), [], 0, 0
    for end, last in zip(ends.tolist(), entries.tolist(), strict=True):
        i, j, value = a[first:last], b[first:last], values[first:last]
        own = np.concatenate([waiting, np.arange(begin, end)])
        before = np.concatenate([waiting, later])
        later = np.union1d(later[later >= end], j[j >= end])
        at[own], at[later] = np.arange(len(own)), len(own) + np.arange(len(later))
        front = np.zeros((len(own) + len(later),) * 2)
        old = at[before]
        front[old[:, None], old] = carried
        np.add.at(front, (at[i], at[j]), value)
        off = i != j
        np.add.at(front, (at[j[off]], at[i[off]]), value[off])
        made, carried = _eliminate(own, later, front)
        fronts.append(made)
        waiting = own[: len(own) - len(made.values)]
        begin, first = end, last
    return Factors(matrix, scale, order, tuple(fronts))


def _eliminate(own: np.ndarray, later: np.ndarray, front: np.ndarray) -> tuple[Front, np.ndarray]:
    """The front without what can be eliminated, and how."""
    n = len(own)
    values, vectors = np.linalg.eigh(front[:n, :n])
    coupling = vectors.T @ front[:n, n:]
    reach = np.linalg.norm(coupling, axis=1)
    goes = np.abs(values) > np.maximum(THRESHOLD * reach, ZERO)
    stays = ~goes
    gone, kept = coupling[goes], coupling[stays]
    rest = front[n:, n:] - gone.T @ (gone / values[goes, None])
    carried = np.block([[np.diag(values[stays]), kept], [kept.T, rest]])
    vectors = np.hstack([vectors[:, stays], vectors[:, goes]])
    return Front(own, later, vectors, values[goes], gone), carried


def _equilibration(matrix: Symmetric) -> np.ndarray:
    """Factors d with the largest entries of every row of D K D near one (Ruiz 2001)."""
    scale = np.ones(matrix.size)
    for _ in range(PASSES):
        largest = np.zeros(matrix.size)
        size = np.abs(matrix.values) * scale[matrix.rows] * scale[matrix.columns]
        np.maximum.at(largest, matrix.rows, size)
        scale /= np.sqrt(np.where(largest > 0, largest, 1.0))
    return scale

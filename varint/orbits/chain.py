"""A closed chain of segments with a border of few rows and columns, solved segment by segment."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from varint.orbits.phase import independent


class Links(NamedTuple):
    """Rows A_i ξ_i + B_i ξ_{i+1} + C_i y = r_i of a chain, ξ_M = ξ_0, and rows across all of it,
    Σ_i D_i ξ_i + E y = s.

    Attributes
    ----------
    here, ahead : ndarray (M, d, d)
        A and B.
    aside : ndarray (M, d, b)
        C.
    right : ndarray (M, d)
        r.
    across : ndarray (k, M, d)
        D.
    corner : ndarray (k, b)
        E.
    below : ndarray (k,)
        s.
    """

    here: np.ndarray
    ahead: np.ndarray
    aside: np.ndarray
    right: np.ndarray
    across: np.ndarray
    corner: np.ndarray
    below: np.ndarray

    @property
    def matrix(self) -> np.ndarray:
        """All rows as one matrix, columns ξ_0 … ξ_{M−1}, y."""
        m, d, b = self.aside.shape
        whole = np.zeros((m * d + len(self.across), m * d + b))
        for i in range(m):
            rows, following = slice(i * d, (i + 1) * d), (i + 1) % m
            whole[rows, rows] += self.here[i]
            whole[rows, following * d : (following + 1) * d] += self.ahead[i]
            whole[rows, m * d :] = self.aside[i]
        whole[m * d :, : m * d] = self.across.reshape(len(self.across), m * d)
        whole[m * d :, m * d :] = self.corner
        return whole

    @property
    def whole_right(self) -> np.ndarray:
        """All right-hand sides."""
        return np.append(self.right.ravel(), self.below)


class Inner(NamedTuple):
    """ξ_i = r − U ξ_0 − V ξ_{i+1} − W y."""

    u: np.ndarray
    v: np.ndarray
    w: np.ndarray
    r: np.ndarray


@dataclass(frozen=True, eq=False)
class Condensed:
    """A chain without its inner segments.

    Attributes
    ----------
    matrix : ndarray (d + k, d + b)
        Of what is left, columns ξ_0, y.
    right : ndarray (d + k,)
    inner : tuple of Inner
        What tells ξ_1 … ξ_{M−1}.
    """

    matrix: np.ndarray
    right: np.ndarray
    inner: tuple[Inner, ...]

    @cached_property
    def parts(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The singular value decomposition of what is left."""
        return np.linalg.svd(self.matrix)

    def spread(self, y: np.ndarray, times: float) -> np.ndarray:
        """Unknowns of the whole chain from those that are left, with the right-hand sides of the
        inner segments so many times: once, or not at all for the homogeneous equations.
        """
        d = len(self.inner[0].r) if self.inner else 0
        ahead, found = y[:d], []
        for one in reversed(self.inner):
            ahead = times * one.r - one.u @ y[:d] - one.v @ ahead - one.w @ y[d:]
            found.append(ahead)
        return np.concatenate([y[:d], *reversed(found), y[d:]])

    def null(self, count: int) -> np.ndarray:
        """As many null vectors as told, those of the smallest singular values, orthonormal
        (count, M d + b).
        """
        across = self.parts[2]
        found = [self.spread(row, 0.0) for row in across[len(across) - count :]]
        return independent(np.array(found)) if found else np.zeros((0, 1))

    def least(self, rank: int) -> np.ndarray:
        """The least solution where only `rank` singular values count."""
        left, values, across = self.parts
        y = across[:rank].T @ ((left.T @ self.right)[:rank] / values[:rank])
        whole, surplus = self.spread(y, 1.0), len(across) - rank
        if not surplus:
            return whole
        null = self.null(surplus)
        return whole - null.T @ (null @ whole)


def condensed(links: Links) -> Condensed:
    """A chain whose inner segments are eliminated one after another, by orthogonal transformations
    of the rows of two segments: stable where segments grow as where they shrink (Wright, SIAM J.
    Sci. Stat. Comput. 13 (1992) 742), and in matrices so small that BLAS takes no threads for them.
    """
    m, d, b = links.aside.shape
    parts = (links.here, links.ahead, links.aside)
    size = np.maximum(np.sqrt(sum((x**2).sum(axis=2) for x in parts)), 1.0)
    here, ahead, aside = (x / size[:, :, None] for x in parts)
    right = links.right / size
    size = np.sqrt((links.across**2).sum(axis=(1, 2)) + (links.corner**2).sum(axis=1))
    size = np.maximum(size, 1.0)
    across, corner = links.across / size[:, None, None], links.corner / size[:, None]
    first, following, below = across[:, 0], across[:, 1 % m], links.below / size
    # rows that are left: begin · ξ_0 + end · ξ_i + side · y = rest
    begin, end, side, rest = here[0], ahead[0], aside[0], right[0]
    inner = []
    for i in range(1, m):
        turn, upper = np.linalg.qr(np.vstack([end, here[i]]), mode="complete")
        columns = np.zeros((2 * d, 2 * d + b + 1))
        columns[:d, :d], columns[d:, d : 2 * d] = begin, ahead[i]
        columns[:d, 2 * d : -1], columns[d:, 2 * d : -1] = side, aside[i]
        columns[:d, -1], columns[d:, -1] = rest, right[i]
        turned = turn.T @ columns
        own = np.linalg.solve(upper[:d], turned[:d])
        one = Inner(own[:, :d], own[:, d : 2 * d], own[:, 2 * d : -1], own[:, -1])
        inner.append(one)
        begin, end = turned[d:, :d], turned[d:, d : 2 * d]
        side, rest = turned[d:, 2 * d : -1], turned[d:, -1]
        first, corner = first - following @ one.u, corner - following @ one.w
        below, carried = below - following @ one.r, following @ one.v
        if i + 1 < m:
            following = across[:, i + 1] - carried
        else:
            first = first - carried
    matrix = np.block([[begin + end, side], [first, corner]])
    # rows across have grown with what they went through; those next to zero are left so, for they
    # tell null vectors
    size = np.maximum(np.linalg.norm(matrix, axis=1), 1.0)
    return Condensed(matrix / size[:, None], np.append(rest, below) / size, tuple(inner))

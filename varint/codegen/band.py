"""Orderings that make sparse matrices banded, so that factorising them costs no more than their
neighbours demand.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

VECTOR = 8  # numbers that are worked on together
NARROW = 10  # bands up to this reach are worked on one by one


@dataclass(frozen=True)
class Band:
    """A square matrix with rows and columns in another order: element k of its nonzeros lies at
    `places[k]` of a band.

    Attributes
    ----------
    order : array (n,)
        Row (and column) order[i] comes i-th.
    below, above : int
        Diagonals below and above the main one.
    places : array
        i (below + reach) + below + j for element (i, j).
    reach : int
        Elements right of the diagonal that a row has room for: below + above for row exchanges, in
        whole vectors.
    """

    order: np.ndarray
    below: int
    above: int
    places: np.ndarray
    reach: int

    @property
    def size(self) -> int:
        """Numbers that the band takes, with its room for row exchanges and the zeros behind its
        end.
        """
        return (len(self.order) + self.below + 1) * (self.below + self.reach + 1)


def band(pattern: ca.Sparsity) -> Band:
    """The band of a matrix ordered by Cuthill & McKee (1969), reversed; blocks that nothing
    couples stay apart.
    """
    rows, columns = (np.array(x, dtype=int) for x in pattern.get_triplet())
    order = _cuthill_mckee(pattern.size1(), rows, columns)[::-1]
    place = np.empty_like(order)
    place[order] = np.arange(len(order))
    i, j = place[rows], place[columns]
    below, above = int(max((i - j).max(initial=0), 0)), int(max((j - i).max(initial=0), 0))
    reach = below + above
    if reach > NARROW:
        reach = -(-reach // VECTOR) * VECTOR
    return Band(order, below, above, i * (below + reach) + below + j, reach)


def _cuthill_mckee(n: int, rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
    neighbours: list[set[int]] = [set() for _ in range(n)]
    for i, j in zip(rows.tolist(), columns.tolist(), strict=True):
        if i != j:
            neighbours[i].add(j)
            neighbours[j].add(i)
    seen, result = [False] * n, []
    for start in sorted(range(n), key=lambda i: len(neighbours[i])):
        if seen[start]:
            continue
        component = _layers(_far(start, neighbours), neighbours)
        for i in component:
            seen[i] = True
        result += component
    return np.array(result, dtype=int)


def _far(start: int, neighbours: list[set[int]]) -> int:
    """A node at the end of its component: as far from the others as one finds by walking to the
    last layer.
    """
    for _ in range(4):
        start = _layers(start, neighbours)[-1]
    return start


def _layers(start: int, neighbours: list[set[int]]) -> list[int]:
    """The component of `start`, breadth first, nodes with few neighbours first."""
    order, seen = [start], {start}
    for i in order:
        following = sorted(neighbours[i] - seen, key=lambda j: (len(neighbours[j]), j))
        seen.update(following)
        order += following
    return order

"""Which generators to list: rotations of all particles first, without those that follow from
momenta and boosts.

Where total momentum P and boost G = P t − M X are conserved, so is X × P: the motion of the centre
of mass turns on its own. Its generator is a point symmetry, but its quantity (G × P)/M is a
function of the others and says nothing new.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from varint.symmetry.naming import Particles
from varint.symmetry.sampling import Region, sample
from varint.symmetry.search import Pairs, euler_function

# relative: a vector this close to the null space, which has rounding errors, lies in it
SAME = 1e-5


def list_independent(
    region: Region,
    groups: Sequence[Pairs],
    rows: np.ndarray,
    size: np.ndarray,
    bodies: Particles,
    rng,
) -> tuple[np.ndarray, np.ndarray, int]:
    """(rotations of all particles alike, numbers of the other rows to list, how many rows follow
    from the others).

    Subspaces are compared in the units `size` of the unknowns, in which they are of like size.
    """
    n = region.system.structure.n
    linear = np.abs(rows[:, 1 : -2 * n]).max(axis=1, initial=0.0) > 0
    several = len(bodies.index) > 1 and len(groups) == n * n
    follow = products(region, rows[~linear], n, rng) if several else []
    lengths = [np.linalg.norm(x / size) for x in follow]
    follow = [x / length for x, length in zip(follow, lengths, strict=True) if length > 0]
    rows = rows / size
    turns = inside(rows, [x / size for x in _rotations(groups, n, bodies)])
    known = [*turns, *inside(rows, [x / size for x in follow])]
    kept = [int(i) for i in np.flatnonzero(~linear)]
    span = orthonormal(np.array(known).reshape(len(known), rows.shape[1]))
    for i in np.flatnonzero(linear):
        rest = rows[i] - span.T @ (span @ rows[i])
        rest -= span.T @ (span @ rest)
        if np.linalg.norm(rest) > SAME * np.linalg.norm(rows[i]):
            kept.append(int(i))
            span = np.vstack([span, rest / np.linalg.norm(rest)])
    return turns * size, np.array(sorted(kept), dtype=int), len(rows) - len(kept) - len(turns)


def _rotations(groups: Sequence[Pairs], n: int, bodies: Particles) -> list[np.ndarray]:
    """Rotations of all particles about x, y and z through the origin."""
    if {i for body in bodies.index for i in body.values()} != set(range(n)):
        return []
    column = {
        (i, j): k
        for k, (rows, cols) in enumerate(groups, 1)
        for i, j in zip(rows, cols, strict=True)
    }
    vectors = []
    for a, b in (("y", "z"), ("z", "x"), ("x", "y")):
        vector = np.zeros(1 + len(groups) + 2 * n)
        for body in bodies.index:
            if a in body and b in body:
                vector[column[body[b], body[a]]], vector[column[body[a], body[b]]] = 1.0, -1.0
        if vector.any() and all(a in body and b in body for body in bodies.index):
            vectors.append(vector)
    return vectors


def products(region: Region, rows: np.ndarray, n: int, rng) -> list[np.ndarray]:
    """Generators β₁ k₂ᵀ − β₂ k₁ᵀ of P₁ G₂ − P₂ G₁ for boosts along β with K = k·q."""
    only_boost = (
        (np.abs(rows[:, :-n]).max(axis=1, initial=0.0) == 0)
        if len(rows)
        else np.zeros(0, dtype=bool)
    )
    boosts = rows[only_boost, -n:]
    points, values = sample(region, euler_function(region.system), 4, rng)
    mass = values[3].reshape(len(points), n, n)
    slopes = mass @ boosts.T
    constant = np.ptp(slopes, axis=0).max(axis=0, initial=0.0) <= SAME * np.abs(slopes).max(
        initial=1e-300
    )
    pairs = [(beta, k) for beta, k, same in zip(boosts, slopes[0].T, constant, strict=True) if same]
    return [
        np.concatenate([[0.0], (np.outer(b1, k2) - np.outer(b2, k1)).ravel(), np.zeros(2 * n)])
        for (b1, k1), (b2, k2) in combinations(pairs, 2)
    ]


def inside(rows: np.ndarray, vectors: list[np.ndarray]) -> np.ndarray:
    """Those of the vectors that lie in the span of the rows."""
    span = orthonormal(rows)
    found = [
        x for x in vectors if np.linalg.norm(x - span.T @ (span @ x)) <= SAME * np.linalg.norm(x)
    ]
    return np.array(found).reshape(len(found), rows.shape[1])


def orthonormal(rows: np.ndarray) -> np.ndarray:
    """Orthonormal basis of the span of the rows, as rows."""
    if not rows.size:
        return rows
    _, values, vectors = np.linalg.svd(rows, full_matrices=False)
    return vectors[values > SAME * values[0]]

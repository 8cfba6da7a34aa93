"""Which combinations of generators forces, constraints and contacts share: what must vanish for
that, and its kernel.

A combination of symmetries that are each broken may be kept: a bead on a slope keeps the
translation along it.
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np

from varint.numerics.arrays import over_columns
from varint.scene.restitution import loses_energy
from varint.symmetry.sampling import Points, Region, at_points, sample
from varint.symmetry.search import Pairs
from varint.symmetry.verify import project_onto_surface

SHARED = 1e-9  # relative: what is left of the conditions by a combination that is shared
POINTS = 30  # more than combinations


def conditions_kernel(
    region: Region, groups: Sequence[Pairs], vectors: np.ndarray, rng
) -> np.ndarray:
    """Combinations (columns) of the generators `vectors` (unknowns, r) that all of the scene
    shares, (r, k).
    """
    rows = conditions(region, groups, vectors, rng)
    if not len(rows):
        return np.eye(vectors.shape[1])
    _, values, combinations = np.linalg.svd(np.linalg.qr(rows, mode="r"), full_matrices=True)
    values = np.append(values, np.zeros(vectors.shape[1] - len(values)))
    return combinations[values <= SHARED * max(values[0], 1.0)].T


def conditions(region: Region, groups: Sequence[Pairs], vectors: np.ndarray, rng) -> np.ndarray:
    """What vanishes for generators that are shared, at random points, relative to its terms; one
    column a generator.

    Work F·(ξ + τ v) of forces, A ξ of non-holonomic rows, ∂g/∂q ξ − τ ∂g/∂t of constraints and
    contacts where they hold; τ where impacts lose energy.
    """
    s, structure = region.system, region.system.structure
    count = vectors.shape[1] + POINTS
    parts = [np.empty((0, vectors.shape[1]))]
    if structure.forced:
        points, (force,) = sample(region, at_points(s, "force", [s.force]), count, rng)
        xi = _fields(groups, points, vectors) + vectors[0] * points.v[:, :, None]
        parts.append(_relative(force[:, None, :], xi))
    if structure.nonholonomic:
        points, (flat,) = sample(region, at_points(s, "rows", [s.nonholonomic]), count, rng)
        parts.append(_relative(_matrices(flat, s.structure.n), _fields(groups, points, vectors)))
    surfaces = ([s.constraint] if structure.constraints else []) + ca.vertsplit(s.contact)[
        : structure.contacts
    ]
    for surface in surfaces:
        slopes = [surface, ca.jacobian(surface, s.q), ca.jacobian(surface, s.t)]
        function = at_points(s, "surface", slopes)
        points, _ = sample(region, function, count, rng)
        held = project_onto_surface(points, function, surface.numel())
        _, slope, by_t = over_columns(function, *held.columns)
        xi = np.concatenate(
            [_fields(groups, held, vectors), np.tile(-vectors[0], (len(held), 1, 1))], axis=1
        )
        rows = np.concatenate([_matrices(slope, s.structure.n), by_t[:, :, None]], axis=2)
        parts.append(_relative(rows, xi))
    if structure.contacts and loses_energy(s):
        parts.append(vectors[:1])
    return np.concatenate(parts)


def _fields(groups: Sequence[Pairs], points: Points, vectors: np.ndarray) -> np.ndarray:
    """ξ of every generator at every point, (N, n, r)."""
    n = points.q.shape[1]
    xi = vectors[-2 * n : -n] + points.t[:, :, None] * vectors[-n:]
    for column, (i, j) in enumerate(groups, start=1):
        xi[:, i] += points.q[:, j, None] * vectors[column]
    return xi


def _matrices(flat: np.ndarray, columns: int) -> np.ndarray:
    """(N, m, columns) of matrices stored column by column."""
    return flat.reshape(len(flat), columns, -1).transpose(0, 2, 1)


def _relative(rows: np.ndarray, xi: np.ndarray) -> np.ndarray:
    """rows · ξ at every point, divided by the largest sum of its terms, (N m, r)."""
    size = (np.abs(rows) @ np.abs(xi)).max(axis=2, keepdims=True)
    return ((rows @ xi) / np.where(size > 0, size, 1.0)).reshape(-1, xi.shape[2])

"""Is a start on the constraint manifold, are its rows independent, and does it determine a
motion?
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence

import casadi as ca
import numpy as np

from varint.discrete.constraints import ActiveSet, position_rows
from varint.discrete.inertia import check_inertia, inertia_roots, mass_at
from varint.discrete.projection import (
    OFF,
    project_configuration,
    row_sizes,
    velocity_gaps,
)
from varint.errors import InputError
from varint.scene.system import System

RANK = 1e-9  # smallest singular value of the equilibrated rows of independent constraints
# how far to look for a better-conditioned neighbour of a configuration where rows are dependent
STRAY = 1e-3
DEPENDENT = 1e-8  # part of a row that is new, relative to its length


def independent_rows(
    system: System, q: np.ndarray, v: np.ndarray, t: float, c: np.ndarray
) -> tuple[int, ...]:
    """Rows of the constraint that imply all of them; a warning where that is not every row.

    Raises
    ------
    InputError
        If rows are dependent here but not at neighbouring configurations: a singular configuration.
    """
    m = system.constraint.numel()
    every = tuple(range(m))
    slope, mass = position_rows(system, q, t, c)[1][:m], mass_at(system, q, v, t, c)
    rank, tied = _rank(slope, mass)
    if rank == m:
        return every
    flat = [i for i in every if not np.abs(slope[i]).any()]
    if flat or _rank_nearby(system, slope, q, v, t, c) > rank:
        raise InputError(
            f"the constraint rows {flat or tied} are dependent at the start q0={q} although they "
            "are not nearby: a singular configuration (dead point, folded linkage, or a row that "
            "is a square), where the motion is not determined; start elsewhere, or write the rows "
            "so that their gradients do not vanish"
        )
    keep = independent(slope, mass, every)
    warnings.warn(
        f"the constraint rows {tied} are redundant (rank {rank} of {m}): rows {list(keep)} are "
        "solved, the motion is determined, the multipliers are not; those of least norm are "
        "reported",
        stacklevel=5,
    )
    return keep


def independent(slope: np.ndarray, mass: np.ndarray, candidates: Sequence[int]) -> tuple[int, ...]:
    """The first candidates whose rows are independent of those before them."""
    rows = _equilibrate(slope, mass)
    basis: list[np.ndarray] = []
    keep = []
    for i in candidates:
        rest = rows[i].copy()
        for _ in range(2):  # twice is enough (Kahan, Parlett)
            for b in basis:
                rest -= b * (b @ rest)
        size = np.linalg.norm(rest)
        if size > 1e-7:
            basis.append(rest / size)
            keep.append(i)
    return tuple(keep)


def _equilibrate(slope: np.ndarray, mass: np.ndarray) -> np.ndarray:
    """Rows of unit length in the metric of the masses."""
    rows = slope / inertia_roots(mass)
    length = np.linalg.norm(rows, axis=1, keepdims=True)
    return rows / np.where(length > 0, length, 1.0)


def _rank(slope: np.ndarray, mass: np.ndarray) -> tuple[int, list[int]]:
    """Rank of the rows, and the rows that a dependence ties together."""
    rows = _equilibrate(slope, mass)
    values = np.linalg.svd(rows, compute_uv=False)
    if len(rows) <= rows.shape[1] and values.min(initial=1.0) > RANK * values.max(initial=0.0):
        return len(rows), []
    left, values, _ = np.linalg.svd(rows)
    rank = int((values > RANK * max(values.max(initial=0.0), 1e-300)).sum())
    part = np.abs(left[:, rank:]).max(axis=1, initial=0.0)
    return rank, np.flatnonzero(part > 1e-6).tolist()


def _rank_nearby(system: System, slope, q, v, t: float, c) -> int:
    """Rank at a configuration of the manifold a little away."""
    _, values, right = np.linalg.svd(slope)
    free = right[int((values > RANK * values.max(initial=0.0)).sum()) :]
    if not len(free):
        return 0
    away = np.random.default_rng(1).normal(size=len(free)) @ free
    far = max(np.abs(q).max(initial=0.0), 1e-3)
    if ca.depends_on(system.constraint, system.t):  # rows may part with time
        t = t + STRAY * max(abs(t), 1.0)
    try:
        there = project_configuration(system, q + STRAY * far * away / np.abs(away).max(), v, t, c)
    except InputError:
        return 0
    m = system.constraint.numel()
    steep, mass = position_rows(system, there, t, c)[1][:m], mass_at(system, there, v, t, c)
    values = np.linalg.svd(_equilibrate(steep, mass), compute_uv=False)
    return int((values > 1e-7).sum())


def check_configuration(
    system: System,
    active_set: ActiveSet,
    q: np.ndarray,
    v: np.ndarray | None,
    t: float,
    c: np.ndarray,
) -> None:
    """Is the start on the manifold, and does it determine a motion there?

    `v` enters the mass matrix alone; where it does and is not known, inertia is not looked at.

    Raises
    ------
    InputError
        Naming the rows that are violated, by how much, and the projection that repairs it; or
        what is dependent, or has no inertia.
    """
    m = system.constraint.numel()
    g, slope = (x[:m] for x in position_rows(system, q, t, c))
    off = np.flatnonzero(~(np.abs(g) <= OFF * row_sizes(slope, q)))
    if len(off):
        raise InputError(
            f"q0 violates the constraint rows {off.tolist()}: g = {g[off]}; "
            "start from q0, v0 = varint.project(system, q0, v0)"
        )
    at = np.zeros(len(q)) if v is None else v
    mass, w = mass_at(system, q, at, t, c), velocity_gaps(system, q, at, t, c)[1]
    w = np.delete(w, [i for i in range(m) if i not in active_set.rows], axis=0)
    rank, tied = _rank(w, mass) if len(w) > len(active_set.rows) else (len(w), [])
    if rank < len(w):
        raise InputError(
            f"the velocity constraints {tied} (constraint rows first, then non-holonomic ones) are "
            "dependent at the start; leave out the rows that the others imply"
        )
    if v is not None or system.structure.quadratic_kinetic:
        check_inertia(system, mass, w)


def check_velocity(system: System, q: np.ndarray, v: np.ndarray, t: float, c: np.ndarray) -> None:
    """Does the start velocity keep to the manifold?

    Raises
    ------
    InputError
        Naming the rows that are violated, by how much, and the projection that repairs it.
    """
    m = system.constraint.numel()
    rows, w = velocity_gaps(system, q, v, t, c)
    size = np.abs(w) @ np.abs(v) + np.abs(rows - w @ v)
    fast = np.abs(v).max(initial=0.0)
    off = np.flatnonzero(~(np.abs(rows) <= OFF * np.maximum(size, np.abs(w).sum(axis=1) * fast)))
    if len(off):
        what = [f"constraint[{i}]" if i < m else f"nonholonomic[{i - m}]" for i in off]
        raise InputError(
            f"v0 violates the velocity constraints of {what}: G v + ∂g/∂t = {rows[off]}; "
            "start from q0, v0 = varint.project(system, q0, v0)"
        )


def check_gaps(system: System, q: np.ndarray, t: float, c: np.ndarray) -> None:
    """Refuse a start inside a contact."""
    m = system.constraint.numel()
    gap, slope = (x[m:] for x in position_rows(system, q, t, c))
    if (gap >= 0).all():
        return
    inside = np.flatnonzero(~(gap >= -OFF * row_sizes(slope, q)))
    if len(inside):
        raise InputError(
            f"q0 violates the contacts {inside.tolist()}: gap = {gap[inside]}, but gaps are not "
            "negative; move the start, or change the sign of the gap if it was meant the other "
            "way"
        )


def rows_beyond(given: np.ndarray, candidates: np.ndarray) -> np.ndarray:
    """Greedy choice of the candidate rows that are linearly independent of the given ones and of
    each other, (m,).
    """
    basis = np.linalg.qr(given.T)[0].T if len(given) else np.zeros((0, candidates.shape[1]))
    kept = np.zeros(len(candidates), dtype=bool)
    for i, row in enumerate(candidates):
        size = np.linalg.norm(row)
        new = row - basis.T @ (basis @ row)
        new = new - basis.T @ (basis @ new)  # twice is enough
        kept[i] = size > 0 and np.linalg.norm(new) > DEPENDENT * size
        if kept[i]:
            basis = np.vstack([basis, new / np.linalg.norm(new)])
    return kept

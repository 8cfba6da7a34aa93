"""Guesses brought onto the constraints g(q, t) = 0: a straight line between two configurations
leaves them.

Points move by least-norm Newton steps, Δq = −G⁺ g. Where the line crosses points that are equally
far from several branches (the middle of a circle) it is bent aside first; a path that then jumps is
sampled anew at equal distances and brought back, some times over, as a string that is pulled along
the surface.
"""

from __future__ import annotations

from collections.abc import Callable

import casadi as ca
import numpy as np

from varint.discrete.lagrangian import constraint_function
from varint.numerics.arrays import over_columns
from varint.scene.memory import per_system
from varint.scene.system import System

Path = Callable[[np.ndarray], np.ndarray]
CLOSE = 1e-9  # |g| relative to the size of the coordinates: on the manifold
ITERATIONS = 30
DEPENDENT = 1e-8  # of the largest singular value: redundant rows
SAMPLES = 129
BENDS = (0.0, 0.1, 0.3, 1.0)  # of the path's extent, tried in this order
UNEVEN = 4.0  # times the mean distance of neighbours: the path jumps
PULLS = 8


def move_onto_constraints(
    system: System, q: np.ndarray, t: np.ndarray, c: np.ndarray, moves: np.ndarray | None = None
):
    """Nearby points with g(q, t) = 0, and which of them were found.

    Parameters
    ----------
    q, t, c : ndarray (M, n), (M,), (k,)
    moves : ndarray of bool (M, n), optional
        Coordinates that may change; default: all.

    Returns
    -------
    q : ndarray (M, n)
        Points that were not found are as they were given.
    found : ndarray of bool (M,)
    """
    q, given = q.copy(), q
    for _ in range(ITERATIONS):
        g, slope = over_columns(dense_constraint_function(system), q, t[:, None], c)
        found = np.abs(g).max(axis=1, initial=0.0) <= CLOSE * (1 + np.abs(q).max(axis=1))
        if found.all():
            break
        slope = slope.reshape(len(q), q.shape[1], -1).transpose(0, 2, 1)
        if moves is not None:
            slope = slope * moves[:, None, :]
        with np.errstate(invalid="ignore", over="ignore"):
            step = np.einsum(
                "mij,mj->mi",
                np.linalg.pinv(np.nan_to_num(slope), rcond=DEPENDENT),
                np.nan_to_num(g),
            )
        q = np.where(found[:, None], q, q - step)
    return np.where(found[:, None], q, given), found


def move_ends_onto_constraints(
    system: System, ends: np.ndarray, t: np.ndarray, c: np.ndarray, moves: np.ndarray
):
    """As `move_onto_constraints` for the two ends of a path; where the way from a point is not
    clear, from beside it.
    """
    extent = np.abs(ends).max() or 1.0
    for bend in BENDS:
        found, fits = move_onto_constraints(
            system, ends + bend * extent * _side(ends.shape[1]) * moves, t, c, moves
        )
        if fits.all():
            break
    return found, fits


def _side(n: int) -> np.ndarray:
    """A direction that no symmetry of a scene leaves alone."""
    return np.cos(1.0 + np.arange(n))


def move_path_onto_constraints(
    system: System, path: Path, t0: float, duration: float, c: np.ndarray, moves: np.ndarray
) -> Path:
    """A path near the given one that keeps to the constraints, or the given one where none is
    found.

    `moves` (2, n): the coordinates of the two ends that may change.
    """
    s = np.linspace(0, 1, SAMPLES)
    line, t = path(s), t0 + duration * s
    ends, fits = move_ends_onto_constraints(system, line[[0, -1]], t[[0, -1]], c, moves)
    if not fits.all():
        return path
    line = (1 - s[:, None]) * (line + ends[0] - line[0]) + s[:, None] * (line + ends[1] - line[-1])
    extent = max(np.ptp(line, axis=0).max(), np.abs(line).max())
    for bend in BENDS:
        q, found = move_onto_constraints(
            system, line + bend * extent * np.sin(np.pi * s)[:, None] * _side(line.shape[1]), t, c
        )
        for _ in range(PULLS):
            if not found.all() or not _jumps(q):
                break
            q, found = move_onto_constraints(system, _evenly(q), t, c)
        if found.all() and not _jumps(q):
            return lambda at: np.array([np.interp(at, s, column) for column in q.T]).T
    return path


def _jumps(q: np.ndarray) -> bool:
    apart = np.linalg.norm(np.diff(q, axis=0), axis=1)
    return bool(apart.max() > UNEVEN * apart.mean())


def _evenly(q: np.ndarray) -> np.ndarray:
    """Points at equal distances along the polygon."""
    along = np.append(0, np.cumsum(np.linalg.norm(np.diff(q, axis=0), axis=1)))
    at = np.linspace(0, along[-1], len(q))
    return np.array([np.interp(at, along, column) for column in q.T]).T


@per_system
def dense_constraint_function(system: System) -> ca.Function:
    """(q, t, c) → (g, ∂g/∂q), every entry of both."""
    s = system
    g, slope = constraint_function(s)(s.q, s.t, s.c)
    return ca.Function("dense_constraint", [s.q, s.t, s.c], [ca.densify(g), ca.densify(slope)])

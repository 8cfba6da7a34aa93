"""A first path of which nothing is known but its ends.

It is the straight line between them. With constraints that line may lead through a place where they
have no tangents, as the centre of a sphere between antipodes or a folded chain between one that
hangs and one that stands. What is symmetric about such a line stays on it: Newton's method ends at
motions that leap through the place in a single step. A walk on the constraints goes around it.
"""

from __future__ import annotations

import numpy as np

from varint.discrete.constraints import position_rows
from varint.discrete.projection import is_on, restore
from varint.scene.system import System

LOOKED_AT = 7  # places along the line; the middle one is among them
FLAT = 1e-6  # of the largest gradient on the line, or of independent rows: no tangents
STRIDES, MOST_STRIDES = 24, 300  # of a walk as long as the line, and of all walks
ASIDE = 1e-6  # of the way ahead: less of it along the constraints leads nowhere


def first_way(system: System, ends: np.ndarray, t: float, c: np.ndarray) -> np.ndarray:
    """Configurations (k, n) from the first end to the second, evenly spaced."""
    if not system.structure.constraints or not _is_singular(system, ends, t, c):
        return ends
    way = _walk(system, ends, t, c)
    return ends if way is None else _evenly(way)


@np.errstate(all="ignore")  # what is not finite is looked at
def _is_singular(system: System, ends: np.ndarray, t: float, c: np.ndarray) -> bool:
    """Whether the line leads through a place where the constraints have no tangents."""
    shares = np.linspace(0, 1, LOOKED_AT + 2)[:, None]
    slopes = np.array([_slope(system, q, t, c) for q in (1 - shares) * ends[0] + shares * ends[1]])
    if not np.isfinite(slopes).all():
        return True
    lengths = np.linalg.norm(slopes, axis=2)
    if (lengths <= FLAT * lengths.max(axis=0)).any():
        return True
    least = np.linalg.svd(slopes / lengths[:, :, None], compute_uv=False).min(axis=1)
    return bool((least <= FLAT).any() and least.max() > FLAT)  # not redundant all the way


def _walk(system: System, ends: np.ndarray, t: float, c: np.ndarray) -> np.ndarray | None:
    """Short strides on the constraints, each towards the end; None where they do not get there."""
    q, end = ends
    random, stride = np.random.default_rng(1), float(np.linalg.norm(end - q)) / STRIDES
    way = [q]
    while len(way) < MOST_STRIDES:
        ahead = end - q
        if np.linalg.norm(ahead) <= 1.5 * stride:
            return np.array([*way, end])
        along = _tangent(system, q, ahead, t, c)
        if not np.linalg.norm(along) > ASIDE * np.linalg.norm(ahead):
            along = _tangent(system, q, random.normal(size=len(q)), t, c)
        size = np.linalg.norm(along)
        if not size > 0:
            return None
        q = restore(system, q + stride / size * along, np.ones(len(q)), t, c)
        if not (is_on(system, q, t, c) and np.linalg.norm(q - way[-1]) <= 3 * stride):
            return None
        way.append(q)
    return None


def _tangent(system: System, q: np.ndarray, x: np.ndarray, t: float, c: np.ndarray) -> np.ndarray:
    """The part of x along the constraints."""
    slope = _slope(system, q, t, c)
    return x - np.linalg.lstsq(slope, slope @ x, rcond=1e-13)[0]


def _slope(system: System, q: np.ndarray, t: float, c: np.ndarray) -> np.ndarray:
    return position_rows(system, q, t, c)[1][: system.structure.constraints]


def _evenly(way: np.ndarray) -> np.ndarray:
    """The same way with its places evenly spaced."""
    along = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(way, axis=0), axis=1)))
    at = np.linspace(0, along[-1], len(way))
    return np.stack([np.interp(at, along, x) for x in way.T], axis=1)

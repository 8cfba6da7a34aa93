"""Coordinates and velocities as the data show them, where a measurement shows one by itself."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import casadi as ca
import numpy as np

from varint.estimation.measurement import Measurement
from varint.estimation.problem import Estimation, Motion
from varint.numerics.arrays import over_columns
from varint.scene.expressions import in_own_symbols
from varint.scene.system import System

DEGREE, NEAR = 3, 8  # of a polynomial through the nearest values, and how many those are


class Seen(NamedTuple):
    """Times, in order, and values of one coordinate or velocity."""

    t: np.ndarray
    values: np.ndarray


def seen_states(p: Estimation, motion: Motion) -> list[Seen | None]:
    """What the data show of each of (q, v), with the guessed parameters; None of what they do
    not.
    """
    found: list[Seen | None] = [None] * (2 * p.system.structure.n)
    for m in motion.data:
        for i, seen in _shown(p.system, m, p.c).items():
            found[i] = found[i] or seen
    return found


def _shown(system: System, m: Measurement, c: np.ndarray) -> dict[int, Seen]:
    """Places in (q, v) that entries a x_i + b(t, c) of an expression show, with their values."""
    s, n = system, system.structure.n
    own, x = ca.vec(ca.densify(in_own_symbols(m.expression, s))), ca.vertcat(s.q, s.v)
    slope = ca.jacobian(own, x)
    rows, columns = (np.array(y, dtype=int) for y in slope.sparsity().get_triplet())
    bent = np.array(ca.which_depends(own, x, 2, True), dtype=bool)
    alone = [(i, columns[rows == i][0]) for i in range(own.numel()) if (rows == i).sum() == 1]
    f = ca.Function("shown", [x, s.t, s.c], [own, ca.densify(slope)])
    b, a = over_columns(f, np.zeros((len(m.t), 2 * n)), m.t[:, None], c)
    a, found = a.reshape(len(m.t), 2 * n, -1), {}
    for i, place in alone:
        there = np.isfinite(m.values[:, i]) & (a[:, place, i] != 0)
        if bent[i] or not there.any():
            continue
        order = np.flatnonzero(there)[np.argsort(m.t[there], kind="stable")]
        found[int(place)] = Seen(
            m.t[order], (m.values[order, i] - b[order, i]) / a[order, place, i]
        )
    return found


def shown_path(parts: Sequence[Seen | None], t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """q and v at times as the data show them, (T, n) each, NaN where they do not; velocities from
    the coordinates where they were not measured themselves.
    """
    n = len(parts) // 2
    q, v = np.full((len(t), n), np.nan), np.full((len(t), n), np.nan)
    places = [i for i, seen in enumerate(parts) if seen is not None]
    values, slopes = smoothed([seen for seen in parts if seen is not None], t)
    for k, place in enumerate(places):
        if place < n:
            q[:, place], v[:, place] = values[:, k], slopes[:, k]
        else:
            v[:, place - n] = values[:, k]
    return q, v


def smoothed(parts: Sequence[Seen], t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Values and slopes of several at times, (T, parts) each, by polynomials through the nearest
    values (Savitzky & Golay 1964, for any times).
    """
    known: dict[bytes, tuple[np.ndarray, np.ndarray]] = {}
    values, slopes = np.empty((len(t), len(parts))), np.empty((len(t), len(parts)))
    for i, seen in enumerate(parts):
        key = seen.t.tobytes()
        near, weights = known[key] = known.get(key) or _weights(seen.t, t)
        values[:, i], slopes[:, i] = np.einsum("tdm,tm->dt", weights, seen.values[near])
    return values, slopes


def _weights(seen: np.ndarray, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The nearest of the times seen, and the weights of their values in value and slope at t."""
    count = min(NEAR, len(seen))
    degree = min(DEGREE, len(np.unique(seen)) - 1)
    first = np.clip(np.searchsorted(seen, t) - count // 2, 0, len(seen) - count)
    near = first[:, None] + np.arange(count)
    past = seen[near] - t[:, None]
    size = np.maximum(np.abs(past).max(axis=1), np.finfo(float).tiny)
    powers = (past / size[:, None])[:, :, None] ** np.arange(max(degree, 1) + 1)
    weights = np.linalg.pinv(powers)[:, :2]
    weights[:, 1] /= size[:, None]
    return near, weights

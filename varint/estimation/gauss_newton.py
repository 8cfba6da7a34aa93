"""Least squares with equations: Gauss–Newton steps in the null space of the linearised equations,
bounds by an active set, shortened by Bock's natural level function.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from varint.errors import ConvergenceError

STEPS = 100  # of Gauss–Newton; what converges at all takes some ten, large residuals more
SETTLED = 1e-11  # relative change of the unknowns that ends the iteration, once applied
ROUGH = 1e-7  # relative change below which round-off may keep steps from getting shorter
HALVINGS = 12
RANK = 1e-9  # relative singular value below which a direction is not determined


class Linearised(NamedTuple):
    """min |r + J δ|² with C δ = −d, in dimensionless unknowns; `least` is the singular value of J
    below which there is round-off only.
    """

    r: np.ndarray
    j: np.ndarray
    d: np.ndarray
    c: np.ndarray
    least: float


class Solved(NamedTuple):
    """How a least-squares problem ended: unknowns, values there, steps taken, whether it converged
    and which bounds hold it.
    """

    z: np.ndarray
    found: Any
    steps: int
    converged: bool
    held: np.ndarray


def huber_weights(r: np.ndarray, k: float | None) -> np.ndarray:
    """Weights that make |√w r|² the slope of Huber's loss: 1 up to k, then k/|r|."""
    if k is None:
        return np.ones(len(r))
    return np.minimum(1.0, k / np.maximum(np.abs(r), 1e-300))


def loss_of(r: np.ndarray, k: float | None) -> float:
    """½ Σ r², beyond k Σ k (|r| − ½ k) (Huber 1964)."""
    if k is None:
        return float(r @ r) / 2
    size = np.abs(r)
    return float(np.where(size <= k, size**2 / 2, k * (size - k / 2)).sum())


def null_space(c: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Range Y and null space Z of the rows of C, and R with C Y = Rᵀ."""
    q, r = np.linalg.qr(c.T, mode="complete")
    count = len(c)
    return q[:, :count], q[:, count:], r[:count]


def told(s: np.ndarray, least: float) -> np.ndarray:
    """Which singular values tell something."""
    return s > max(RANK * s.max(initial=0.0), least)


def shortest(j: np.ndarray, r: np.ndarray, least: float) -> np.ndarray:
    """The x of least length that minimises |J x − r|, along directions that are told."""
    u, s, vt = np.linalg.svd(j, full_matrices=False)
    keep = told(s, least)
    return vt[keep].T @ ((u[:, keep].T @ r) / s[keep])


def step_of(p: Linearised) -> np.ndarray:
    """The δ of least length that solves the linearised problem."""
    if not len(p.c):
        return -shortest(p.j, p.r, p.least)
    y, z, r = null_space(p.c)
    onto = y @ np.linalg.lstsq(r.T, -p.d, rcond=None)[0]
    return onto - z @ shortest(p.j @ z, p.r + p.j @ onto, p.least)


def bounded_step(
    p: Linearised, room_below: np.ndarray, room_above: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The step with −room_below ≤ δ ≤ room_above, bound after bound held where it would be broken
    most; and which are held.
    """
    held = room_below + room_above <= 0
    target = np.where(held, room_above, 0.0)
    while True:
        rows = np.eye(len(held))[held]
        whole = p._replace(c=np.vstack([p.c, rows]), d=np.concatenate([p.d, -target[held]]))
        delta = step_of(whole)
        low, high = -room_below - delta, delta - room_above
        over = np.where(held, -np.inf, np.maximum(low, high))
        worst = int(over.argmax())
        if over[worst] <= 0:
            return delta, held
        held[worst] = True
        target[worst] = -room_below[worst] if low[worst] > high[worst] else room_above[worst]


def solve(
    evaluate: Callable[[np.ndarray], Any],
    z: np.ndarray,
    sizes: Callable[[np.ndarray], np.ndarray],
    lower: np.ndarray,
    upper: np.ndarray,
    huber: float | None,
) -> Solved:
    """min Σ loss(r(z)) with d(z) = 0 and bounds, from z on.

    Parameters
    ----------
    evaluate : callable
        z → `Residuals`.
    z : ndarray
        Where the bounds are equal the unknown is given.
    sizes : callable
        z → typical sizes of the unknowns.
    lower, upper : ndarray
    huber : float or None
        Where Huber's loss becomes linear, in units of σ.
    """
    z = np.clip(z, lower, upper)
    found = evaluate(z)
    held, moved = np.zeros(len(z), dtype=bool), np.inf
    for count in range(1, STEPS + 1):
        size = sizes(z)
        linear, unit = _linearised(found, size, huber)
        delta, held = bounded_step(linear, (z - lower) / size, (upper - z) / size)
        moved, long = float(np.abs(delta).max(initial=0.0)), float(np.linalg.norm(delta))
        part, best = 1.0, None
        for _ in range(HALVINGS):
            trial = np.clip(z + part * delta * size, lower, upper)
            after = values_at(evaluate, trial)
            if after is not None:
                left = _level(linear, after, unit, held, huber)
                if left <= (1 - part / 2) * long or moved <= ROUGH:
                    best = trial, after
                    break
            part /= 2
        if best is None:
            return Solved(z, found, count, False, held)
        z, found = best
        if moved <= SETTLED and part == 1.0:
            return Solved(z, found, count, True, held)
    return Solved(z, found, STEPS, moved <= ROUGH, held)


def _level(
    p: Linearised, after: Any, unit: np.ndarray, held: np.ndarray, huber: float | None
) -> float:
    """Length of the step that the old derivatives would take from the new point: Bock's natural
    level function, which no choice of units and no growth of the motion changes.
    """
    rows = np.eye(len(held))[held]
    root = np.sqrt(huber_weights(after.r, huber))
    again = Linearised(
        root * after.r,
        p.j,
        np.concatenate([unit * after.d, np.zeros(len(rows))]),
        np.vstack([p.c, rows]),
        p.least,
    )
    return float(np.linalg.norm(step_of(again)))


def _linearised(found: Any, size: np.ndarray, huber: float | None) -> tuple[Linearised, np.ndarray]:
    """The problem in dimensionless unknowns and rows, and the units of the latter."""
    root, unit = np.sqrt(huber_weights(found.r, huber)), _row_units(found.of_d, size)
    slopes = root[:, None] * found.of_r * size, unit[:, None] * found.of_d * size
    least = RANK * found.signal
    return Linearised(root * found.r, slopes[0], unit * found.d, slopes[1], least), unit


def _row_units(of_d: np.ndarray, size: np.ndarray) -> np.ndarray:
    """What makes the rows of the linearised equations of size one."""
    return 1 / np.maximum(np.abs(of_d * size).max(axis=1, initial=0.0), 1e-300)


def values_at(evaluate: Callable[[np.ndarray], Any], z: np.ndarray) -> Any:
    """Values at z, or None where its runs cannot be finished."""
    try:
        found = evaluate(z)
    except ConvergenceError:
        return None
    good = np.isfinite(found.r).all() and np.isfinite(found.d).all()
    return found if good and np.isfinite(found.of_r).all() else None

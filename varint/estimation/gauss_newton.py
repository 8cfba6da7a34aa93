"""Least squares with equations: Gauss–Newton steps in the null space of the linearised equations,
bounds by an active set, shortened and damped within a radius (Levenberg & Marquardt) where the
problem bends.

A step is judged by Bock's natural level function and by the loss, to which defects add at a price.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from varint.errors import ConvergenceError

STEPS = 100  # of Gauss–Newton; what converges at all takes some ten, large residuals more
SETTLED = 1e-11  # relative change of the unknowns that ends the iteration, once applied
ROUGH = 1e-7  # relative change below which round-off may keep steps from getting shorter
IDLE = 3  # so small steps that get no shorter end it: round-off
TRIALS = 12  # steps from one point, each a quarter as long as the one before
LIGHTEST = 1e-8  # of the longest column of derivatives: shorter ones are taken for this much
ENOUGH = 0.1  # of the promised decrease of the loss
BISECTIONS = 50
RANK = 1e-9  # relative singular value below which a direction is not determined


class Linearised(NamedTuple):
    """min |r + J δ|² with C δ = −d, in dimensionless unknowns; `least` is the singular value of J
    below which there is round-off only, `loss` what is minimised at δ = 0, `weight` the lengths of
    the columns of J.
    """

    r: np.ndarray
    j: np.ndarray
    d: np.ndarray
    c: np.ndarray
    least: float
    loss: float
    weight: np.ndarray


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


def damped(j: np.ndarray, r: np.ndarray, metric: np.ndarray, radius: float) -> np.ndarray:
    """The x that minimises |J x − r| with |R x| = radius, by |J x − r|² + λ |R x|²."""
    u, s, vt = np.linalg.svd(np.linalg.solve(metric.T, j.T).T, full_matrices=False)
    b = s * (u.T @ r)
    low, high = 0.0, float(np.linalg.norm(b)) / max(radius, 1e-300)  # |R x| < |b| / λ
    for _ in range(BISECTIONS):
        middle = (low + high) / 2
        too_long = np.linalg.norm(b / (s**2 + middle)) > radius
        low, high = (middle, high) if too_long else (low, middle)
    return np.linalg.solve(metric, vt.T @ (b / (s**2 + high)))


def step_of(p: Linearised, radius: float = np.inf) -> np.ndarray:
    """The δ of least length that solves the linearised problem; damped where it is longer than a
    radius, in σ that each unknown changes the residuals by.
    """
    if len(p.c):
        y, z, r = null_space(p.c)
        onto = y @ np.linalg.lstsq(r.T, -p.d, rcond=None)[0]
    else:
        z, onto = np.eye(p.j.shape[1]), np.zeros(p.j.shape[1])
    inner = p.j @ z
    delta = onto - z @ shortest(inner, p.r + p.j @ onto, p.least)
    long = length(p, delta)
    if long <= radius:
        return delta
    onto = onto * (radius / long)
    room = float(np.sqrt(max(radius**2 - length(p, onto) ** 2, 0.0)))
    metric = np.linalg.qr(p.weight[:, None] * z)[1]
    return onto - z @ damped(inner, p.r + p.j @ onto, metric, room)


def length(p: Linearised, delta: np.ndarray) -> float:
    """Of a step, in σ that each unknown changes the residuals by (Moré 1978)."""
    return float(np.linalg.norm(p.weight * delta))


def bounded_step(
    p: Linearised, room_below: np.ndarray, room_above: np.ndarray, radius: float
) -> tuple[np.ndarray, np.ndarray]:
    """The step with −room_below ≤ δ ≤ room_above, bound after bound held where it would be broken
    most; and which are held.
    """
    held = room_below + room_above <= 0
    target = np.where(held, room_above, 0.0)
    while True:
        rows = np.eye(len(held))[held]
        whole = p._replace(c=np.vstack([p.c, rows]), d=np.concatenate([p.d, -target[held]]))
        delta = step_of(whole, radius)
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
    if not _is_finite(found):
        raise ConvergenceError(
            "what is measured, or its derivative, is not a finite number at the first guess: take "
            "other guesses, or bounds that keep out of where it is not defined",
            step=0,
            time=float("nan"),
            residual=float("nan"),
        )
    held, radius = np.zeros(len(z), dtype=bool), np.inf
    least, idle = np.inf, 0  # the shortest step so far, and how many since were no shorter
    for count in range(1, STEPS + 1):
        size = sizes(z)
        linear, unit = _linearised(found, size, huber)
        room = (z - lower) / size, (upper - z) / size
        whole, held = bounded_step(linear, *room, np.inf)
        moved = float(np.abs(whole).max(initial=0.0))
        best, delta = None, whole
        for _ in range(TRIALS):
            if length(linear, whole) > radius:
                delta, held = bounded_step(linear, *room, radius)
            trial = np.clip(z + delta * size, lower, upper)
            after = values_at(evaluate, trial)
            if after is not None and (
                moved <= ROUGH or _is_better(linear, after, unit, held, huber, whole, delta)
            ):
                best = trial, after
                break
            radius = min(length(linear, delta) / 4, float(np.linalg.norm(linear.r)))
        if best is None:
            return Solved(z, found, count, False, held)
        z, found = best
        radius = np.inf if delta is whole else 4 * length(linear, delta)
        least, idle = (moved, 0) if moved < least else (least, idle + 1)
        if moved <= SETTLED or (moved <= ROUGH and idle >= IDLE):
            return Solved(z, found, count, True, held)
    return Solved(z, found, STEPS, moved <= ROUGH, held)


def _is_better(
    p: Linearised,
    after: Any,
    unit: np.ndarray,
    held: np.ndarray,
    huber: float | None,
    whole: np.ndarray,
    delta: np.ndarray,
) -> bool:
    """Whether a step δ brings enough of what the linearised problem promises of it: of the way that
    is left to its solution, which follows valleys that bend, or of the loss, with the equations'
    defects at the price μ Σ |d|, above that of their multipliers (Han 1977).
    """
    promised = (p.r @ p.r - ((p.r + p.j @ delta) ** 2).sum()) / 2
    brought = p.loss - loss_of(after.r, huber)
    if len(p.d):
        rows = np.vstack([p.c, np.eye(len(held))[held]])
        slope = p.j.T @ (p.r + p.j @ delta)
        price = 2 * np.abs(np.linalg.lstsq(rows.T, -slope, rcond=None)[0][: len(p.d)]).max()
        promised += price * (np.abs(p.d).sum() - np.abs(p.d + p.c @ delta).sum())
        brought += price * (np.abs(p.d).sum() - np.abs(unit * after.d).sum())
    if promised >= 0 and brought >= ENOUGH * promised:
        return True
    long, left = np.linalg.norm(whole), np.linalg.norm(whole - delta)
    return bool(_level(p, after, unit, held, huber) <= (long + left) / 2)


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
        p.loss,
        p.weight,
    )
    return float(np.linalg.norm(step_of(again)))


def _linearised(found: Any, size: np.ndarray, huber: float | None) -> tuple[Linearised, np.ndarray]:
    """The problem in dimensionless unknowns and rows, and the units of the latter."""
    root, unit = np.sqrt(huber_weights(found.r, huber)), _row_units(found.of_d, size)
    slopes = root[:, None] * found.of_r * size, unit[:, None] * found.of_d * size
    weight = np.linalg.norm(slopes[0], axis=0)
    weight = np.maximum(weight, LIGHTEST * weight.max(initial=1e-300))
    return (
        Linearised(
            root * found.r,
            slopes[0],
            unit * found.d,
            slopes[1],
            RANK * found.signal,
            loss_of(found.r, huber),
            weight,
        ),
        unit,
    )


def _row_units(of_d: np.ndarray, size: np.ndarray) -> np.ndarray:
    """What makes the rows of the linearised equations of size one."""
    return 1 / np.maximum(np.abs(of_d * size).max(axis=1, initial=0.0), 1e-300)


def values_at(evaluate: Callable[[np.ndarray], Any], z: np.ndarray) -> Any:
    """Values at z, or None where its runs cannot be finished."""
    try:
        found = evaluate(z)
    except ConvergenceError:
        return None
    return found if _is_finite(found) else None


def _is_finite(found: Any) -> bool:
    return all(np.isfinite(x).all() for x in (found.r, found.d, found.of_r, found.of_d))

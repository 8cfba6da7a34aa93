"""Noise levels that are not known, estimated together with the motion: variance components.

With a variance σ_j² + s² of every value the restricted likelihood is largest where

    Σ r_j² w_j² = Σ w_j (1 − h_j),   w_j = 1/(σ_j² + s²),

h_j being what a value contributes to its own prediction (leverage); for σ_j = 0 it is the sum of
squares by the degrees of freedom. Motion and levels are found in turn.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from varint.errors import InputError, SolverError
from varint.estimation.gauss_newton import RANK
from varint.estimation.information import directions
from varint.estimation.measurement import Measurement
from varint.estimation.problem import Estimation
from varint.estimation.residuals import Shooter
from varint.estimation.search import Minimum, best_fit, bounds, fitted, sizes
from varint.scene.free import Free

ROUNDS = 60  # of motion and levels in turn: each takes most of what is left
SETTLED = 1e-9  # relative change of the levels that ends them
HALVINGS = 200


def fit_with_noise(shoot: Shooter, huber: float | None) -> tuple[Minimum, dict[int, Free]]:
    """The best fit with the levels of noise put in, and which measurements had unknown ones, by
    their place among all.

    Raises
    ------
    InputError
        If levels are unknown with robust losses, which have no likelihood.
    SolverError
        If the levels do not settle.
    """
    measured = [m for motion in shoot.problem.motions for m in motion.data]
    unknown = {i: m.jitter for i, m in enumerate(measured) if isinstance(m.jitter, Free)}
    if unknown and huber is not None:
        raise InputError(
            "jitter=vi.free(…) estimates noise levels by their likelihood, which huber= has none "
            "of: give the levels, or leave huber out"
        )
    found = best_fit(shoot, huber)
    for _ in range(ROUNDS if unknown else 0):
        before = _data(found.shoot.problem)
        after = [_again(found, before, i, unknown) for i in range(len(before))]
        moved = max(
            abs(new.level - old.level) / max(float(new.spread.min()), 1e-300)
            for old, new in zip(before, after, strict=True)
        )
        shoot = replace(found.shoot, problem=_with(found.shoot.problem, after))
        found = fitted(shoot, found.solved.z, *bounds(shoot.problem), huber)
        if moved <= SETTLED:
            return found, unknown
    if unknown:
        raise SolverError("the levels of noise did not settle: give them", status="not converged")
    return found, unknown


def level_sigma(found: Minimum, which: dict[int, Free]) -> dict[int, float]:
    """Standard deviations of estimated levels, by the information of the restricted likelihood:
    1/√(2 s² Σ w² (1 − h)); infinite where the level is zero.
    """
    spreads = {}
    for i in which:
        m = _data(found.shoot.problem)[i]
        there, (_, own) = np.isfinite(m.values), _part(found, i)
        w = 1 / m.spread[there] ** 2
        told = 2 * m.level**2 * float((w**2 * (1 - own)).sum())
        spreads[i] = 1 / np.sqrt(told) if told > 0 else np.inf
    return spreads


def _data(p: Estimation) -> list[Measurement]:
    return [m for motion in p.motions for m in motion.data]


def _with(p: Estimation, data: list[Measurement]) -> Estimation:
    """The problem with other measurements in the places of its own."""
    motions, at = [], 0
    for motion in p.motions:
        count = len(motion.data)
        motions.append(motion._replace(data=tuple(data[at : at + count])))
        at += count
    return p._replace(motions=tuple(motions))


def _part(found: Minimum, i: int) -> tuple[np.ndarray, np.ndarray]:
    """Residuals in σ and leverages of a measurement's values."""
    p, solved = found.shoot.problem, found.solved
    counts = [int(np.isfinite(m.values).sum()) for m in _data(p)]
    rows = slice(sum(counts[:i]), sum(counts[: i + 1]))
    spread, _, _ = directions(solved.found, sizes(p, solved.z), solved.held)
    own = ((solved.found.of_r[rows] @ spread) ** 2).sum(1)
    return solved.found.r[rows], np.minimum(own, 1 - RANK)


def _again(
    found: Minimum, data: list[Measurement], i: int, unknown: dict[int, Free]
) -> Measurement:
    m = data[i]
    if i not in unknown:
        return m
    r, own = _part(found, i)
    there = np.isfinite(m.values)
    level = _level(r * m.spread[there], m.sigma[there], own)
    low, high = float(unknown[i].lower), float(unknown[i].upper)
    return replace(m, jitter=min(max(level, low), high))


def _level(r: np.ndarray, sigma: np.ndarray, own: np.ndarray) -> float:
    """s ≥ 0 where the restricted likelihood is largest, by bisection in s²."""

    def slope(s2: float) -> float:
        w = 1 / np.maximum(sigma**2 + s2, 1e-300)
        return float((r**2 * w**2).sum() - (w * (1 - own)).sum())

    low, high = 0.0, float((r**2).sum())
    if sigma.min() > 0 and slope(0.0) <= 0:
        return 0.0
    while slope(high) > 0:
        high *= 2
    for _ in range(HALVINGS):
        middle = (low + high) / 2
        low, high = (middle, high) if slope(middle) > 0 else (low, middle)
    return float(np.sqrt((low + high) / 2))

"""Contacts that hold, as equations: which of them are solved for, what a blow makes of them, and
their gaps at zero.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from varint.discrete.consistency import independent
from varint.discrete.constraints import ActiveSet
from varint.integration.events.contacts import Instant, View, first_contact
from varint.numerics.arrays import lengths
from varint.scene.system import System

ROUND_OFF = np.finfo(float).eps  # of what adds up to a gap: below, it is zero


def solvable(system: System, now: Instant, seen: View, holding: list[int]) -> ActiveSet:
    """The active set with these contacts held; of dependent rows, the first are solved for."""
    if not holding:
        return replace(now.active_set, contacts=(), holding=())
    first = first_contact(system)
    fixed = [*now.active_set.rows, *range(system.constraint.numel(), first)]
    kept = independent(seen.slope, seen.mass, [*fixed, *(first + i for i in holding)])
    return replace(
        now.active_set,
        contacts=tuple(i - first for i in kept if i >= first),
        holding=tuple(holding),
    )


def landed(system: System, now: Instant, seen: View, touching: list[int]) -> Instant:
    """The instant with all gaps that hold at zero, as the steps to come will have them: a step as
    short as a bounce that dies out would make up for what is left by a jump of the other gaps. What
    else touches stays where it is, as far as that is possible, the lowest first.
    """
    first, size = first_contact(system), np.abs(seen.slope) @ np.abs(now.q)
    holding = now.active_set.contacts
    if all(abs(seen.gap[i]) <= ROUND_OFF * size[first + i] for i in holding):
        return now
    fixed = [*now.active_set.rows, *range(system.constraint.numel(), first)]
    others = sorted({*touching} - {*holding}, key=lambda i: float(seen.gap[i]))
    order = [*fixed, *(first + i for i in (*holding, *others))]
    rows = independent(seen.slope, seen.mass, order)
    away = np.array([-seen.gap[i - first] if i - first in holding else 0.0 for i in rows])
    way = saddle(seen.mass, seen.slope[[*rows]], np.append(np.zeros(len(now.q)), away))
    x = now.x.copy()
    x[: len(now.q)] += way[: len(now.q)]
    return replace(now, x=x)


def answer(mass: np.ndarray, rows: np.ndarray, row: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Velocities that a unit impulse along `row` makes, and the impulses along `rows`, which hold,
    that come with it: M y = row + rowsᵀ μ, rows y = 0.
    """
    found = saddle(mass, rows, np.concatenate([row, np.zeros(len(rows))]))
    return found[: len(mass)], found[len(mass) :]


def saddle(mass: np.ndarray, rows: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Solution of [M −Wᵀ; W 0] [y; μ] = right, equilibrated."""
    n, m = len(mass), len(rows)
    scales = np.empty(n + m)
    size = np.sqrt(np.abs(mass.diagonal()))
    if not size.all():
        size = np.where(size > 0, size, size.max())
    scales[:n] = size
    matrix = np.zeros((n + m, n + m))
    matrix[:n, :n] = mass / (size[:, None] * size)
    if m:
        scaled = rows / size
        length = lengths(scaled)
        length = np.where(length > 0, length, 1.0)  # a row of zeros: no impulse along it
        scaled /= length[:, None]
        matrix[:n, n:], matrix[n:, :n] = -scaled.T, scaled
        scales[n:] = length
    try:
        found = np.linalg.solve(matrix, right / scales)  # exact where a blow only turns a sign
    except np.linalg.LinAlgError:
        found = np.linalg.lstsq(matrix, right / scales, rcond=1e-12)[0]
    return found / scales

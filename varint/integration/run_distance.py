"""How far two runs of the same motion with different numbers of steps are apart."""

from __future__ import annotations

import math

import numpy as np

from varint.integration.round_off import ROUNDED
from varint.results.trajectory import Trajectory

EARLIEST = 8  # part of the nodes that come before a difference tells of all later ones
LOOKS = 65  # nodes at which runs without common ones are compared
# nodes of a run whose end tells of the length of its steps: one that ends within the first of them
# is a single shorter step from the start, the same in all such runs
TELLING = 3


def distance(one: Trajectory, few: int, other: Trajectory, many: int, scales: np.ndarray) -> float:
    """Largest difference of two runs with so many steps at the nodes of both, by the scales."""
    return float(differences(one, few, other, many, scales).max())


def differences(
    one: Trajectory, few: int, other: Trajectory, many: int, scales: np.ndarray
) -> np.ndarray:
    """All of them, node by node."""
    unit = math.gcd(few, many)
    if _equally_spaced(one) and _equally_spaced(other):
        q1, q2 = one.q[:: few // unit], other.q[:: many // unit]
        count = min(len(q1), len(q2))
        return np.abs(q1[:count] - q2[:count]) / scales
    (k1, q1), (k2, q2) = _on_grid(one, many // unit), _on_grid(other, few // unit)
    _, i, j = np.intersect1d(k1, k2, return_indices=True)
    return np.abs(q1[i] - q2[j]) / scales


def with_early(off: np.ndarray) -> tuple[float, float]:
    """The largest of differences (nodes, n), and the least that one of the early ones, up to the
    middle, lets expect there: differences of regular motions grow with the square of time at most.
    """
    far, middle = off.max(axis=1), len(off) // 2
    if not middle:
        return float(far.max()), float(far.max())
    first = max(len(off) // EARLIEST, 1)
    so_far = np.maximum(np.maximum.accumulate(far[: middle + 1])[first:], ROUNDED)
    expected = so_far * (middle / np.arange(first, middle + 1)) ** 2
    return float(far.max()), float(expected.min())


def distance_between_nodes(one: Trajectory, other: Trajectory, scales: np.ndarray) -> float:
    """Largest difference at some nodes of the first run, where the other one need not have any."""
    some = np.unique(np.linspace(0, len(one) - 1, LOOKS).astype(int))
    t, q = one.t[some], one.q[some]
    both = abs(t - t[0]) <= abs(other.t[-1] - t[0])
    return float((np.abs(q[both] - other.at(t[both]).q) / scales).max())


def _equally_spaced(motion: Trajectory) -> bool:
    """Whether every step made a node, and nothing else did."""
    last = motion.k[-1]
    return last == len(motion) - 1 and not motion.events and on_grid(motion, last)


def on_grid(motion: Trajectory, k: int) -> bool:
    """Whether the last node is that of step k."""
    assert motion.origin is not None
    close = 1e-6 * abs(motion.h)
    return bool(abs(motion.t[-1] - (motion.origin + motion.h * k)) <= close)


def ends_apart(one: Trajectory, other: Trajectory, scales: np.ndarray) -> float:
    """Difference of the events at which two runs end, that of their times included; infinite where
    the finer one, the other, ends within its first step.
    """
    if len(other) < TELLING:
        return math.inf
    late = abs(one.t[-1] - other.t[-1]) * np.abs(other[-1:].v[0])
    return float(((np.abs(one.q[-1] - other.q[-1]) + late) / scales).max())


def _on_grid(motion: Trajectory, factor: int) -> tuple[np.ndarray, np.ndarray]:
    """Steps, times a factor, and coordinates at the nodes that do not belong to an event."""
    assert motion.origin is not None
    close = 1e-6 * abs(motion.h)
    grid = np.abs(motion.t - (motion.origin + motion.h * motion.k)) <= close
    return motion.k[grid] * factor, motion.q[grid]

"""How far two runs of the same motion with different numbers of steps are apart."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from varint.discrete.legendre import velocity_function
from varint.integration.error_scale import error_scales
from varint.integration.round_off import ROUNDED
from varint.numerics.arrays import call
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
    i, j = shared_nodes(one, few, other, many)
    return np.abs(one.q[i] - other.q[j]) / scales


def shared_nodes(
    one: Trajectory, few: int, other: Trajectory, many: int
) -> tuple[np.ndarray, np.ndarray]:
    """Indices of the nodes of two runs with so many steps that both have."""
    unit = math.gcd(few, many)
    first, second = _equal_steps(one), _equal_steps(other)
    if first and second:
        i, j = np.arange(0, first, few // unit), np.arange(0, second, many // unit)
        count = min(len(i), len(j))
        return i[:count], j[:count]
    assert one.origin is not None and other.origin is not None
    at = (
        nodes_on_grid(one.t, one.k, one.origin, one.h),
        nodes_on_grid(other.t, other.k, other.origin, other.h),
    )
    return shared_steps(one.k, at[0], many // unit, other.k, at[1], few // unit)


def shared_steps(
    k1: np.ndarray, at1: np.ndarray, more1: int, k2: np.ndarray, at2: np.ndarray, more2: int
) -> tuple[np.ndarray, np.ndarray]:
    """Of nodes `at` of two runs after so many steps k, those after as many times `more` of them:
    the first of several in a run.
    """
    first, second = k1[at1] * more1, k2[at2] * more2
    place = np.minimum(second.searchsorted(first), len(second) - 1)
    both = second[place] == first
    both[1:] &= first[1:] != first[:-1]
    return at1[both], at2[place[both]]


def beyond_shared(
    off: np.ndarray, q: np.ndarray, shared: np.ndarray | slice, t: np.ndarray | None = None
) -> float:
    """How many times larger than at shared nodes, where they are off (shared, n), errors of a run
    q (N + 1, n) at times t, equal steps apart where none are given, may be at its other ones.

    A run that is late by a time is off by that times how fast it is: most, where an angle flies
    past the centre of its coordinates, which few shared nodes may all be far from. What it is late
    by grows with time, at least.
    """
    if len(q) < 3:
        return 1.0
    way = np.abs(_across(q))
    if t is None:
        apart = np.full((len(way), 1), 2)
        apart[-1] = 1  # the last node has no other behind it
        speed = np.arange(1, len(q))[:, None] * way / apart
    else:
        speed = np.abs(t[1:] - t[0])[:, None] * way / np.abs(_across(t))[:, None]
    at = np.arange(len(q))[shared]
    seen = np.maximum(speed[at[at > 0] - 1].max(axis=0, initial=0.0), speed[-1])
    most, each = speed.max(axis=0), off.max(axis=0)
    between = each * np.divide(most, seen, out=np.ones_like(most), where=seen > 0)
    largest, beyond = float(each.max()), float(between.max())
    return beyond / largest if beyond > largest > 0 else 1.0


def _across(x: np.ndarray) -> np.ndarray:
    """From the node before each to the one behind it, of all but the first."""
    found = np.empty_like(x[1:])
    found[:-1], found[-1] = x[2:] - x[:-2], x[-1] - x[-2]
    return found


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


def _equal_steps(motion: Trajectory) -> int:
    """How many nodes whole steps have made, one each, before the one at which the motion ends
    within a step; 0 where others have made some.
    """
    last, nodes = int(motion.k[-1]), len(motion)
    if motion.events:
        return 0
    if last == nodes - 1 and on_grid(motion, last):
        return nodes
    ends_within = motion.active_set is None and motion.sizes is None
    return nodes - 1 if ends_within and last == motion.k[-2] == nodes - 2 else 0


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
    late = abs(one.t[-1] - other.t[-1]) * np.abs(_last_velocity(other))
    return float(((np.abs(one.q[-1] - other.q[-1]) + late) / scales).max())


def _last_velocity(motion: Trajectory) -> np.ndarray:
    if motion.active_set is not None:
        return motion[-1:].v[0]
    q, p, t = motion.q[-1].copy(), motion.p[-1].copy(), motion.t[-1:].copy()
    return call(velocity_function(motion.system), q, p, t, motion.c)[0]


def nodes_on_grid(t: np.ndarray, k: np.ndarray, origin: float, h: float) -> np.ndarray:
    """Indices of the nodes at the ends of steps, which are none of an event within them."""
    return np.flatnonzero(np.abs(t - (origin + h * k)) <= 1e-6 * abs(h))


def apart_from_proved(motion: Trajectory, proved: Trajectory, scale: Any = None) -> float:
    """How far a run that is made once more, to be watched, is from the one that proved its error,
    by the scales of that.
    """
    few = proved if len(motion) == len(proved) else proved[-1:]
    apart = np.abs(motion.q[-len(few) :] - few.q)
    return float((apart / error_scales(proved.system, proved, scale)).max()) if apart.any() else 0.0

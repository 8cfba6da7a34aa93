"""Zeros of an expression within the steps of a motion: pieces halved until bounds along them tell
how many zeros each has, then all of them located at once.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import casadi as ca
import numpy as np

from varint.codegen.rows import RowFunction
from varint.integration.events.enclosures import (
    Pieces,
    boxes_around,
    enclosure,
    grouped,
    lower_bound,
)
from varint.integration.events.roots import Points, join_points, locate_roots
from varint.integration.events.substeps import Substeps
from varint.integration.events.surroundings import Surroundings, surroundings
from varint.numerics.arrays import over_columns
from varint.results.trajectory import Trajectory
from varint.rules.polynomials import lagrange_values

HALVINGS = 12  # of a step in doubt: dips shallower than its square allows are no zeros
# of a step that holds a kink, as a distance to a small body on the way; what changes by less, of
# the expression's size at its ends, is no such
DEEPEST, SHALLOW = 20, 1e-5
GROUP = 10  # steps that are looked at together first, from so many groups on
MOST_PIECES = 100  # of one step in doubt at once: an expression that is zero up to round-off


@dataclass(frozen=True, eq=False)
class CrossingSearch:
    """What finds the zeros of a watched expression, built once.

    `values`: (q, v, t, u, c) → its value and rate, the latter NaN for expressions of velocities and
    controls; `bounds`: its `enclosure_function`; `box`: its `box_function`; `as_data`: values and
    bounds for c/crossings_core.c, None where they have no such form.
    """

    name: str
    direction: int
    values: ca.Function
    bounds: ca.Function
    box: ca.Function
    as_data: Callable[[], tuple[RowFunction, RowFunction] | None]


def isolate(
    search: CrossingSearch,
    motion: Trajectory,
    start: Points,
    end: Points,
    certain: np.ndarray,
    substeps: Substeps,
) -> Points:
    """Zeros between the nodes and those that the motion comes to at a node; the signs at the ends
    of steps that are `certain` tell how many there are.
    """
    left, right = start.at(slice(0, -1)), end
    whole = left, right
    brackets: list[tuple[Points, Points]] = []
    at = (end.value == 0) & (start.value[:-1] != 0)
    zeros, signs = [end.at(at)], [np.sign(start.value[:-1][at])]
    doubt, sizes = ~certain, np.zeros(len(motion))
    for halving in range(DEEPEST):
        if halving == HALVINGS:
            ends = np.fmax(np.abs(whole[0].value), np.abs(whole[1].value))
            sizes[whole[0].node] = SHALLOW * ends
        some = slice(None) if halving else np.flatnonzero(doubt)
        doubt = np.zeros(len(left.t), dtype=bool)
        doubt[some] = _in_doubt(search, motion, left.at(some), right.at(some), sizes)
        change = ~doubt & _changes(left, right)
        brackets.append((left.at(change), right.at(change)))
        left, right = left.at(doubt), right.at(doubt)
        count = np.bincount(left.node, minlength=len(motion))
        noise = count > MOST_PIECES
        if noise.any():
            noisy = noise[whole[0].node] & _changes(*whole)
            brackets.append((whole[0].at(noisy), whole[1].at(noisy)))
            quiet = ~noise[left.node]
            left, right = left.at(quiet), right.at(quiet)
            known = [~noise[a.node] for a, _ in brackets[:-1]]
            brackets[:-1] = [(a.at(k), b.at(k)) for (a, b), k in zip(brackets, known, strict=False)]
        if not len(left.t):
            break
        middle = _instants(search, motion, substeps, left.node, (left.t + right.t) / 2)
        hit = middle.value == 0
        zeros.append(middle.at(hit))
        signs.append(np.sign(left.value[hit]))
        left, right = join_points(left, middle), join_points(middle, right)
    else:
        change = _changes(left, right)
        brackets.append((left.at(change), right.at(change)))
    left, right = (join_points(*x) for x in zip(*brackets, strict=True))
    if len(left.t):
        around = surroundings(motion, left, right)
        found, is_zero = locate_roots(
            left,
            right,
            lambda t: _near(search, motion, around, left.node, t),
            lambda node, t: _instants(search, motion, substeps, node, t),
            lambda which, there, t: around.at(which).moved(there, t),
        )
        zeros.append(found.at(is_zero))
        signs.append(np.sign(left.value[is_zero]))
    found = join_points(*zeros)
    return found.at(is_wanted(search, np.concatenate(signs)))


def is_wanted(search: CrossingSearch, side: np.ndarray) -> np.ndarray:
    """Whether zeros are asked for, from the sign before them."""
    direction = search.direction
    return side == -direction if direction else side != 0


def _near(
    search: CrossingSearch,
    motion: Trajectory,
    around: Surroundings,
    node: np.ndarray,
    t: np.ndarray,
) -> Points:
    """The motion at times, as the states around them tell; momenta are not read."""
    q, v = around.motion(t)
    return points_at(search, motion, node, t, q, v, q)


def _changes(left: Points, right: Points) -> np.ndarray:
    """Pieces at whose ends the expression is finite and of different sign."""
    with np.errstate(invalid="ignore"):
        return (left.value * right.value < 0) & np.isfinite(left.value + right.value)


def look_at_groups(
    search: CrossingSearch, motion: Trajectory, left: Points, right: Points
) -> tuple[np.ndarray, np.ndarray]:
    """The sign of the expression during each step (0: not known), and whether the signs at its ends
    tell how many zeros it has, as far as boxes around groups of steps show.

    Values of the points are not read.
    """
    count = len(left.t)
    if count < GROUP**2:
        return np.zeros(count), np.zeros(count, dtype=bool)
    each = _box_bounds(search, motion, left, right, GROUP)
    sign, certain = (np.repeat(x, GROUP)[:count] for x in each)
    some = np.flatnonzero(~certain)
    if len(some):
        certain[some] = _box_bounds(search, motion, left.at(some), right.at(some), 1)[1]
    return sign, certain


@np.errstate(all="ignore")  # a step that takes no time has no bounds
def _box_bounds(
    search: CrossingSearch, motion: Trajectory, left: Points, right: Points, size: int
) -> tuple[np.ndarray, np.ndarray]:
    """The sign of the expression in boxes around every `size` pieces, and whether they have none,
    or only grow, or only fall.
    """
    around = boxes_around(_pieces(left, right), size)
    low, high, *rates = np.split(_control_bounds(motion, left, right), 4, axis=1)
    controls = [
        side * grouped(side * x.T, size).T
        for side, x in zip((1, -1, 1, -1), (low, high, *rates), strict=True)
    ]
    bounds = over_columns(search.box, *around, np.hstack(controls), motion.c)[0]
    value_low, value_high, rate_low, rate_high = bounds.T
    sign = np.where(value_low > 0, 1.0, np.where(value_high < 0, -1.0, 0.0))
    return sign, (sign != 0) | (rate_low >= 0) | (rate_high <= 0)


def _pieces(left: Points, right: Points) -> Pieces:
    return Pieces(left.q, left.v, right.q, right.v, left.t, right.t - left.t)


def _in_doubt(
    search: CrossingSearch, motion: Trajectory, left: Points, right: Points, sizes: np.ndarray
) -> np.ndarray:
    """Pieces that may have more zeros than the signs at their ends tell, and change by more than
    what is small in their step.
    """
    moves = left.t != right.t
    if not moves.all():
        doubt = np.zeros(len(left.t), dtype=bool)
        doubt[moves] = _in_doubt(search, motion, left.at(moves), right.at(moves), sizes)
        return doubt
    if not len(left.t):
        return np.zeros(0, dtype=bool)
    w = right.t - left.t
    e = enclosure(
        search.bounds, _pieces(left, right), _control_bounds(motion, left, right), motion.c
    )
    grows, falls = e.rate_low[:, 0] >= 0, e.rate_high[:, 0] <= 0
    small = sizes[left.node]
    certain = grows | falls
    certain |= (np.abs(e.rate_low[:, 0] * w) <= small) & (np.abs(e.rate_high[:, 0] * w) <= small)
    for side, bounds in ((1, e), (-1, e.negative())):
        same = (side * left.value > 0) & (side * right.value >= 0)
        ends = tuple(side * a[:, None] for a in (left.value, right.value, left.rate, right.rate))
        certain |= same & (lower_bound(ends, w[:, None], bounds)[:, 0] >= 0)
    return ~certain


def _instants(
    search: CrossingSearch, motion: Trajectory, substeps: Substeps, node: np.ndarray, t: np.ndarray
) -> Points:
    """The motion at times after the nodes, by sub-steps of the rule."""
    return points_at(search, motion, node, t, *substeps(motion, node, t))


def points_at(
    search: CrossingSearch,
    motion: Trajectory,
    node: np.ndarray,
    t: np.ndarray,
    q: np.ndarray,
    v: np.ndarray,
    p: np.ndarray,
) -> Points:
    """Instants with the values there."""
    u = _controls(motion, node, t)
    found = over_columns(search.values, q, v, t[:, None], u, motion.c)[0]
    return Points(node, t, q, v, p, found[:, 0].copy(), found[:, 1].copy())


def _controls(motion: Trajectory, node: np.ndarray, t: np.ndarray) -> np.ndarray:
    """Controls at instants in the step that begins at, or goes on from, their nodes, (M, k)."""
    if not motion.u.shape[2]:
        return np.empty((len(node), 0))
    k = np.minimum(motion.k[node], len(motion.u) - 1)
    u = motion.u[k]
    if u.shape[1] == 1:
        return u[:, 0]
    assert motion.origin is not None
    within = np.clip((t - motion.origin) / motion.h - k, 0.0, 1.0)
    return np.einsum("ki,kij->kj", lagrange_values(np.array(motion.rule.nodes), within), u)


def _control_bounds(motion: Trajectory, left: Points, right: Points) -> np.ndarray:
    """Least and largest controls and rates of controls on pieces, (M, 4 k)."""
    if not motion.u.shape[2]:
        return np.empty((len(left.t), 0))
    ends = [_controls(motion, left.node, x.t) for x in (left, right)]
    k = np.minimum(motion.k[left.node], len(motion.u) - 1)
    u, nodes = motion.u[k], np.array(motion.rule.nodes)
    if u.shape[1] == 1 or not u.shape[2]:
        rates = np.zeros_like(ends[0])
    else:  # |Σ j a_j x^(j−1)| ≤ Σ j |a_j| in [0, 1]
        powers = np.linalg.inv(np.vander(nodes, increasing=True)) @ u
        rates = np.einsum("j,ijk->ik", np.arange(len(nodes)), np.abs(powers)) / abs(motion.h)
    middle = (ends[0] + ends[1]) / 2
    reach = rates * np.abs(right.t - left.t)[:, None] / 2
    return np.hstack([middle - reach, middle + reach, -rates, rates])

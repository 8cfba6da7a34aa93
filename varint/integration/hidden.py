"""What the nodes of a run do not show: forces that act for less than a step."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from varint.integration.force_bounds import bounds, bounds_of_many, push
from varint.results.trajectory import Trajectory
from varint.rules.rule import Rule, gauss
from varint.scene.system import System

PARTS = 8  # into which a part of a step is cut that may hide something, LEVELS times
LEVELS, MOST_PARTS = 10, 100_000
WITHIN = 4  # looks in each part, at the nodes of a Gauss rule
LOOKS = 2  # of those of the rule in a step: mostly they rule out that it hides anything
# |d²F/dt²| h² over |F|: of steps that hide no pulse, and of parts that show it to `WITHIN` looks
BENDS, SHOWN = 100.0, 1.0
NOTHING = 0.01  # of tol: what a force may do all along the run without being looked at
# groups of steps that bounds are made for at once, and steps whose forces these are compared to
GROUPS, SAMPLED = 8, 16
AT_ONCE = 20_000  # points of forces in one call
BLIND = 64  # parts into which steps are cut without such bounds


class Parts(NamedTuple):
    """Parts of steps, (M,) each: which step, where they begin and end as fractions of it."""

    step: np.ndarray
    begin: np.ndarray
    end: np.ndarray

    def at(self, which: np.ndarray) -> Parts:
        return Parts(*(x[which] for x in self))

    def cut(self, count: int) -> Parts:
        """Each into so many."""
        ends = self.begin + np.arange(count + 1)[:, None] / count * (self.end - self.begin)
        return Parts(np.tile(self.step, count), ends[:-1].ravel(), ends[1:].ravel())


def missed_impulse(
    system: System, rule: Rule, motion: Trajectory, scales: np.ndarray, tol: float
) -> float:
    """What a force that depends on time does between the times at which the rule looks at it.

    Where bounds do not rule out that the force bends sharply within a step, the step is cut into
    parts until they do, which finds a pulse however short. How far the rule's quadrature is off
    the impulse along the straight way between the nodes is carried on to the end of the run,
    relative to the scales. Zero for autonomous scenes, whose forces are met wherever the motion
    goes.
    """
    if system.structure.autonomous or len(motion) < 2:
        return 0.0
    count = len(motion) - 1
    every = Parts(np.arange(count), np.zeros(count), np.ones(count))
    mass = push(system)(motion.c, motion.q[:1], motion[:1].v, motion.t[:1, None])[1][0]
    mass = np.where(mass > 0, mass, mass.max(initial=0.0) or 1.0)
    left = abs(motion.t[-1] - motion.t[:-1])[:, None]
    error = left / mass / scales  # of an impulse in a step
    nothing = NOTHING * tol / (error * abs(motion.t[-1] - motion.t[0]))
    nodes, weights = np.array(rule.nodes), np.array(rule.weights)
    few = _few(nodes)
    if _smooth_at_once(system, motion, every, nodes[few], nothing):
        return 0.0
    size, _ = _impulses(system, motion, every, nodes[few], weights[few])
    if not _may_hide(system, motion, every, BENDS * size, nothing).any():
        return 0.0  # less than what all looks would show
    size, seen = _impulses(system, motion, every, nodes, weights)
    around = np.maximum(size, np.maximum(np.roll(size, 1, axis=0), np.roll(size, -1, axis=0)))
    usual = np.maximum(around, np.median(size, axis=0))
    doubtful = np.flatnonzero(_may_hide(system, motion, every, BENDS * usual, nothing))
    if not len(doubtful):
        return 0.0
    fine, true = gauss(WITHIN), np.zeros_like(seen)
    for some in _shown(system, motion, every.at(doubtful), usual, nothing):
        _, part = _impulses(system, motion, some, np.array(fine.nodes), np.array(fine.weights))
        np.add.at(true, some.step, part)
    missed = np.abs(true - seen)[doubtful]
    return float((missed * error[doubtful]).sum(axis=0).max())


@np.errstate(all="ignore")  # infinite where nothing is certain
def _smooth_at_once(
    system: System, motion: Trajectory, every: Parts, nodes: np.ndarray, nothing: np.ndarray
) -> bool:
    """Whether bounds for many steps at once show that none of them hides anything, beside the force
    in the middle of some of them, or the least of those that belong to these steps.
    """
    of_many, count = bounds_of_many(system), len(every.step)
    if of_many is None:
        return False
    few, groups = min(SAMPLED, count), min(GROUPS, count)
    some = np.arange(few) * count // few
    size, _ = _impulses(system, motion, every.at(some), nodes, np.zeros(len(nodes)))
    first = np.arange(groups) * count // groups
    last = np.arange(1, groups + 1) * count // groups
    h = np.diff(motion.t)[:, None]
    v = np.diff(motion.q, axis=0) / h
    ends = [f.reduceat(x, first) for x in (motion.q, v) for f in (np.minimum, np.maximum)]
    for f, x in zip((np.minimum, np.maximum), ends, strict=False):
        f(x, motion.q[last], out=x)
    begin, end = motion.t[first, None], motion.t[last, None]
    low, high, down, up = of_many(motion.c, *ends, begin, end)
    longest = np.maximum.reduceat(h**2, first)
    here = np.minimum.reduceat(size, np.searchsorted(some, first))
    bends = np.maximum(-down, up) * longest <= BENDS * np.maximum(here, np.median(size, axis=0))
    return bool((bends | (np.maximum(-low, high) <= nothing.min(axis=0))).all())


def looks_in_order(rule: Rule) -> tuple[np.ndarray, int]:
    """Parts of a step at which `missed_impulse` looks, and at how many of them first."""
    nodes = np.array(rule.nodes)
    first = nodes[_few(nodes)]
    return np.concatenate([first, np.setdiff1d(nodes, first)]), len(first)


def _few(nodes: np.ndarray) -> slice:
    return slice(None, None, max(len(nodes) // LOOKS, 1))


def _shown(
    system: System, motion: Trajectory, parts: Parts, usual: np.ndarray, nothing: np.ndarray
) -> Iterator[Parts]:
    """Parts that make up these, each small enough to be seen by a few looks."""
    if bounds(system) is None:
        yield parts.cut(BLIND)
        return
    for _ in range(LEVELS):
        parts = parts.cut(PARTS)
        hides = _may_hide(system, motion, parts, SHOWN * usual, nothing)
        yield parts.at(~hides)
        parts = parts.at(hides)
        if not len(parts.step) or len(parts.step) > MOST_PARTS // PARTS:
            break
    yield parts


@np.errstate(all="ignore")  # infinite where nothing is certain
def _may_hide(
    system: System, motion: Trajectory, parts: Parts, smooth: np.ndarray, nothing: np.ndarray
) -> np.ndarray:
    """Whether the force may bend by more than `smooth` within parts, and be more than nothing."""
    of_part = bounds(system)
    if of_part is None:
        return np.ones(len(parts.step), dtype=bool)
    ends = _on_way(motion, parts.step, parts.begin), _on_way(motion, parts.step, parts.end)
    (q0, _, t0), (q1, _, t1) = ends
    low, high, down, up = of_part(motion.c, q0, q1, t0, t1)
    bends = np.maximum(-down, up) * (t1 - t0) ** 2 <= smooth[parts.step]
    return ~(bends | (np.maximum(-low, high) <= nothing[parts.step])).all(axis=1)


def _on_way(
    motion: Trajectory, step: np.ndarray, x: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """q, v and t (M, 1) at fractions of steps, on the straight line between their nodes."""
    t, h = motion.t[step, None], (motion.t[step + 1] - motion.t[step])[:, None]
    q, way = motion.q[step], motion.q[step + 1] - motion.q[step]
    return q + x[:, None] * way, way / h, t + x[:, None] * h


def _impulses(
    system: System, motion: Trajectory, parts: Parts, nodes: np.ndarray, weights: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Largest |F| and the impulse ∫F dt by a quadrature, of each part, (M, n)."""
    count, n = len(parts.step), motion.q.shape[1]
    largest, total = np.zeros((2, count, n))
    at_once = max(AT_ONCE // max(count, 1), 1)  # a call takes as long as some hundred points
    for i in range(0, len(nodes), at_once):
        some = nodes[i : i + at_once]
        each = np.tile(parts.step, len(some))
        within = (parts.begin + some[:, None] * (parts.end - parts.begin)).ravel()
        force = push(system)(motion.c, *_on_way(motion, each, within))[0].reshape(
            len(some), count, n
        )
        for weight, one in zip(weights[i : i + at_once], force, strict=True):
            largest, total = np.maximum(largest, np.abs(one)), total + weight * one
    h = (motion.t[parts.step + 1] - motion.t[parts.step]) * (parts.end - parts.begin)
    return largest, total * h[:, None]

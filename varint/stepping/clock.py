"""The clock of a run with a time scale: its nodes, and states between them, at physical times."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from varint.between import require_within, steps_ahead
from varint.stepping.course import Course, step_functions
from varint.stepping.run import Task
from varint.system import System
from varint.trajectory import Event, Trajectory

if TYPE_CHECKING:
    from varint.compiled.kernel import Kernel

Ahead = Callable[[np.ndarray], tuple[np.ndarray, ...]]  # times → q, p, v and whole steps there

LOCATED = 4 * np.finfo(float).eps  # relative to |t|
MOST_ITERATIONS = 60


def physical(system: System, t0: float, inner: Trajectory) -> Trajectory:
    """The motion in physical time; the motion in fictitious time stays with it."""
    n = system.q.numel()
    return replace(
        inner,
        system=system,
        t=t0 + inner.q[:, n],
        q=inner.q[:, :n],
        p=inner.p[:, :n],
        c=inner.c[:-2],
        functions=partial(step_functions, inner.rule, system),
        events=(),
        fictitious=inner,
    )


def happened(system: System, t0: float, inner: Trajectory) -> tuple[Event, ...]:
    """The events up to the last node, at physical times."""
    before = [event for event in inner.events if (inner.t[-1] - event.time) * inner.h >= 0]
    if not before:
        return ()
    at = physical(system, t0, inner.at([event.time for event in before]))
    return tuple(
        replace(event, time=float(t), energy_before=float(e), energy_after=float(e))
        for event, t, e in zip(before, at.t, at.energy, strict=True)
    )


def reached(
    before: tuple[np.ndarray, ...], after: tuple[np.ndarray, ...], times: np.ndarray, ahead: Ahead
) -> tuple[np.ndarray, ...]:
    """τ, q, p and k where the clock of the rescaled motion shows `times`, each between two nodes.

    τ(t) by Hermite's cubic, then Newton's method on the clock with the rule's own sub-steps, dt/dτ = σ.

    Parameters
    ----------
    before, after : (τ, t, σ)
        Of the nodes before and after each time.
    times : array
    ahead : callable
        τ → q, p, v, k there, from the nodes before.
    """
    (a, ta, sa), (b, tb, sb) = before, after
    rise, passed = b - a, tb - ta
    x = (times - ta) / passed
    y = 1 - x
    tau = a + x * (x * (3 - 2 * x) * rise + passed * y * (y / sa - x / sb))
    low, high, close = a, b, LOCATED * np.maximum(np.abs(times), np.abs(passed))
    for _ in range(MOST_ITERATIONS):
        q, p, v, k = ahead(tau)
        off = times - q[:, -1]
        step = off / v[:, -1]
        good = (np.abs(off) <= close) | (np.abs(step) <= LOCATED * np.maximum(np.abs(tau), np.abs(rise)))
        if good.all():
            break
        short = step * rise > 0
        low, high = np.where(short, tau, low), np.where(short, high, tau)
        tau = np.where(good, tau, tau + step)
        tau = np.where((tau - low) * (high - tau) < 0, (low + high) / 2, tau)
    return tau, q, p, k


def _clock_of(inner: Trajectory) -> tuple[np.ndarray, ...]:
    """τ, t and σ = dt/dτ at the nodes."""
    return inner.t, inner.q[:, -1], inner.v[:, -1]


def ahead_of(motion: Trajectory, times: np.ndarray) -> tuple[np.ndarray, ...]:
    """q, p, v and k of every node carried on to a later time of its own, by steps of the same rule."""
    states = [motion.q.copy(), motion.p.copy(), motion.k.copy()]
    for _ in steps_ahead(motion, np.arange(len(motion)), times - motion.t, states):
        continue
    q, p, k = states
    return q, p, replace(motion, t=times, q=q, p=p, k=k, events=()).v, k


def ahead_by(kernel: Kernel, task: Task, near: Trajectory) -> Ahead:
    """The same of the first node alone, by the compiled loop."""
    from varint.stepping.native import one_step

    t, q, p, k = float(near.t[0]), near.q[0], near.p[0], near.k[:1]

    def ahead(times: np.ndarray) -> tuple[np.ndarray, ...]:
        found = one_step(kernel, task, t, q, p, float(times[0]) - t)
        return ahead_of(near[:1], times) if found is None else (*found[:, None], k)

    return ahead


def end_at(course: Course, near: Trajectory, time: float) -> tuple[np.ndarray, ...]:
    """τ, q, p, k of the one state between two nodes where the clock shows `time`."""
    ahead = ahead_by(course.kernel, course.task, near) if course.kernel else partial(ahead_of, near[:1])
    first, second = ([x[i : i + 1] for x in _clock_of(near)] for i in (0, 1))
    return reached(tuple(first), tuple(second), np.array((time,)), ahead)


def at_times(motion: Trajectory, times: np.ndarray) -> Trajectory:
    """The physical motion at physical times, from its motion in fictitious time."""
    inner = motion.fictitious
    assert inner is not None
    require_within(motion, times)
    clock = inner.q[:, -1]
    direction = 1.0 if inner.h > 0 else -1.0
    wanted = times - motion.t[0] + clock[0]
    node = np.searchsorted(direction * clock, direction * wanted, side="right") - 1
    node = np.clip(node, 0, max(len(inner) - 2, 0))
    left, right = inner[node], inner[np.minimum(node + 1, len(inner) - 1)]
    tau, q, p, k = reached(_clock_of(left), _clock_of(right), wanted, partial(ahead_of, left))
    found = replace(left, t=tau, q=q, p=p, k=k)
    return replace(physical(motion.system, motion.t[0] - clock[0], found), t=times)

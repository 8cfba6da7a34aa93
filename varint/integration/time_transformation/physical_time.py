"""The clock of a run with a time scale: its nodes, and states between them, at physical times."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import fields, replace
from functools import partial
from time import perf_counter
from typing import Any

import numpy as np

from varint.discrete.legendre import velocity_function
from varint.integration.many_steps import in_gear, steps_again
from varint.integration.state import NodeBlock
from varint.integration.trajectories import Run, moving_system, trajectory_of
from varint.numerics.arrays import over_columns
from varint.numerics.limits import CLOCK_ITERATIONS
from varint.results.dense_output import require_within, steps_ahead
from varint.results.records import Event, changed
from varint.results.trajectory import Trajectory
from varint.scene.system import System

Ahead = Callable[[Any], tuple[Any, ...]]  # times, or one time → q, p, v and whole steps there

# of a trajectory, what both times have
_KEPT = frozenset(x.name for x in fields(Trajectory))
STEPS_A_TIME = 2  # or more, until the clock shows it
LOCATED = 4 * np.finfo(float).eps  # relative to |t|


def in_physical_time(system: System, t0: float, inner: Trajectory) -> Trajectory:
    """The motion in physical time; the motion in fictitious time stays with it."""
    n, q, known = system.structure.n, inner.q, inner.__dict__
    motion = object.__new__(Trajectory)  # in half the time of `replace`, which short runs notice
    own = motion.__dict__
    own.update(known if known.keys() <= _KEPT else {x: known[x] for x in known if x in _KEPT})
    own.update(
        system=system,
        t=t0 + q[:, -1],
        q=q[:, :n],
        p=inner.p[:, :n],
        c=inner.c[: system.c.numel()],  # without slowest rate, E0 and σ0
        functions=steps_again(inner.rule),
        events=(),
        fictitious=inner,
        dense_output=at_times,
    )
    return motion


def physical_events(system: System, t0: float, inner: Trajectory) -> tuple[Event, ...]:
    """The events up to the last node, at physical times."""
    before = [event for event in inner.events if (inner.t[-1] - event.time) * inner.h >= 0]
    if not before:
        return ()
    at = in_physical_time(system, t0, inner.at([event.time for event in before]))
    return tuple(
        Event(t, event.kind, event.contact, event.impulse, e, e, q, v, p, v, p)
        for event, t, e, q, v, p in zip(
            before, *(x.tolist() for x in (at.t, at.energy, at.q, at.v, at.p)), strict=True
        )
    )


def reach_times(
    before: tuple[Any, ...], after: tuple[Any, ...], times: Any, ahead: Ahead
) -> tuple[Any, ...]:
    """τ, q, p and k where the clock of the rescaled motion shows `times`, each between two nodes;
    or one, a number.

    τ(t) by Hermite's cubic, then Newton's method on the clock with the rule's own sub-steps, dt/dτ
    = σ.

    Parameters
    ----------
    before, after : (τ, t, σ)
        Of the nodes before and after each time.
    times : array or float
    ahead : callable
        τ → q, p, v, k there, from the nodes before.
    """
    (a, ta, sa), (b, tb, sb) = before, after
    rise, passed = b - a, tb - ta
    x = (times - ta) / passed
    y = 1 - x
    tau = a + x * (x * (3 - 2 * x) * rise + passed * y * (y / sa - x / sb))
    low, high, close = a, b, LOCATED * np.maximum(abs(times), abs(passed))
    for _ in range(CLOCK_ITERATIONS):
        q, p, v, k = ahead(tau)
        off = times - q[..., -1]
        step = off / v[..., -1]
        good = (abs(off) <= close) | (abs(step) <= LOCATED * np.maximum(abs(tau), abs(rise)))
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


def carry_on(motion: Trajectory, times: np.ndarray) -> tuple[np.ndarray, ...]:
    """q, p, v and k of every node carried on to a later time of its own, by steps of the same
    rule.
    """
    states = [motion.q.copy(), motion.p.copy(), motion.k.copy()]
    for _ in steps_ahead(motion, np.arange(len(motion)), times - motion.t, states):
        continue
    q, p, k = states
    return q, p, replace(motion, t=times, q=q, p=p, k=k, events=()).v, k


def end_at(run: Run, near: NodeBlock, time: float) -> tuple[Any, ...]:
    """τ, q, p, k of the one state between two nodes where the clock shows `time`."""
    tau = run.problem.t0 + run.problem.h * near.k
    (v,) = over_columns(
        velocity_function(moving_system(run)), near.q, near.p, tau[:, None], run.problem.c
    )
    left, right = zip(tau, near.q[:, -1], v[:, -1], strict=True)
    return reach_times(left, right, time, _ahead_by(run, near, float(tau[0])))


def _ahead_by(run: Run, near: NodeBlock, first: float) -> Ahead:
    """τ → q, p, v and k there, from the first of two nodes: by the compiled loop where there is
    one.
    """
    from varint.integration.compiled_loop import one_step

    problem, q, p, k = run.problem, near.q[0], near.p[0], near.k[0]

    def ahead(tau: float) -> tuple[np.ndarray, ...]:
        found = one_step(run.kernel, problem, first, q, p, tau - first) if run.kernel else None
        if found is not None:
            return (*found, k)
        return tuple(x[0] for x in carry_on(trajectory_of(run, [near])[:1], np.array((tau,))))

    return ahead


def at_times(motion: Trajectory, times: np.ndarray) -> Trajectory:
    """The physical motion at physical times, from its motion in fictitious time."""
    inner = motion.fictitious
    assert inner is not None
    require_within(motion, times)
    clock = inner.q[:, -1]
    direction = 1.0 if inner.h > 0 else -1.0
    wanted = times - motion.t[0] + clock[0]
    at_once = _reach_at_once(inner, np.ascontiguousarray(wanted))
    if at_once is None:
        node = np.searchsorted(direction * clock, direction * wanted, side="right") - 1
        node = np.clip(node, 0, max(len(inner) - 2, 0))
        left, right = inner[node], inner[np.minimum(node + 1, len(inner) - 1)]
        ends = _clock_of(left), _clock_of(right)
        at_once = reach_times(*ends, wanted, partial(carry_on, left))
    tau, q, p, k = at_once
    found = changed(inner, t=tau, q=q, p=p, k=k, events=())
    return replace(in_physical_time(motion.system, motion.t[0] - clock[0], found), t=times)


def _reach_at_once(inner: Trajectory, wanted: np.ndarray) -> tuple[np.ndarray, ...] | None:
    """`reach_times` in one call of the core; None where another way is to be taken."""
    from varint.codegen.cache import CompileError
    from varint.codegen.times import states_at_clock
    from varint.integration.compiled_loop import kernel_in_gear
    from varint.integration.gears import kernel_after
    from varint.integration.many_times import within_now

    if getattr(inner.functions.ends, "func", None) is not in_gear or inner.u.shape[2]:
        return None
    if len(inner) < 2:
        return None
    if inner.active_set is not None or inner.sizes is not None or inner.system.rays:
        return None
    kernel = kernel_in_gear(inner.system, inner.rule)
    if kernel is None or kernel.opening:
        return None
    nodes = inner.t, inner.q, inner.p, inner.k
    if not all(x.flags.c_contiguous for x in nodes) or inner.k.dtype != np.int64:
        return None
    paces = np.ascontiguousarray(inner.v[:, -1])
    steps, looking = within_now(inner.system, inner.rule, STEPS_A_TIME * len(wanted))
    steps = steps._replace(fewest=1)
    now, found = perf_counter(), None
    with suppress(CompileError):
        found = states_at_clock(kernel, nodes, paces, inner.c, inner.h, wanted, steps)
    if looking:
        kernel_after(looking, perf_counter() - now, 0.0)
    return found

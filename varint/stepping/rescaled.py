"""Runs with a time scale: fixed steps of the rescaled scene, nodes and dense output at physical times."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np

from varint.arrays import call
from varint.between import require_within, steps_ahead
from varint.errors import ConvergenceError, InputError
from varint.expressions import in_own_symbols
from varint.legendre import velocity_function
from varint.rules import Rule
from varint.stepping.initial import initial_task, number
from varint.stepping.plan import default_rule
from varint.stepping.step_function import action_function, step_function
from varint.stepping.time_scale import ENERGY, START, Rescaled, rescaled
from varint.system import System
from varint.trajectory import Event, Trajectory

FIRST_CHUNK = 200  # steps before the mean rate of the clock is known well enough to look further ahead
PATIENCE = 8  # times the steps that the pace of the start would take
MARGIN = 1.02  # more steps than that rate asks for: they are cheaper than another look
LOCATED = 4 * np.finfo(float).eps  # relative to |t|
MOST_ITERATIONS = 60
OFF_LEVEL = 0.1  # of the largest kinetic energy: the motion is another one


def rescaled_motion(
    run: Callable[..., Trajectory], system: System, rule: Rule | None, sigma: Any, *, q0: Any, v0: Any, p0: Any,
    h: float | None, steps: int | None, duration: float | None, t0: float, params: Any, save_every: int, until: Any,
    events: Any, options: dict[str, Any],
) -> Trajectory:  # fmt: skip
    """`simulate` with a time scale: h is the step of τ, dt = σ(q) dτ; nodes at physical times."""
    scene = rescaled(system, sigma)
    if h is None or (steps is None) == (duration is None):
        raise InputError("with time_scale give h, the step of the fictitious time, and either steps or duration")
    total = None if duration is None else number("duration", duration)
    if total is not None and not total * number("h", h) > 0:
        raise InputError(f"h={h} and duration={duration} must have the same sign and not be zero")
    task = initial_task(
        system, rule or default_rule(scene.system), q0=q0, v0=v0, p0=p0, h=h, steps=1 if steps is None else steps,
        duration=None, t0=t0, u=None, params=params, save_every=save_every,
    )  # fmt: skip
    t = np.array([task.t0])
    velocity = (
        call(velocity_function(system), task.q0, task.p0, t, task.c)[0] if v0 is None else np.array(v0, float).ravel()
    )
    (energy,), (start_scale,) = call(scene.energy, task.q0, velocity, t, task.c)
    if not (np.isfinite(start_scale) and start_scale > 0):
        raise InputError(f"time_scale must be positive, but it is {start_scale:g} at the start")
    values = dict(params or {}) | {ENERGY: energy, START: start_scale}
    clock = scene.system.q[-1]

    def watched(wanted: Any, what: str) -> Any:
        expression, *direction = wanted if isinstance(wanted, tuple) else (wanted,)
        inside = scene.translate(in_own_symbols(expression, system, what))
        inside = ca.substitute(inside, clock, clock + task.t0) if task.t0 else inside
        return (inside, *direction) if direction else inside

    stop = None if until is None else watched(until, "until")
    watches = {name: watched(wanted, name) for name, wanted in (events or {}).items()}

    def advance(inner: Trajectory | None, count: int, every: int) -> Trajectory:
        state = (
            (np.append(task.q0, 0.0), np.append(task.p0, start_scale)) if inner is None else (inner.q[-1], inner.p[-1])
        )
        at = 0.0 if inner is None else float(inner.t[-1])
        try:
            more = run(
                scene.system, rule, q0=state[0], p0=state[1], h=task.h, steps=count, t0=at, params=values,
                save_every=every, until=stop, events=watches, **options,
            )  # fmt: skip
        except ConvergenceError as error:
            found = _joined(inner, error.trajectory)
            motion = _physical(system, task.t0, found)
            raise ConvergenceError(
                f"in fictitious time (dt = σ dτ): {error}; it is physical time t = {motion.t[-1]:g}",
                step=int(found.k[-1]), time=float(motion.t[-1]), residual=error.residual, trajectory=motion,
            ) from None  # fmt: skip
        return _joined(inner, more)

    if total is None:
        inner = advance(None, task.steps, save_every)
    else:
        inner = _for_duration(scene, advance, total, task.h, start_scale, save_every, stop is not None)
    _require_level(scene, inner)
    return replace(_physical(system, task.t0, inner), events=_happened(system, task.t0, inner))


def _happened(system: System, t0: float, inner: Trajectory) -> tuple[Event, ...]:
    """The events up to the last node, at physical times."""
    before = [event for event in inner.events if (inner.t[-1] - event.time) * inner.h >= 0]
    if not before:
        return ()
    at = _physical(system, t0, inner.at([event.time for event in before]))
    return tuple(
        replace(event, time=float(t), energy_before=float(e), energy_after=float(e))
        for event, t, e in zip(before, at.t, at.energy, strict=True)
    )


def _for_duration(
    scene: Rescaled, advance, total: float, h: float, scale: float, every: int, may_stop: bool
) -> Trajectory:
    """Steps until the physical time `total`, with one shorter step at the end."""
    expected = total / (h * scale)
    inner: Trajectory | None = None
    ahead: float = min(FIRST_CHUNK, math.ceil(MARGIN * expected))
    while True:
        asked = max(1, math.ceil(ahead / every)) * every
        before = 0 if inner is None else int(inner.k[-1])
        inner = advance(inner, asked, every)
        if inner.q[-1, -1] / inner.t[-1] <= 0:
            return inner
        if abs(inner.q[-1, -1]) >= abs(total) or (may_stop and inner.k[-1] < before + asked):
            break
        done = int(inner.k[-1])
        if done > PATIENCE * (expected + FIRST_CHUNK):  # does the clock stand still where σ vanishes?
            _require_level(scene, inner)
        ahead = min(MARGIN * (total - inner.q[-1, -1]) / (inner.q[-1, -1] / done) + 1, 16 * done)
    if abs(inner.q[-1, -1]) < abs(total):
        return inner
    kept = int(np.searchsorted(np.abs(inner.q[:, -1]), abs(total) * (1 - LOCATED)))  # nodes before the end
    near = inner[kept - 1 : kept + 1]
    if near.k[1] - near.k[0] > 1:  # the nodes between them
        fine = advance(near[:1], int(near.k[1] - near.k[0]), 1)
        i = int(np.searchsorted(np.abs(fine.q[:, -1]), abs(total) * (1 - LOCATED)))
        near = fine[i - 1 : i + 1]
    return _appended(inner[:kept], _reached(near[:1], near[1:], np.array([total])))


def _require_level(scene: Rescaled, inner: Trajectory) -> None:
    """Time must go on, and the motion stay on the energy level that σ (H − E0) = 0 means as long as σ is not near 0."""
    n = inner.q.shape[1] - 1
    passed = np.diff(inner.q[:, n])
    pace = passed / np.diff(inner.t)
    slowest = int(np.argmin(pace))
    if not pace[slowest] > 0:
        raise InputError(
            f"time_scale must stay positive, but after t = {inner.q[slowest, n]:g} it is not: time does not go on"
        )
    kinetic = np.abs((inner.p[:-1, :n] * np.diff(inner.q[:, :n], axis=0)).sum(axis=1) / passed).max()
    c, start = inner.c[:-2].copy(), inner.c[-2]
    for state in (inner[slowest : slowest + 1], inner[slowest + 1 : slowest + 2]):
        q, v = state.q[0], state.v[0]
        energy = call(scene.energy, q[:n].copy(), v[:n] / v[n], np.zeros(1), c)[0][0]
        if not abs(energy - start) <= OFF_LEVEL * kinetic:
            raise InputError(
                f"the energy is {energy:g} at t = {q[n]:g} and was {start:g} at the start: time_scale comes "
                "too close to zero there, or h is too large; choose another time_scale or a smaller h"
            )


def _joined(inner: Trajectory | None, more: Trajectory) -> Trajectory:
    if inner is None:
        return more
    joined = _appended(inner, replace(more, k=more.k + inner.k[-1])[1:])
    stats = dict(more.stats) | {
        name: pick((inner.stats[name], more.stats[name]))
        for name, pick in (("steps", sum), ("iterations", sum), ("seconds", sum), ("residual", max))
        if name in inner.stats and name in more.stats
    }
    return replace(joined, stats=stats, events=inner.events + more.events)


def _appended(first: Trajectory, second: Trajectory) -> Trajectory:
    fields: tuple = ("t", "q", "p", "k") + (() if first.phase is None else ("phase",))
    joined: dict[str, Any] = {n: np.concatenate([getattr(first, n), getattr(second, n)]) for n in fields}
    return replace(first, **joined)


def _reached(left: Trajectory, right: Trajectory, times: np.ndarray) -> Trajectory:
    """Nodes of the rescaled motion where its clock shows `times`, each between a node of `left` and one of `right`.

    τ(t) by Hermite's cubic, then Newton's method on the clock with the rule's own sub-steps, dt/dτ = σ.
    """
    a, b = left.t, right.t
    ta, tb, sa, sb = left.q[:, -1], right.q[:, -1], left.v[:, -1], right.v[:, -1]
    x = (times - ta) / (tb - ta)
    rise = b - a
    tau = a + x**2 * (3 - 2 * x) * rise + (tb - ta) * (x * (1 - x) ** 2 / sa - x**2 * (1 - x) / sb)
    low, high = a.copy(), b.copy()
    for _ in range(MOST_ITERATIONS):
        found = _ahead(left, tau)
        off = times - found.q[:, -1]
        step = off / found.v[:, -1]
        good = np.abs(off) <= LOCATED * np.maximum(np.abs(times), np.abs(tb - ta))
        good |= np.abs(step) <= LOCATED * np.maximum(np.abs(tau), np.abs(rise))
        if good.all():
            break
        short = step * rise > 0
        low, high = np.where(short, tau, low), np.where(short, high, tau)
        tau = np.where(good, tau, tau + step)
        tau = np.where((tau - low) * (high - tau) < 0, (low + high) / 2, tau)
    return found


def _ahead(motion: Trajectory, times: np.ndarray) -> Trajectory:
    """Every node carried on to a later time of its own, by steps of the same rule."""
    states = [motion.q.copy(), motion.p.copy(), motion.k.copy()]
    for _ in steps_ahead(motion, np.arange(len(motion)), times - motion.t, states):
        continue
    q, p, k = states
    return replace(motion, t=times, q=q, p=p, k=k, events=())


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
    found = _reached(inner[node], inner[np.minimum(node + 1, len(inner) - 1)], wanted)
    return replace(_physical(motion.system, motion.t[0] - clock[0], found), t=times, events=())


def _physical(system: System, t0: float, inner: Trajectory) -> Trajectory:
    """The motion in physical time; the motion in fictitious time stays with it."""
    n, rule = system.q.numel(), inner.rule
    return replace(
        inner,
        system=system,
        t=t0 + inner.q[:, n],
        q=inner.q[:, :n],
        p=inner.p[:, :n],
        c=inner.c[:-2],
        functions=lambda scene=system: (step_function(scene, rule), action_function(scene, rule)),
        events=(),
        fictitious=inner,
    )

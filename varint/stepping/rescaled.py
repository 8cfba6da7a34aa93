"""Runs with a time scale: fixed steps of the rescaled scene, nodes and dense output at physical times."""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import partial
from time import perf_counter
from typing import Any

import casadi as ca
import numpy as np

from varint.arrays import call, over_columns
from varint.errors import ConvergenceError, InputError
from varint.expressions import in_own_symbols
from varint.grid import MOST_STEPS, checked_steps
from varint.legendre import velocity_function
from varint.rules import Rule
from varint.stepping.backend import blocks_of
from varint.stepping.clock import LOCATED, end_at, happened, physical
from varint.stepping.course import Course, course_of, first_node, moving, trajectory, travelled
from varint.stepping.events import watched, watched_events
from varint.stepping.initial import LEVEL, initial_task, number
from varint.stepping.jump import energy_jump
from varint.stepping.plan import plan
from varint.stepping.run import Block, Task
from varint.stepping.time_scale import Rescaled, rescaled
from varint.system import System, per_system
from varint.trajectory import Trajectory

FIRST_CHUNK = 200  # steps before the mean rate of the clock is known well enough to look further ahead
PATIENCE = 8  # times the steps that the pace of the start would take
CAREFUL = 0.95  # of the steps that this rate asks for, so that the end is not passed unseen
MARGIN = 1.02  # more steps than that rate asks for where all are seen: they are cheaper than another look
OFF_LEVEL = 0.1  # of the largest kinetic energy: the motion is another one


def rescaled_motion(
    system: System, rule: Rule | None, sigma: Any, *, q0: Any, v0: Any, p0: Any, h: float | None, steps: int | None,
    duration: float | None, t0: float, params: Any, save_every: int, until: Any, events: Any, progress: bool | None,
    backend: str, tol: float | None,
) -> Trajectory:  # fmt: skip
    """`simulate` with a time scale: h is the step of τ, dt = σ(q) dτ; nodes at physical times."""
    began = perf_counter()
    scene = rescaled(system, sigma)
    if h is None or (steps is None) == (duration is None):
        raise InputError("with time_scale give h, the step of the fictitious time, and either steps or duration")
    total = None if duration is None else number("duration", duration)
    if total is not None and not total * number("h", h) > 0:
        raise InputError(f"h={h} and duration={duration} must have the same sign and not be zero")
    chosen = plan(scene.system, rule)
    task = initial_task(
        system, chosen.rule, q0=q0, v0=v0, p0=p0, h=h, steps=1 if steps is None else steps, duration=None, t0=t0,
        u=None, params=params, save_every=save_every, level=0.0 if tol is None else LEVEL * tol,
    )  # fmt: skip
    energy, start_scale = _start(system, scene, task, v0)
    checked_steps(task.t0, task.h * start_scale, task.steps)
    inside = partial(_inside, system, scene, task.t0)
    stop = None if until is None else watched("until", inside(until, "until"))
    if isinstance(events, Mapping):
        events = {name: inside(wanted, name) for name, wanted in events.items()}
    watches = watched_events(events)
    pace = 0.0 if total is None else total / float(task.h * start_scale)
    if pace > MOST_STEPS:
        raise InputError(f"duration={total:g} takes {pace:.3g} steps of h={h}, more than any run can; take larger ones")
    count = task.steps if total is None else max(1, math.ceil(pace))
    course = course_of(
        scene.system,
        chosen,
        task._replace(
            q0=np.append(task.q0, 0.0),
            p0=np.append(task.p0, start_scale),
            t0=0.0,
            steps=count,
            u=np.empty((count, 1, 0)),
            c=np.append(task.c, (energy, start_scale)),
        ),
        began,
        backend=backend,
    )
    if total is not None:
        course = course._replace(blocks=_blocks_until(scene, course, total))
    try:
        inner = travelled(course, stop=stop, watches=watches, progress=progress)
    except ConvergenceError as error:
        motion = physical(system, task.t0, error.trajectory)
        raise ConvergenceError(
            f"in fictitious time (dt = σ dτ): {error}; it is physical time t = {motion.t[-1]:g}",
            step=error.step, time=float(motion.t[-1]), residual=error.residual, trajectory=motion,
        ) from None  # fmt: skip
    _require_level(scene, course, inner)
    if total is not None and abs(inner.q[-1, -1]) >= abs(total):
        inner = _ended(course, inner, total)
    motion = physical(system, task.t0, inner)
    if jump := energy_jump(inner):
        warnings.warn(jump.alarm(task.h), stacklevel=3)
    return replace(motion, events=happened(system, task.t0, inner)) if inner.events else motion


def _start(system: System, scene: Rescaled, task: Task, v0: Any) -> tuple[float, float]:
    """Energy and σ at the start."""
    t = np.array([task.t0])
    if v0 is None:
        (velocity,) = call(velocity_function(system), task.q0, task.p0, t, task.c)
    else:
        velocity = np.array(v0, dtype=float).ravel()
    (energy,), (scale,) = call(scene.energy, task.q0, velocity, t, task.c)
    if not (math.isfinite(scale) and scale > 0):
        raise InputError(f"time_scale must be positive, but it is {scale:g} at the start")
    return energy, scale


def _inside(system: System, scene: Rescaled, t0: float, wanted: Any, what: str) -> Any:
    """What is watched, in the symbols of the rescaled scene, whose clock starts at zero."""
    expression, *direction = wanted if isinstance(wanted, tuple) else (wanted,)
    found = scene.translate(in_own_symbols(expression, system, what))
    clock = scene.system.q[-1]
    found = ca.substitute(found, clock, clock + t0) if t0 else found
    return (found, *direction) if direction else found


def _blocks_until(scene: Rescaled, course: Course, total: float) -> Iterator[Block]:
    """Blocks until the physical time has passed `total`, more and more of its steps saved towards the end.

    The clock's mean rate says how many steps it takes; the last of them are all kept, so that the end lies in one.
    """
    task, every = course.task, course.task.save_every
    own = moving(course)
    expected, done, at = task.steps, 0, None
    ahead: float = expected
    while True:
        count, each = max(1, int(min(ahead, FIRST_CHUNK) if not done else CAREFUL * ahead)), every
        if ahead <= FIRST_CHUNK:
            count, each = math.ceil(MARGIN * ahead) + 1, 1
        elif done % every == 0 and count >= every:
            count -= count % every
        else:  # within the interval between two nodes
            count = min(count, every - done % every)
            each = done + count + 1
        for block in blocks_of(
            own, course.plan.rule, task._replace(steps=done + count, save_every=each), course.kernel, at
        ):
            yield block
            at, last = block.after, block
        clock, done = float(last.q[-1, -1]), int(last.k[-1])
        if clock / task.h <= 0 or abs(clock) >= abs(total):
            return
        if done > PATIENCE * (expected + FIRST_CHUNK):  # does the clock stand still where σ vanishes?
            _require_level(scene, course, trajectory(course, course.nodes))
        ahead = min((total - clock) / (clock / done), 16 * done)


def _ended(course: Course, inner: Trajectory, total: float) -> Trajectory:
    """The nodes before the physical time `total`, and one there, by a shorter step from the last of them."""
    kept, near = _around(inner, total)
    if near.k[1] - near.k[0] > 1:  # the nodes between them
        first, last = near.k.tolist()
        part = course.task._replace(q0=near.q[0], p0=near.p[0], first=first, steps=last, save_every=1)
        fine = trajectory(course, [first_node(part), *blocks_of(moving(course), course.plan.rule, part, course.kernel)])
        _, near = _around(fine, total)
    end = end_at(course, near, total)
    wanted = np.flatnonzero(inner.k[:kept] % course.task.save_every == 0) if course.task.save_every > 1 else slice(kept)
    before = (inner.t, inner.q, inner.p, inner.k)
    t, q, p, k = (np.concatenate((x[wanted], np.array(y)[None])) for x, y in zip(before, end, strict=True))
    phase = None if inner.phase is None else np.append(inner.phase[wanted], inner.phase[kept - 1])
    return replace(inner, t=t, q=q, p=p, k=k, phase=phase)


def _around(inner: Trajectory, total: float) -> tuple[int, Block]:
    """How many nodes there are before the physical time `total`, and the two around it."""
    kept = int(np.searchsorted(np.abs(inner.q[:, -1]), abs(total) * (1 - LOCATED)))
    two = slice(kept - 1, kept + 1)
    return kept, Block(inner.k[two], inner.q[two], inner.p[two], 0.0, 2)


def _require_level(scene: Rescaled, course: Course, inner: Trajectory) -> None:
    """Time must go on, and the motion stay on the energy level that σ (H − E0) = 0 means as long as σ is not near 0."""
    if len(inner) < 2:
        return
    n, q, p = inner.q.shape[1] - 1, inner.q, inner.p
    rise = q[1:] - q[:-1]
    passed = rise[:, n]
    pace = passed / (inner.t[1:] - inner.t[:-1])
    slowest = int(pace.argmin())
    if not pace[slowest] > 0:
        raise InputError(
            f"time_scale must stay positive, but after t = {q[slowest, n]:g} it is not: time does not go on"
        )
    start, two = inner.c[-2], slice(slowest, slowest + 2)
    (energies,) = over_columns(_level_function(moving(course), scene), q[two], p[two], inner.c)
    here = abs(p[slowest, :n].dot(rise[slowest, :n]) / passed[slowest])  # kinetic energy: at most the largest one
    if not np.abs(energies - start).max() <= OFF_LEVEL * here:
        here = np.abs(np.einsum("ij,ij->i", p[:-1, :n], rise[:, :n]) / passed).max()
    for energy, clock in zip(energies[:, 0].tolist(), q[two, n].tolist(), strict=True):
        if not abs(energy - start) <= OFF_LEVEL * here:
            raise InputError(
                f"the energy is {energy:g} at t = {clock:g} and was {start:g} at the start: time_scale comes "
                "too close to zero there, or h is too large; choose another time_scale or a smaller h"
            )


@per_system
def _level_function(moving: System, scene: Rescaled) -> ca.Function:
    """(q, p, c) of the rescaled scene that moves → energy of the original one."""
    n, velocity = moving.structure.n - 1, velocity_function(moving)
    q, p, c = (ca.MX.sym(name, size) for name, size in zip("qpc", (n + 1, n + 1, moving.c.numel()), strict=True))
    v, t = velocity(q, p, 0, c), ca.DM.zeros(1)
    return ca.Function("level", [q, p, c], [scene.energy(q[:n], v[:n] / v[n], t, c[:-2])[0]])

"""Runs in fictitious time until a physical one as most are asked for: a start, a step, a duration,
by one call of the core.

What follows from the scene alone is looked up once. `transformed_run` does the same where more is
asked for, or something is not as it should be, and says what.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from time import perf_counter
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from varint.codegen.cache import CompileError
from varint.codegen.kernel import Kernel
from varint.codegen.rows import RowFunction, row_function_or_none
from varint.codegen.until import Entries, Until, entries_of, run_until
from varint.discrete.legendre import velocity_function
from varint.integration.backend import kernel_for
from varint.integration.compiled_loop import POOR, scheme_of
from varint.integration.gears import BY_STAGES, gears_with, kernel_after, kernel_now
from varint.integration.plain_start import (
    asks_for_no_more,
    begin_in,
    is_plain,
    is_plain_number,
    room_of,
    rooms,
)
from varint.integration.plan import Plan, plan
from varint.integration.problem import LEVEL, InitialValueProblem, RunOptions, Start
from varint.integration.time_transformation.fictitious_start import slowest_rate
from varint.integration.time_transformation.local_rate import local_rate
from varint.integration.time_transformation.physical_end import FIRST_CHUNK, OFF_LEVEL, PATIENCE
from varint.integration.time_transformation.physical_time import in_physical_time
from varint.integration.time_transformation.rate_pilot import rate_pilot
from varint.integration.time_transformation.time_scale import TransformedScene, transformed_scene
from varint.integration.trajectories import plain_motion_of
from varint.numerics.arrays import hand_over
from varint.numerics.limits import check_steps
from varint.results.trajectory import Trajectory
from varint.rules.rule import Rule
from varint.scene.memory import per_system
from varint.scene.system import System

BACKENDS = "auto", "compiled", "native"


def physical_call(
    system: System, rule: Rule | None, sigma: Any, start: Start, options: RunOptions
) -> tuple[Trajectory, bool] | None:
    """The motion, and whether its energy stays; None where it is no such run, or comes to no good
    end, and another way is to be taken.
    """
    began, h, total = perf_counter(), options.h, options.duration
    every, backend = options.save_every, options.backend
    if options.steps is not None or options.progress or every < 1 or backend not in BACKENDS:
        return None
    if not (is_plain_number(h) and is_plain_number(total) and h * total > 0):  # type: ignore[operator]
        return None
    if not asks_for_no_more(rule, start, options._replace(save_every=1, backend="auto")):
        return None
    scene = transformed_scene(system, sigma)
    own = isinstance(sigma, str)
    if not is_plain(system) or (own and local_rate(system).reason):
        return None
    h, total = float(h), float(total)  # type: ignore[arg-type]
    called = called_on(scene.system, scene, rule)
    pool = rooms(system, False)
    room = pool.pop() if pool else room_of(system, False)
    began_in = called.starts.pop() if called.starts else _start_of(system, scene)
    try:
        c = begin_in(room, system, start)
        if c is None:
            return None
        slowest = 0.0
        if own:
            pilot = rate_pilot(system, room.q, room.v, c, total, h < 0)
            slowest = slowest_rate(pilot, total)
        pace = _begin(began_in, room.q, room.v, float(start.t0), c, slowest)
        n = len(room.q)
        x = np.empty(2 * n + 2)
        x[:n], x[n], x[n + 1 : -1], x[-1] = room.q, 0.0, room.values[:n], pace
        constants = began_in.inner.copy()
    finally:
        pool.append(room)
        called.starts.append(began_in)
    if not 0 < pace < math.inf:
        return None
    check_steps(start.t0, h * pace, 1)
    level = 0.0 if options.iteration_tol is None else LEVEL * options.iteration_tol
    u = np.empty((1, 1, 0))
    problem = InitialValueProblem(
        x[: n + 1], x[n + 1 :], 0.0, h, 1, 1, u, constants, 1, level=level
    )
    found = until_end(called, scene, problem, total, total / (h * pace), backend)
    if found is None:
        return None
    inner = inner_motion(called, scene, problem, found, every, perf_counter() - began)
    return in_physical_time(system, start.t0, inner), found.until.quiet


class Ended(NamedTuple):
    """What the core has found, and with which loop."""

    until: Until
    kernel: Kernel


def until_end(
    called: Called,
    scene: TransformedScene,
    problem: InitialValueProblem,
    total: float,
    expected: float,
    backend: str,
) -> Ended | None:
    """The run of the problem until the physical time; None where another way is to be taken."""
    energies = energies_of(scene.system, scene)
    kernel = called.kernel(scene.system, problem, backend)
    entries = None if kernel is None or energies is None else called.entries_on(kernel, energies)
    if kernel is None or entries is None:
        return None
    now = perf_counter()
    found = run_until(
        entries,
        np.concatenate((problem.q0, problem.p0)),
        problem.c,
        h=problem.h,
        level=problem.level,
        total=total,
        expected=expected,
        patience=PATIENCE * (expected + FIRST_CHUNK),
        energy=float(problem.c[-2]),
        off=OFF_LEVEL,
    )
    if backend == "auto" and kernel.scene:
        gears = gears_with(scene.system, called.plan.rule, called.scheme, kernel)
        if gears:
            kernel_after(gears, perf_counter() - now, 0.0)
    if found is None or found.iterations > called.most * len(found.nodes):
        return None
    return Ended(found, kernel)


def inner_motion(
    called: Called,
    scene: TransformedScene,
    problem: InitialValueProblem,
    found: Ended,
    every: int,
    seconds: float,
) -> Trajectory:
    """The motion in fictitious time with every so many of the nodes, and the last one."""
    nodes, time, iterations, residual, _ = found.until
    count = len(nodes) - 1
    k = np.arange(count + 1)
    t = problem.h * k
    k[-1], t[-1] = count - 1, time
    if every > 1:
        wanted = np.append(np.arange(0, count, every), count)
        nodes, k, t = nodes[wanted], k[wanted], t[wanted]
    q, p = nodes[:, 0], nodes[:, 1]
    grid = problem.h, 0.0, np.empty((count, 1, 0)), problem.c
    work = int(iterations), residual
    return plain_motion_of(
        scene.system, called.plan, found.kernel, (k, t, q, p), grid, work, seconds=seconds
    )


@dataclass(eq=False)
class Called:
    """Of a rescaled scene and a rule: the plan, how many iterations a step may take, and the loops
    that ran, with what is called of them.
    """

    plan: Plan
    scheme: Any
    most: float
    starts: list[_Start] = field(default_factory=list)
    seen: dict[str, Kernel | None] = field(default_factory=dict)
    last: tuple[Kernel | None, Entries | None] = (None, None)

    def kernel(self, system: System, problem: InitialValueProblem, backend: str) -> Kernel | None:
        """The loop of a backend, the best one that is there."""
        kernel = self.seen.get(backend)
        if kernel is None:
            kernel = self.seen[backend] = kernel_for(system, self.plan.rule, problem, backend)
        if kernel is None or backend != "auto":
            return kernel
        gears = gears_with(system, self.plan.rule, self.scheme, kernel)
        return kernel_now(gears) if gears else kernel

    def entries_on(self, kernel: Kernel, energies: RowFunction) -> Entries | None:
        """What is called; None where the core cannot."""
        if kernel is not self.last[0]:
            entries = None
            if not (kernel.opening or kernel.note[0]):
                try:
                    entries = entries_of(kernel, energies)
                except CompileError:
                    entries = None
            self.last = kernel, entries
        return self.last[1]


@per_system
def called_on(moving: System, scene: TransformedScene, rule: Rule | None) -> Called:
    """What is called of a rescaled scene with a rule, or with the one that suits it."""
    chosen = plan(moving, rule)
    scheme = scheme_of(moving, chosen.rule)
    return Called(chosen, scheme, POOR if scheme is BY_STAGES else math.inf)


@per_system
def energies_of(moving: System, scene: TransformedScene) -> RowFunction | None:
    """(q, p) → energy of the original scene and |p·dq/dt|, energy of the rescaled one and its
    |p·v|; None where they are no data.
    """
    velocity = velocity_function(moving)
    if not velocity.is_a("SXFunction"):
        return None
    s, n = moving, moving.structure.n - 1
    p, none = ca.SX.sym("p", n + 1), ca.SX.zeros(1)
    v = velocity(s.q, p, none, s.c)
    energy, _ = scene.energy(s.q[:n], v[:n] / v[n], none, s.c[:-3], s.c[-3])
    (whole,) = ca.substitute([s.energy], [s.v], [v])
    size = ca.fabs(ca.dot(p[:n], v[:n]) / v[n])
    results = [energy, size, whole, ca.fabs(ca.dot(p, v))]
    return row_function_or_none("level", [s.q, p], s.c, [ca.densify(x) for x in results])


class _Start(NamedTuple):
    """Memory for a start in fictitious time: q, v, t, c and the slowest rate, from which `begin`
    makes energy and time scale; `inner` are all parameters of the rescaled scene.
    """

    q: np.ndarray
    v: np.ndarray
    t: np.ndarray
    inner: np.ndarray
    scale: np.ndarray
    begin: Any
    held: Any


def _start_of(system: System, scene: TransformedScene) -> _Start:
    n, many = system.q.numel(), system.c.numel()
    q, v, t, inner, scale = (np.zeros(k) for k in (n, n, 1, many + 3, 1))
    buffer, trigger = scene.energy.buffer()
    inputs = q, v, t, inner[:many], inner[many : many + 1]
    outputs = inner[many + 1 : many + 2], scale
    hand_over(buffer, inputs, outputs)
    return _Start(q, v, t, inner, scale, trigger, (buffer, inputs, outputs))


def _begin(
    start: _Start, q: np.ndarray, v: np.ndarray, t0: float, c: np.ndarray, slowest: float
) -> float:
    """σ at the start, whose energy and parameters are then in `inner`."""
    start.q[:], start.v[:], start.t[0] = q, v, t0
    start.inner[:-3], start.inner[-3] = c, slowest
    start.begin()
    start.inner[-1] = start.scale[0]
    return float(start.scale[0])

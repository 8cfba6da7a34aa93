"""Runs in fictitious time until a physical one as most are asked for: a start, a step, a duration,
by one call of the core.

What follows from the scene alone is looked up once. `transformed_run` does the same where more is
asked for, or something is not as it should be, and says what.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from time import perf_counter
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from varint.codegen.cache import CompileError
from varint.codegen.kernel import Kernel, new_address
from varint.codegen.rows import RowFunction, row_function_or_none
from varint.codegen.until import Entries, Until, entries_of, run_until
from varint.discrete.legendre import velocity_function
from varint.integration.compiled_loop import POOR, kernel_of, native_kernel, scheme_of
from varint.integration.gears import BY_STAGES, Gears, gears_of, kernel_after, kernel_now
from varint.integration.plain_start import (
    Room,
    asks_for_nodes,
    begin_in,
    is_plain,
    is_plain_number,
    room_of,
)
from varint.integration.plan import Plan, plan
from varint.integration.problem import LEVEL, RunOptions, Start
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

LOOPS = {"compiled": kernel_of, "native": native_kernel}
BACKENDS = "auto", *LOOPS


def physical_call(
    system: System, rule: Rule | None, sigma: Any, start: Start, options: RunOptions
) -> tuple[Trajectory, bool] | None:
    """The motion, and whether its energy stays; None where it is no such run, or comes to no good
    end, and another way is to be taken.
    """
    began, h, total, every = perf_counter(), options.h, options.duration, options.save_every
    waits = options.progress is None or options.progress is False
    if not (waits and options.steps is None and is_plain_number(h) and is_plain_number(total)):
        return None
    if not (isinstance(options.backend, str) and options.backend in BACKENDS and h * total > 0):  # type: ignore[operator]
        return None
    own = isinstance(sigma, str)
    scene = transformed_scene(system, sigma)
    if not (asks_for_nodes(rule, start, options) and every > 0 and is_plain(system)):
        return None
    if own and local_rate(system).reason:
        return None
    h, total = float(h), float(total)  # type: ignore[arg-type]
    called = called_on(scene.system, scene, rule)
    begun = called.starts.pop() if called.starts else _start_of(system, scene)
    try:
        room = begun.room
        c = begin_in(room, system, start)
        if c is None:
            return None
        slowest = 0.0
        if own:
            slowest = slowest_rate(rate_pilot(system, room.q, room.v, c, total, h < 0), total)
        pace = _begin(begun, slowest)
        if not 0 < pace < math.inf:
            return None
        check_steps(start.t0, h * pace, 1)
        level = 0.0 if options.iteration_tol is None else LEVEL * options.iteration_tol
        constants = begun.inner.copy()
        asked = Asked(begun.at, begun.inner_at, h, level, float(constants[-2]))
        found = until_end(called, scene, asked, total, total / (h * pace), options.backend)
    finally:
        called.starts.append(begun)
    if found is None:
        return None
    inner = inner_motion(called, scene, h, constants, found, every, perf_counter() - began)
    return in_physical_time(system, start.t0, inner), found.until.quiet


class Asked(NamedTuple):
    """Addresses of the start and of all parameters, step, level of iterations, and energy of the
    start.
    """

    start: int
    c: int
    h: float
    level: float
    energy: float


class Ended(NamedTuple):
    """What the core has found, and with which loop."""

    until: Until
    kernel: Kernel


def until_end(
    called: Called,
    scene: TransformedScene,
    asked: Asked,
    total: float,
    expected: float,
    backend: str,
) -> Ended | None:
    """The run until the physical time; None where another way is to be taken."""
    loop = called.loop(scene.system, backend)
    if loop is None:
        return None
    kernel, entries = loop
    now = perf_counter()
    found = run_until(
        entries,
        asked.start,
        asked.c,
        h=asked.h,
        level=asked.level,
        total=total,
        expected=expected,
        patience=PATIENCE * (expected + FIRST_CHUNK),
        energy=asked.energy,
        off=OFF_LEVEL,
    )
    if called.gears and backend == "auto" and kernel.scene:
        kernel_after(called.gears, perf_counter() - now, 0.0)
    if found is None or found.iterations > called.most * len(found.nodes):
        return None
    return Ended(found, kernel)


def inner_motion(
    called: Called,
    scene: TransformedScene,
    h: float,
    c: np.ndarray,
    found: Ended,
    every: int,
    seconds: float,
) -> Trajectory:
    """The motion in fictitious time with every so many of the nodes, and the last one."""
    nodes, time, iterations, residual, _ = found.until
    count = len(nodes) - 1
    k = np.arange(count + 1)
    t = h * k
    k[-1], t[-1] = count - 1, time
    if every > 1:
        wanted = np.append(np.arange(0, count, every), count)
        nodes, k, t = nodes[wanted], k[wanted], t[wanted]
    q, p = nodes[:, 0], nodes[:, 1]
    grid = h, 0.0, np.empty((count, 1, 0)), c
    work = int(iterations), residual
    return plain_motion_of(
        scene.system, called.plan, found.kernel, (k, t, q, p), grid, work, seconds=seconds
    )


@dataclass(eq=False)
class Called:
    """Of a rescaled scene and a rule: the plan, the gears, how many iterations a step may take,
    what is said of energies, memory for starts, and the loops of the backends.
    """

    plan: Plan
    gears: Gears | None
    most: float
    energies: RowFunction | None
    starts: list[_Start] = field(default_factory=list)
    loops: dict[str, tuple[Kernel, Entries] | None] = field(default_factory=dict)

    def loop(self, moving: System, backend: str) -> tuple[Kernel, Entries] | None:
        """The best loop of a backend that is there, and what is called; None where the core
        cannot.
        """
        known = self.loops.get(backend)
        if backend == "auto" and self.gears:
            kernel = kernel_now(self.gears)
            if known is None or known[0] is not kernel:
                known = self.loops[backend] = _loop(kernel, self.energies)
        elif known is None and backend != "auto":
            kernel = LOOPS[backend](moving, self.plan.rule)
            known = self.loops[backend] = _loop(kernel, self.energies)
        return known


def _loop(kernel: Kernel, energies: RowFunction | None) -> tuple[Kernel, Entries] | None:
    if energies is None or kernel.opening or kernel.note[0]:
        return None
    try:
        return kernel, entries_of(kernel, energies)
    except CompileError:
        return None


@per_system
def called_on(moving: System, scene: TransformedScene, rule: Rule | None) -> Called:
    """What is called of a rescaled scene with a rule, or with the one that suits it."""
    chosen = plan(moving, rule)
    scheme = scheme_of(moving, chosen.rule)
    gears = gears_of(moving, chosen.rule, scheme)
    most = POOR if scheme is BY_STAGES else math.inf
    return Called(chosen, gears, most, energies_of(moving, scene))


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
    """Memory for a start in fictitious time.

    Attributes
    ----------
    room : Room
        Of the original scene.
    x, inner : array
        q and p of the rescaled scene, and all its parameters.
    scale : array (1,)
        σ, by `begin`, as is the energy in `inner`.
    at, inner_at : int
        Addresses of `x` and `inner`.
    """

    room: Room
    x: np.ndarray
    inner: np.ndarray
    scale: np.ndarray
    at: int
    inner_at: int
    begin: Callable[[], object]
    held: tuple


def _start_of(system: System, scene: TransformedScene) -> _Start:
    n, many = system.structure.n, system.c.numel()
    room, x, inner, scale = (
        room_of(system, False),
        np.zeros(2 * n + 2),
        np.zeros(many + 3),
        np.zeros(1),
    )
    buffer, trigger = scene.energy.buffer()
    inputs = room.q, room.v, room.t, inner[:many], inner[many : many + 1]
    outputs = inner[many + 1 : many + 2], scale
    hand_over(buffer, inputs, outputs)
    at, inner_at = new_address(x), new_address(inner)
    return _Start(room, x, inner, scale, at, inner_at, trigger, (buffer, inputs, outputs))


def _begin(start: _Start, slowest: float) -> float:
    """σ at the start that lies in the room; the start in fictitious time is then in `x`."""
    room, x, inner = start.room, start.x, start.inner
    n = len(room.q)
    inner[:-3], inner[-3] = room.c, slowest
    start.begin()
    inner[-1] = x[-1] = scale = start.scale[0]
    x[:n], x[n + 1 : -1] = room.q, room.values[:n]
    return float(scale)

"""Steps of a rescaled scene until a physical time, with what is called of it, which follows from
scene and rule alone.
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
from varint.integration.compiled_loop import POOR, kernel_of, native_kernel, scheme_of
from varint.integration.gears import BY_STAGES, Gears, gears_of, kernel_after, kernel_now
from varint.integration.plan import Plan, plan
from varint.integration.time_transformation.physical_end import FIRST_CHUNK, OFF_LEVEL, PATIENCE
from varint.integration.time_transformation.time_scale import TransformedScene
from varint.integration.trajectories import plain_motion_of
from varint.results.trajectory import Trajectory
from varint.rules.rule import Rule
from varint.scene.memory import per_system
from varint.scene.system import System

LOOPS = {"compiled": kernel_of, "native": native_kernel}
BACKENDS = "auto", *LOOPS


@dataclass(eq=False)
class Called:
    """Of a rescaled scene and a rule: the plan, the gears, how many iterations a step may take,
    what is said of energies, memory for starts, and the loops of the backends.
    """

    plan: Plan
    gears: Gears | None
    most: float
    energies: RowFunction | None
    starts: list[Any] = field(default_factory=list)
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

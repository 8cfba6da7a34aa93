"""Steps of a rescaled scene until a physical time, with what is called of it, which follows from
scene and rule alone.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from time import perf_counter

import casadi as ca
import numpy as np

from varint.codegen.cache import CompileError
from varint.codegen.kernel import Kernel
from varint.codegen.rows import RowFunction, row_function_or_none
from varint.codegen.until import Entries, Until, asked_of, entries_of, fictitious_nodes, run_until
from varint.discrete.legendre import velocity_function
from varint.integration.compiled_loop import POOR, kernel_of, native_kernel, scheme_of
from varint.integration.gears import BY_STAGES, Gears, gears_of, kernel_after, kernel_now
from varint.integration.many_steps import steps_again
from varint.integration.plan import Plan, plan
from varint.integration.time_transformation.physical_end import FIRST_CHUNK, OFF_LEVEL, PATIENCE
from varint.integration.time_transformation.transformed_scene import TransformedScene, level_of
from varint.integration.trajectories import plain_motion_of
from varint.results.records import StepsAgain
from varint.results.trajectory import Trajectory
from varint.rules.rule import Rule
from varint.scene.memory import per_system
from varint.scene.system import System

LOOPS = {"compiled": kernel_of, "native": native_kernel}
BACKENDS = "auto", *LOOPS


@dataclass(eq=False)
class Called:
    """Of a rescaled scene and a rule: the plan, the gears, how many iterations a step may take,
    what is said of energies, how physical steps are taken once more, and the loops of the
    backends.
    """

    plan: Plan
    gears: Gears | None
    most: float
    energies: RowFunction | None
    functions: StepsAgain
    loops: dict[str, Entries | None] = field(default_factory=dict)

    def loop(self, moving: System, backend: str) -> Entries | None:
        """The best loop of a backend that is there, and what is called; None where the core
        cannot.
        """
        known = self.loops.get(backend)
        if backend == "auto" and self.gears:
            kernel = kernel_now(self.gears)
            if known is None or known.kernel is not kernel:
                known = self.loops[backend] = _loop(kernel, self.energies)
        elif known is None and backend != "auto":
            kernel = LOOPS[backend](moving, self.plan.rule)
            known = self.loops[backend] = _loop(kernel, self.energies)
        return known


def _loop(kernel: Kernel, energies: RowFunction | None) -> Entries | None:
    if energies is None or kernel.opening or kernel.note[0]:
        return None
    try:
        return entries_of(kernel, energies)
    except CompileError:
        return None


@per_system
def called_on(moving: System, scene: TransformedScene, rule: Rule | None) -> Called:
    """What is called of a rescaled scene with a rule, or with the one that suits it."""
    chosen = plan(moving, rule)
    scheme = scheme_of(moving, chosen.rule)
    gears = gears_of(moving, chosen.rule, scheme)
    most = POOR if scheme is BY_STAGES else math.inf
    functions = steps_again(chosen.rule)
    return Called(chosen, gears, most, energies_of(moving, scene), functions)


def energies_of(moving: System, scene: TransformedScene) -> RowFunction | None:
    """(q, p) → what is E0 all along and |p·dq/dt|, the constant energy of the rescaled scene and
    its |p·v|, dt/dτ; None where they are no data.
    """
    velocity = velocity_function(moving)
    if not velocity.is_a("SXFunction"):
        return None
    s, p = moving, ca.SX.sym("p", moving.structure.n)
    v = velocity(s.q, p, ca.SX.zeros(1), s.c)
    energy, size = level_of(scene, s.q, p, v, s.c)
    if scene.accounts:  # forces may do work on the rescaled scene, too
        whole, moved = energy, size
    else:
        (whole,), moved = ca.substitute([s.energy], [s.v], [v]), ca.fabs(ca.dot(p, v))
    results = [energy, size, whole, moved, v[-1]]
    return row_function_or_none("level", [s.q, p], s.c, [ca.densify(x) for x in results])


def asked_until_end(
    start: tuple[int, int],
    h: float,
    level: float,
    span: tuple[float, float],
    expected: float,
    energy: float,
    every: int,
) -> bytes:
    """What `until_end` is asked: a run from the addresses of (q, p) and of all parameters over (t0,
    duration).
    """
    patience = PATIENCE * (expected + FIRST_CHUNK)
    return asked_of(start, h, level, span, every, patience, energy, OFF_LEVEL)


def until_end(called: Called, moving: System, asked: bytes, backend: str) -> Until | None:
    """The run that is asked for; None where another way is to be taken."""
    entries = None if backend == "auto" else called.loops.get(backend)
    if entries is None:
        entries = called.loop(moving, backend)
        if entries is None:
            return None
    rises = backend == "auto" and called.gears and entries.kernel.is_native
    now = perf_counter() if rises else 0.0
    found = run_until(entries, asked)
    if rises:
        assert called.gears is not None
        kernel_after(called.gears, perf_counter() - now, 0.0)
    if found is None or found.iterations > called.most * (found.steps + 1):
        return None
    return found


# step, parameters of the rescaled scene, what the core has found, and seconds
How = tuple[float, np.ndarray, Until, float]


def inner_motion(called: Called, moving: System, how: How) -> Trajectory:
    """The motion in fictitious time with the nodes that were kept."""
    h, c, found, seconds = how
    nodes = fictitious_nodes(found)
    grid = h, 0.0, np.empty((found.steps, 1, 0)), c
    work = found.iterations, found.residual
    return plain_motion_of(moving, called.plan, found.kernel, nodes, grid, work, seconds=seconds)

"""Runs of a few steps, with a look at their energy, in one call of the core."""

from __future__ import annotations

import math
from dataclasses import dataclass
from time import perf_counter

import numpy as np

from varint.codegen.cache import CompileError
from varint.codegen.few_steps import Entries, entries_of, few_steps
from varint.codegen.kernel import Kernel
from varint.integration.compiled_loop import POOR, scheme_of
from varint.integration.energy_check import NOTHING, SAMPLES, energy_rows
from varint.integration.gears import BY_STAGES, Gears, gears_of, kernel_after, kernel_now
from varint.integration.plain_start import asks_for_no_more, begin_in, is_plain, room_of, rooms
from varint.integration.plan import Plan, plan
from varint.integration.problem import LEVEL, RunOptions, Start, time_grid
from varint.integration.trajectories import plain_motion_of
from varint.integration.work_bound import keeps_energy
from varint.numerics.limits import check_steps
from varint.results.trajectory import Trajectory
from varint.rules.rule import Rule
from varint.scene.memory import per_scene
from varint.scene.system import System

FEW = SAMPLES - 1  # steps of which every node is looked at


def few_steps_call(
    system: System, rule: Rule | None, start: Start, options: RunOptions, began: float
) -> tuple[Trajectory, bool] | None:
    """The motion, and whether its energy stays; None where it is no such run, or comes to no good
    end, and another way is to be taken.
    """
    if not (asks_for_no_more(rule, start, options) and is_plain(system) and keeps_energy(system)):
        return None
    h, steps = time_grid(options.h, options.steps, options.duration)
    called = _called(system, rule) if steps <= FEW else None
    if called is None:
        return None
    pool, t0 = rooms(system, False), float(start.t0)
    room = pool.pop() if pool else room_of(system, False)
    level = 0.0 if options.iteration_tol is None else LEVEL * options.iteration_tol
    try:
        c = begin_in(room, system, start)
        if c is None:
            return None
        check_steps(t0, h, steps)
        kernel = kernel_now(called.gears)
        if kernel is not called.last[0]:
            called.last = kernel, _entries(system, kernel)
        entries, now = called.last[1], perf_counter()
        if entries is None:
            return None
        found = few_steps(entries, room.at, room.c_at, t0=t0, h=h, steps=steps, level=level)
    finally:
        pool.append(room)
    if kernel.scene:
        kernel_after(called.gears, perf_counter() - now, 0.0)
    if found is None or found.iterations > called.most * steps:
        return None
    motion = plain_motion_of(
        system,
        called.plan,
        kernel,
        found[:4],
        (h, t0, np.empty((steps, 1, 0)), c),
        (int(found.iterations), found.residual),
        seconds=perf_counter() - began,
    )
    return motion, found.change <= NOTHING * found.largest


@dataclass(eq=False)
class _Called:
    """Of a scene and a rule: the plan, the gears, how many iterations a step may take, and the loop
    that ran last, with what is called of it.
    """

    plan: Plan
    gears: Gears
    most: float
    last: tuple[Kernel | None, Entries | None] = (None, None)


@per_scene
def _called(system: System, rule: Rule | None) -> _Called | None:
    """None where there is no loop that need not be compiled first."""
    chosen = plan(system, rule)
    scheme = scheme_of(system, chosen.rule)
    gears = gears_of(system, chosen.rule, scheme)
    if gears is None:
        return None
    return _Called(chosen, gears, POOR if scheme is BY_STAGES else math.inf)


def _entries(system: System, kernel: Kernel) -> Entries | None:
    """What is called; None where the core cannot."""
    energy = energy_rows(system)
    if kernel.opening or kernel.note[0] or energy is None:
        return None
    try:
        return entries_of(kernel, energy)
    except CompileError:
        return None

"""Runs of a few steps, with a look at their energy, in one call of the core."""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass
from time import perf_counter
from typing import Any

import numpy as np

from varint.codegen.cache import CompileError
from varint.codegen.few_steps import Entries, entries_of, few_steps
from varint.codegen.kernel import Kernel
from varint.integration.compiled_loop import POOR, scheme_of
from varint.integration.energy_check import NOTHING, SAMPLES, energy_rows
from varint.integration.energy_leap import energy_alarm
from varint.integration.false_speed import false_speed
from varint.integration.gears import BY_STAGES, Gears, gears_of, kernel_after, kernel_now
from varint.integration.plain_start import (
    Room,
    begin_at,
    is_plain,
    is_plain_number,
    room_of,
    rooms,
)
from varint.integration.plan import Plan, plan
from varint.integration.problem import LEVEL, Grid, time_grid
from varint.integration.trajectories import plain_motion_of
from varint.integration.work_bound import keeps_energy
from varint.numerics.limits import check_steps
from varint.results.trajectory import Trajectory
from varint.rules.rule import Rule
from varint.scene.memory import per_scene
from varint.scene.parameters import ParameterValues
from varint.scene.system import System

FEW = SAMPLES - 1  # steps of which every node is looked at


def few_steps_call(
    system: System,
    rule: Rule | None,
    start: tuple[Any, Any, Any, ParameterValues | None],
    grid: Grid,
    iteration_tol: float | None,
    began: float,
) -> Trajectory | None:
    """The motion from a start (q0, v0, t0, params); None where it is no such run, or comes to no
    good end, and another way is to be taken. A warning where the energy does not stay.
    """
    t0 = start[2]
    h, steps = time_grid(*grid)
    called = None
    if steps <= FEW and (rule is None or type(rule) is Rule) and is_plain_number(t0):
        called = _called(system, rule)
    if called is None:
        return None
    pool = called.rooms
    room = pool.pop() if pool else room_of(system, False)
    try:
        c = begin_at(room, system, *start)
        if c is None:
            return None
        check_steps(t0, h, steps)
        kernel = kernel_now(called.gears)
        if kernel is not called.last[0]:
            called.last = kernel, _entries(system, kernel)
        entries, now = called.last[1], perf_counter()
        if entries is None:
            return None
        level = 0.0 if iteration_tol is None else LEVEL * iteration_tol
        found = few_steps(entries, room.place, t0, h, steps, level)
    finally:
        pool.append(room)
    if kernel.is_native:
        kernel_after(called.gears, perf_counter() - now, 0.0)
    if found is None:
        return None
    nodes, iterations, residual, change, largest = found
    if iterations > called.most * steps:
        return None
    motion = plain_motion_of(
        system,
        called.plan,
        kernel,
        nodes,
        (h, float(t0), np.empty((steps, 1, 0)), c),
        (int(iterations), residual),
        seconds=perf_counter() - began,
    )
    if not change <= NOTHING * largest and (alarm := energy_alarm(motion) or false_speed(motion)):
        warnings.warn(alarm, stacklevel=3)
    return motion


@dataclass(eq=False)
class _Called:
    """Of a scene and a rule: the plan, the gears, how many iterations a step may take, rooms that
    nobody uses, and the loop that ran last, with what is called of it.
    """

    plan: Plan
    gears: Gears
    most: float
    rooms: list[Room]
    last: tuple[Kernel | None, Entries | None] = (None, None)


@per_scene
def _called(system: System, rule: Rule | None) -> _Called | None:
    """None where more than coordinates and momenta at nodes makes the motion, or there is no loop
    that need not be compiled first.
    """
    if not (is_plain(system) and keeps_energy(system)):
        return None
    chosen = plan(system, rule)
    scheme = scheme_of(system, chosen.rule)
    gears = gears_of(system, chosen.rule, scheme)
    if gears is None:
        return None
    most = POOR if scheme is BY_STAGES else math.inf
    return _Called(chosen, gears, most, rooms(system, False))


def _entries(system: System, kernel: Kernel) -> Entries | None:
    """What is called; None where the core cannot."""
    energy = energy_rows(system)
    if kernel.opening or kernel.note[0] or energy is None:
        return None
    try:
        return entries_of(kernel, energy)
    except CompileError:
        return None

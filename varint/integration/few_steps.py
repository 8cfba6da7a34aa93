"""Runs that are over before anyone could watch them, and a look at their energy, in one call of the
core.

What follows from the scene alone is looked up once, and numbers go from the user to the core and
back by one block of memory. `simulate_steps` does the same where more is asked for, or a run comes
to no good end, and says what.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from functools import cache
from time import perf_counter
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np

from varint.codegen.cache import CompileError
from varint.codegen.core import held_entry
from varint.codegen.few_steps import Controlled, FewSteps, few_steps, few_steps_of
from varint.codegen.kernel import Kernel
from varint.integration.compiled_loop import NODES_IN_BLOCK, first_piece, next_piece
from varint.integration.energy_leap import energy_alarm
from varint.integration.false_speed import false_speed, may_be_false
from varint.integration.fixed_steps import watches_of
from varint.integration.gears import (
    BY_STAGES,
    Gears,
    gears_of,
    kernel_after,
    kernel_now,
    scheme_of,
)
from varint.integration.held_rows import is_held
from varint.integration.plain_start import (
    Room,
    begin_in,
    is_plain_number,
    moves_freely,
    moving_in,
    opening_in,
    room_of,
    rooms,
)
from varint.integration.plan import Plan, plan
from varint.integration.problem import Grid, controls, time_grid
from varint.integration.run import FIRST, looked_along
from varint.integration.short_looks import looked_at, short_looks
from varint.integration.trajectories import plain_motion_of, with_stats
from varint.integration.work_bound import moves_constraints
from varint.numerics.limits import check_steps
from varint.results.trajectory import Trajectory
from varint.rules.rule import Rule
from varint.scene.memory import per_scene
from varint.scene.parameters import ParameterValues
from varint.scene.system import System


def few_steps_call(
    system: System,
    rule: Rule | None,
    start: tuple[Any, Any, Any, Any, ParameterValues | None, Any],
    grid: Grid,
    save_every: int,
    level: float,
    began: float,
    watched: tuple[Any, Any] = (None, None),
) -> Trajectory | None:
    """The motion from a start (q0, v0, p0, t0, params, u), with iterations that end at a level, and
    with `events` that are `watched` for or until an expression crosses zero (until, events); None
    where it is no such run, or comes to no good end, and another way is to be taken. A warning
    where the energy is not what it can be.
    """
    q0, v0, p0, t0, params, u = start
    until, events = watched
    looks, key, parsed = until is not None or bool(events), None, None
    if looks or events is not None:
        key = _short_search().key_of(until, events)
        if key is None or key not in _short_search().searches_known(system):
            parsed = watches_of(until, events)  # bad ones are refused
    h, steps = time_grid(*grid)
    if looks and (steps > FIRST or save_every != 1):
        return None
    called = None
    if (rule is None or type(rule) is Rule) and is_plain_number(t0) and save_every > 0:
        called = called_of(system, rule)
    if called is None or (v0 is None) == (p0 is None) or (u is None) == called.controlled:
        return None
    if called.held and v0 is None:
        return None
    kernel, how, longest, pilot = loop_now(system, called)
    if how is None or steps > longest or steps % save_every:
        return None
    if pilot and save_every != 1:
        pilot = next_piece(0, steps, save_every, pilot)[0]
        if pilot % save_every:  # nodes are further apart
            return None
    pool = called.rooms
    room = pool.pop() if pool else room_of(system, False)
    try:
        used = None
        if u is not None:
            used = _controls_of(system, called.plan.rule, u, steps)
            room.u[:], room.known = used.u[0, 0], None
        c = begin_in(room, system, (q0, v0, t0, params), p0)
        if c is None:
            return None
        check_steps(t0, h, steps)
        opening = None
        if kernel.opening:
            opening = opening_told(system, room, used, h)
            if opening is None:
                return None
        now = perf_counter()
        asked = t0, h, steps, save_every, level, pilot
        looked, sought = looked_at(steps // save_every), None
        if looks and used is None:
            what = _short_search().search_for(system, kernel, key, until, events)
            if what is not None:
                sought = what, *moving_in(room, system, c, opening is not None)
        found = few_steps(how, room.place, asked, looked, used, opening, looks, sought)
        if opening is not None and room.opening is not None and room.opening.raised:
            raise room.opening.raised.pop()
    finally:
        pool.append(room)
    if kernel.is_native:
        kernel_after(called.gears, perf_counter() - now, 0.0)
    if found is None:
        return None
    nodes, iterations, residual, quiet, v, zeros = found
    motion = plain_motion_of(
        system,
        called.plan,
        kernel,
        nodes,
        (h, float(t0), np.empty((steps, 1, 0)) if used is None else used.u, c),
        (int(iterations), residual),
        seconds=perf_counter() - began,
    )
    if v is not None:
        motion = looked_along(motion, v, kernel, *(parsed or watches_of(until, events)))
        quiet = quiet and motion.q is nodes[2]  # the node where it is cut is another one
    elif zeros is not None and len(zeros):
        end = nodes[1].item(-1) if until is not None and zeros[0, 1] == 0 else None
        names = ("until", *(events or ())) if until is not None else tuple(events)
        others = zeros if end is None else zeros[1:]
        motion.__dict__["events"] = _short_search().events_along(system, c, names, others, h, end)
        if end is not None:
            motion = with_stats(motion, steps=int(nodes[0].item(-1)) + 1)
    alarm = None if quiet else energy_alarm(motion)
    if called.may_be_false and not alarm:
        alarm = false_speed(motion)
    if alarm:
        warnings.warn(alarm, stacklevel=3)
    return motion


@cache
def _short_search() -> ModuleType:
    """Loaded when something is watched for."""
    from varint.integration.events import short_search

    return short_search


def loop_now(system: System, called: Called) -> Loop:
    """The best loop that is there."""
    kernel, loop = kernel_now(called.gears), called.last
    if loop is None or loop.kernel is not kernel:
        loop = called.last = _loop_of(system, called.plan.rule, kernel)
    return loop


class Loop(NamedTuple):
    """A loop, how it is called, if it can be, how many steps that is for, and after how many its
    iteration must have contracted (0: it need not).
    """

    kernel: Kernel
    how: FewSteps | None
    longest: int
    pilot: int


@dataclass(eq=False)
class Called:
    """Of a scene and a rule: the plan, the gears, whether there are controls, whether constraint
    rows hold the motion, whether speeds may be false, rooms that nobody uses, and the loop that ran
    last.
    """

    plan: Plan
    gears: Gears
    controlled: bool
    held: bool
    may_be_false: bool
    rooms: list[Room]
    last: Loop | None = None


@per_scene
def called_of(system: System, rule: Rule | None) -> Called | None:
    """None where more than coordinates and momenta at nodes and constraint rows makes the motion,
    or there is no loop that need not be compiled first.
    """
    held = is_held(system)
    if not (moves_freely(system) or (held and not moves_constraints(system))):
        return None
    chosen = plan(system, rule)
    gears = gears_of(system, chosen.rule, scheme_of(system, chosen.rule))
    if gears is None:
        return None
    controlled, false = system.structure.controls > 0, may_be_false(system, chosen.rule)
    return Called(chosen, gears, controlled, held, false, rooms(system, False))


def _loop_of(system: System, rule: Rule, kernel: Kernel) -> Loop:
    looks = short_looks(system)
    none = Loop(kernel, None, 0, 0)
    if looks is None:
        return none
    longest = min(first_piece(kernel, False), NODES_IN_BLOCK)
    piloted = scheme_of(system, rule) is BY_STAGES and not kernel.opening
    try:
        if is_held(system):
            held_entry()
        how = few_steps_of(kernel, looks)
    except CompileError:
        return none
    return Loop(kernel, how, longest, first_piece(kernel, True) if piloted else 0)


def _controls_of(system: System, rule: Rule, u: Any, steps: int) -> Controlled:
    given, nodes = controls(system, rule, u, steps), len(rule.nodes)
    if given.shape[1] == 1:
        mean, each = given, np.empty((steps, nodes, given.shape[2]))
        each[:] = given  # in a tenth of the time of `np.broadcast_to`
    else:
        mean, each = given.mean(axis=1), given
    return Controlled(given, each, mean)


def opening_told(
    system: System, room: Room, used: Controlled | None, h: float
) -> np.ndarray | None:
    """What the loop is told at a fresh start; None where that is no numbers."""
    opening = opening_in(room, system)
    opening.h[0] = h
    if used is not None:
        opening.u[:] = np.abs(used.each).max(axis=(0, 1))
    return opening.told if opening.look() else None

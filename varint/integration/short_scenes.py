"""What is known of a scene whose default calls are short, wherever they start."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from varint.codegen.cache import CompileError
from varint.codegen.kernel import Kernel
from varint.codegen.times import Between, between
from varint.codegen.two_runs import NO_RATES, Rates
from varint.codegen.within_steps import Within
from varint.integration.backend import runs_by_stages
from varint.integration.compiled_loop import scheme_of
from varint.integration.cuts import cuts_of
from varint.integration.damped_motions import may_be_damped
from varint.integration.even_motion import Made
from varint.integration.gears import BY_STAGES, Gears, gears_of
from varint.integration.held_rows import is_held
from varint.integration.linear_run import (
    MAPPED,
    driven_kernel,
    is_one_map,
    map_alone,
    runs_driven,
)
from varint.integration.plain_start import Room, has_plain_nodes, is_plain, rooms
from varint.integration.plan import Plan, plan
from varint.integration.rule_choice import Priced, candidates, changes, cheapest, priced
from varint.integration.second_looks import has_switches
from varint.integration.short_trials import Begins, balance_known, energy_known, steps_to_begin
from varint.integration.small_motions import frequency_of_columns, is_looked_at
from varint.integration.time_transformation.rate_ahead import rates_to_follow
from varint.integration.time_transformation.variable_course import looks_ahead, may_go_astray
from varint.integration.two_runs import shows_its_error
from varint.integration.work_bound import moves_constraints
from varint.rules.rule import Rule, gauss
from varint.scene.memory import per_scene
from varint.scene.system import System


@dataclass(eq=False)
class Loop:
    """Of a scene and a rule: the plan, the gears if there are some, or the map that does alone, and
    the loop that ran last, with how motions are made by it and, if that was asked for, looked at
    between their nodes; how many steps are begun with.
    """

    plan: Plan
    gears: Gears | None
    alone: list[Kernel]
    begins: Begins
    last: tuple[Kernel | None, Made | None] = (None, None)
    between: tuple[Kernel | None, Within | None, Between | None] = (None, None, None)


@dataclass(frozen=True, eq=False)
class Known:
    """Of a scene: coordinates, the rule that is asked for, rooms that nobody uses, rules, their
    prices and which is the cheapest when, their loops as far as they were asked for, whether steps
    may vary and the rates that they may follow, whether momenta will do for all of that, whether
    constraint rows hold the motion, whether dampers may be stiff, whether angles may jump, and the
    last local numbers of a start as bytes and the fastest frequency of these.
    """

    n: int
    rule: Rule | None
    rooms: list[Room]
    rules: tuple[Priced, ...]
    changes: tuple[list[float], list[int]]
    loops: list[Loop | None]
    varies: bool
    rates: list[Rates]
    by_momentum: bool
    held: bool
    damped: bool
    cuts: bool
    last: list[tuple[bytes, float | None]]


@per_scene
def known_of(system: System, rule: Rule | None) -> Known | None:
    """None where another way is to be taken, whatever the start."""
    n, own, held = system.structure.n, plan(system, rule).rule, _is_plainly_held(system)
    begins = held or _begins_by_symbols(system)
    if not (begins and is_looked_at(system)) or has_switches(system):
        return None
    if (energy_known(system) if shows_its_error(system) else balance_known(system)) is None:
        return None
    driven = rule is None and driven_kernel(system, MAPPED) is not None
    if rule is None and not (driven or held or runs_by_stages(system, gauss(8), "auto")):
        return None
    rules = candidates(system, False, True) if rule is None else {own: 1.0}
    rules = {MAPPED: 1.0} if driven else rules
    prices = priced(rules)
    varies = looks_ahead(system, rule)
    by_momentum = system.structure.quadratic_kinetic and not held
    astray = shows_its_error(system) and may_go_astray(system, rule)
    rates = rates_to_follow(system) if astray else [NO_RATES]
    loops: list[Loop | None] = [None] * len(prices)
    begin = rooms(system, True), prices, changes(prices)
    by_stages = rule is None or scheme_of(system, rule) is BY_STAGES
    damped = by_stages and may_be_damped(system)
    cuts = cuts_of(system) is not None
    last: tuple[bool, bool, list[tuple[bytes, float | None]]] = damped, cuts, [(b"", 0.0)]
    return Known(n, rule, *begin, loops, varies, rates, by_momentum, held, *last)


def _is_plainly_held(system: System) -> bool:
    """Whether constraint rows alone, which stand still, hold the motion."""
    if not is_held(system) or system.structure.controls or moves_constraints(system):
        return False
    solved_once = is_one_map(system, MAPPED) or runs_driven(system)
    return system.structure.quadratic_kinetic and not solved_once


def _begins_by_symbols(system: System) -> bool:
    """Whether a start is functions of symbols: those of velocities alone where these have no
    formula.
    """
    return is_plain(system) or (has_plain_nodes(system) and not system.structure.quadratic_kinetic)


@per_scene
def loop_of(system: System, rule: Rule) -> Loop:
    alone = map_alone(system, rule)
    gears = None if alone else gears_of(system, rule, scheme_of(system, rule))
    maps = [alone] if alone else []
    return Loop(plan(system, rule), gears, maps, steps_to_begin(system, rule))


def chosen_in(system: System, known: Known, begin: float, tol: float) -> tuple[Loop, int | None]:
    """The loop of the cheapest rule, and with how many steps it begins."""
    which = cheapest(known.changes, begin, tol)
    price, loop = known.rules[which], known.loops[which]
    if loop is None:
        loop = known.loops[which] = loop_of(system, price.rule)
    return loop, loop.begins(price, begin, tol)


def looked_between(loop: Loop, kernel: Kernel, steps: Within) -> Between | None:
    """How motions are looked at between their nodes by this loop, and within steps that hold many
    times; None where that is done afterwards.
    """
    known = loop.between
    if known[0] is not kernel or known[1] is not steps:
        loop.between = kernel, steps, None
        with suppress(CompileError):
            loop.between = kernel, steps, between(kernel, steps)
    return loop.between[2]


def fastest_of(
    n: int, remembered: list[tuple[bytes, float | None]], local: np.ndarray
) -> float | None:
    """Of the small motions of these masses and derivatives of forces, which a linear scene has
    wherever it begins; the last one is remembered.
    """
    numbers, last = local.tobytes(), remembered[0]
    if last[0] != numbers:
        columns, half = local.tolist(), n * n
        last = numbers, frequency_of_columns(columns[:half], columns[half : 2 * half], n)
        remembered[0] = last
    return last[1]

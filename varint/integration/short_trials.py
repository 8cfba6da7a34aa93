"""Runs for a wanted accuracy where all of them are short: the part, the coarse run, the run itself
and its error in one call of the core, which decides as `run_twice` does.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from time import perf_counter

import numpy as np

import varint.integration.bent_steps as bent
import varint.integration.fitted_steps as fitted
import varint.integration.graded_steps as graded
import varint.integration.halved_steps as halved
import varint.integration.hidden as hidden
import varint.integration.narrow_places as narrow
import varint.integration.refinement as searched
import varint.integration.round_off as limited
import varint.integration.second_looks as seconds
import varint.integration.short_refinement as refined
import varint.integration.shown_by_stages as stages
import varint.integration.shown_order as shown
import varint.integration.two_runs as decided
from varint.codegen.cache import CompileError
from varint.codegen.few_steps import TOLD, place_of
from varint.codegen.kernel import Kernel, address_of
from varint.codegen.refined_runs import BendLooks, refined_course
from varint.codegen.rows import RowFunction, as_data
from varint.codegen.two_runs import (
    GRADED,
    GRADED_DOUBTED,
    NO_RATES,
    NOT_PROVED,
    NOT_SHORT,
    UNASKED,
    VARIES,
    Course,
    Found,
    Places,
    Rates,
    course_of,
    places_of,
    two_runs,
)
from varint.discrete.legendre import velocity_function
from varint.integration.backend import kernel_for
from varint.integration.choice import Choice
from varint.integration.compiled_loop import POOR, first_piece, scheme_of
from varint.integration.damped_motions import may_be_damped
from varint.integration.energy_check import NOTHING, energy_rows, energy_rows_by_velocity
from varint.integration.error_scale import angles, bodies
from varint.integration.even_motion import even_motion_of, graded_motion, made_of
from varint.integration.force_bounds import forces_as_data, push
from varint.integration.gears import BY_STAGES, Gears, gears_with, kernel_after
from varint.integration.held_rows import is_held
from varint.integration.linear_run import (
    REPEATED,
    driven_kernel,
    first_of_map,
    is_one_map,
    map_alone,
)
from varint.integration.looks_between import looked_at_closely
from varint.integration.plan import plan
from varint.integration.problem import LEVEL, InitialValueProblem
from varint.integration.proof_limits import proof_limits
from varint.integration.rule_choice import SECULAR, Priced, first_steps, priced
from varint.integration.short_looks import held_looks
from varint.integration.time_transformation.rate_ahead import ask_for_rates, rates_to_follow
from varint.integration.work_bound import MISSED, balance_rows, balance_rows_by_velocity
from varint.rules.rule import Rule
from varint.scene.memory import per_scene
from varint.scene.system import System

# in the order of c/refined_core.c; one more stands behind them
_REFINED = np.array(
    [
        *(shown.CAUTION, shown.LESS, shown.LEAST_ORDER, shown.TELLS),
        *(stages.SHARED, decided.STALLED, refined.PATIENCE),
        *(decided.FLOOR, searched.NO_DIGITS, *stages.RATIOS, refined.RUNS),
        *(seconds.TRANSIENT_STEPS, seconds.TRANSIENT_PARTS, limited.ROUNDING, SECULAR, LEVEL, POOR),
        *(NOTHING, MISSED, hidden.BENDS, hidden.NOTHING, decided.LEFT),
        *(narrow.AT_ONCE, narrow.PART_OF_IT, narrow.PARTS, narrow.UNCERTAIN),
        *(refined.COARSER, refined.CLOSELY),
        *(limited.ROUNDED, limited.SECULAR_GROWTH, limited.GROWS, limited.CHANCE, limited.UNEVEN),
        limited.PASSED,
        *(limited.WAYS, limited.PARTED, limited.FAR_BELOW),
        *(bent.CLOSE, bent.BENT, bent.SURE),
        *(graded.QUIET, graded.SMOOTH, graded.FEWEST, graded.TURNED),
        *(fitted.LOW, fitted.CLEAR, fitted.WORTH, fitted.LEAST_RUNS, fitted.BASE, fitted.AIMED),
        *(fitted.PASSABLE, fitted.HALVED, fitted.PARTS, fitted.FARTHER),
        *(stages.COUNTED, stages.ALIKE, stages.TOLD, stages.FAINT),
        *(stages.MADE, stages.AIM, stages.LONGER, stages.FORESEEN, stages.CLEARLY),
        *(stages.EXTRA, stages.UNRESOLVED, stages.LEAST_MADE, stages.MOST_UNRESOLVED),
        stages.BEGINS,
        stages.ROUND_OFF,
        limited.LATE * limited.LATELY,
        *(halved.LOSSES, halved.MADE, halved.ROUGHLY, halved.SHARP, halved.FAINTLY),
    ]
)

# times as many steps as of any loop are over in the same time, where it is compiled: operations
# take a twentieth of what is counted on for the first block of a loop that nobody has seen run
COMPILED = 8
# and in either gear, of scenes that may have stiff dampers, whose steps take few evaluations
DAMPED = 32


def by_short_trials(
    system: System,
    rule: Rule,
    start: InitialValueProblem,
    mass: np.ndarray,
    tol: float,
    turned: tuple[float, float],
    backend: str,
    began: float,
    follow: bool = False,
    grows: bool = False,
) -> Choice | int:
    """The choice that two runs and their energies prove, or more of them over forces; NOT_PROVED
    where they do not, NOT_SHORT where a run is long, or of another kind, VARIES and more where
    steps should `follow` one of the rates. `mass` is the diagonal of the mass matrix at the start,
    `turned` by how much the motion turns, and the one that the first steps are for. With `grows`
    steps may become longer where the motion settles.
    """
    (radians, begin), alone = turned, map_alone(system, rule) if backend == "auto" else None
    kernel = alone or kernel_for(system, rule, start, backend)
    course = None if kernel is None else course_by(system, rule, kernel, grows)
    if kernel is None or course is None:
        return NOT_SHORT
    if backend != "auto" and course.kernel is not kernel:  # another one is asked for
        return NOT_SHORT
    n = len(mass)
    room = np.concatenate((start.q0, start.p0, mass, start.c, np.zeros(TOLD)))
    at, told = address_of(room), 3 * n + start.c.size
    place = place_of(at, at + 24 * n, at + 8 * told, room[told:].data)
    places = places_of(place, at + 16 * n, 1)
    first = steps_to_begin(system, rule)(priced({rule: 1.0})[0], begin, tol)
    if first is None:
        return NOT_SHORT
    asked = start.t0, start.h, first, radians, tol
    gears = None if alone else gears_with(system, rule, scheme_of(system, rule), course.kernel)
    rates = rates_to_follow(system) if follow else [NO_RATES]
    found = two_short_runs(system, course, gears, places, asked, rates)
    chosen = plan(system, rule)
    if isinstance(found, int):
        if found not in (GRADED, GRADED_DOUBTED):
            return found
        when, doubted = (start.t0, start.h, tol), found == GRADED_DOUBTED
        how = system, made_of(course, chosen), places, start.c, when, began
        motion, estimate, runs = graded_motion(*how)
        steps = len(motion) - 1
    else:
        steps, runs, estimate, iterations, residual, nodes, doubted, _ = found
        grid = start.h / steps, start.t0, steps, iterations, residual
        seconds = (perf_counter() - began,)
        motion = even_motion_of(system, made_of(course, chosen), nodes, start.c, grid, seconds)
    if doubted:
        estimate = max(estimate, looked_at_closely(rule, motion, None, tol))
    if estimate > tol:
        return NOT_PROVED
    return Choice(rule, steps, motion, estimate, runs, True, True)


Begins = Callable[[Priced, float, float], int | None]


@per_scene
def steps_to_begin(system: System, rule: Rule) -> Begins:
    """(rule, radians, tol) → steps of the first run; None where the core is not to make it."""
    if is_one_map(system, rule):
        return lambda price, radians, tol: first_of_map(price.rule, radians, tol)
    if decided.shows_its_error(system):
        return first_steps
    return partial(refined.refined_first, system)


def two_short_runs(
    system: System,
    course: Course,
    gears: Gears | None,
    places: Places,
    asked: tuple[float, float, int, float, float],
    rates: list[Rates],
) -> Found | int:
    """`two_runs` of (t0, duration, first, radians, tol), and in the low one of `gears` a look at
    whether another one repays; VARIES and more where steps of a run that went astray should follow
    one of the rates.
    """
    now = perf_counter() if gears else 0.0
    found = two_runs(course, places, *asked, rates[0])
    if type(found) is int and found >= VARIES and rates[0] is UNASKED:
        rates[0] = ask_for_rates(system)
        found = two_runs(course, places, *asked, rates[0])
    if gears:
        kernel_after(gears, perf_counter() - now, 0.0)
    return found


def energy_known(system: System) -> RowFunction | None:
    """The energy of a node as the core looks at it: by its momentum, or by its velocity where that
    has no formula.
    """
    by_momentum = has_formula(system)
    return energy_rows(system) if by_momentum else energy_rows_by_velocity(system)


def balance_known(system: System) -> RowFunction | None:
    """`energy_known` of scenes whose energy changes, with the power of what changes it."""
    return balance_rows(system) if has_formula(system) else balance_rows_by_velocity(system)


def has_formula(system: System) -> bool:
    """Whether momenta alone tell of velocities, by operations that are data."""
    if is_held(system) or not system.structure.quadratic_kinetic:
        return False
    return velocity_function(system).is_a("SXFunction")


@per_scene
def course_by(system: System, rule: Rule, kernel: Kernel, grows: bool = False) -> Course | None:
    """How the runs are made, by steps that may grow where forces do not depend on time; None where
    the core cannot make them.
    """
    s, kept = system.structure, decided.shows_its_error(system)
    energy = energy_known(system) if kept else balance_known(system)
    driven = driven_kernel(system, rule)
    kernel = driven or kernel
    held = held_looks(system) if is_held(system) else None
    if energy is None or (held is None and (kernel.opening or kernel.note[0])):
        return None
    if not (kept or s.quadratic_kinetic):
        return None
    if not kept and (seconds.has_steps(system) or not rule.nodes):
        return None
    looks_at_bends = bent.looks_at_bends(system, rule)
    pushed = None if looks_at_bends is None else as_data(push(system))
    if pushed is None and looks_at_bends is not None:
        return None
    bends = None
    if pushed is not None and looks_at_bends is not None:
        closer = bent.closer_looks(looks_at_bends.shape[1])
        bends = BendLooks(pushed, looks_at_bends, closer)
    body = np.arange(s.n)
    for members in bodies(system.names):
        body[members] = members[0]
    turns = np.array(angles(system), dtype=np.int64)
    piloted = driven is None and scheme_of(system, rule) is BY_STAGES
    slow = kernel.is_native and driven is None
    longest = first_piece(kernel, False) * (1 if slow else COMPILED)
    if is_one_map(system, rule):  # a step is one product, not one for each of its nodes
        longest *= kernel.nodes
    pieces = first_piece(kernel, True) if piloted else 0, longest
    try:
        if not kept:
            forces, looks = (
                forces_as_data(system),
                (*hidden.looks_in_order(rule), hidden.GROUPS, hidden.SAMPLED),
            )
            how = kernel, energy, forces, looks, rule.order, pieces
            repeated = np.append(_REFINED, REPEATED if driven else 0.0)
            visible = piloted and not (driven or held or s.degenerate)
            may_grow = int(visible and not forces) if grows else -1
            if grows and visible and may_be_damped(system):
                # what depends on time may begin late: steps grow beside stiff dampers alone
                may_grow, pieces = (
                    3 if forces else 2,
                    (pieces[0], first_piece(kernel, False) * DAMPED),
                )
                how = kernel, energy, forces, looks, rule.order, pieces
            looks_at = graded.stage_looks(system, rule) if visible else None
            # as many in either gear
            most = first_piece(kernel, False) if grows and visible and bends else 0
            others = held, bends, looks_at, may_grow, most, not has_formula(system)
            return refined_course(*how, body, turns, repeated, *others)
        kind = s.linear, not has_formula(system), driven is not None, body, turns
        limits = proof_limits()
        if held:  # as `tolerance` has them run, where long ones are looked at first
            pieces = 0, min(longest, decided.LONG)
            ways = {"ways": 0} if s.nonholonomic else {}
            limits = proof_limits(watched=1, hopeless=decided.HOPELESS, **ways)
        return course_of(kernel, energy, rule.order, pieces, *kind, limits, held)
    except CompileError:
        return None

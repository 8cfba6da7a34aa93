"""Steps for a wanted error from short runs whose energy tells nothing: forces, explicit time.

`refine` decides so for runs of any kind. Here runs are numbers alone, the first of them has as many
steps as a small oscillation takes, and what is not clear after a few of them is left to `refine`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from time import perf_counter

import numpy as np

from varint.integration.backend import kernel_for, run_at_once
from varint.integration.bent_steps import CLOSE, made_by_bends
from varint.integration.choice import Choice
from varint.integration.compiled_loop import POOR, scheme_of
from varint.integration.error_scale import error_scales, scales_of_nodes
from varint.integration.gears import BY_STAGES
from varint.integration.graded_steps import stage_looks
from varint.integration.linear_run import REPEATED, driven_kernel
from varint.integration.looks_between import looked_at_closely
from varint.integration.narrow_places import PARTS, made_at_once
from varint.integration.plain_trials import PlainTrial, first_steps_of, plain_motion
from varint.integration.problem import InitialValueProblem
from varint.integration.refinement import FOLLOWED, NO_DIGITS, Varying
from varint.integration.round_off import (
    GROWS,
    growth_of,
    iterated_by,
    likely_rounding,
    parted,
    passed_by,
    rounding,
    with_other_digits,
    with_other_times,
)
from varint.integration.rule_choice import (
    FEWEST,
    ROUGH,
    Priced,
    first_steps,
    iteration_level,
    priced,
)
from varint.integration.run_distance import beyond_shared, with_early
from varint.integration.second_looks import TRANSIENT_PARTS, before_shared
from varint.integration.shown_by_stages import (
    RATIOS,
    SHARED,
    begins_clearly,
    least_by_stages,
    left_by_stages,
    planned_by_stages,
    ratio_to,
    shown_by,
)
from varint.integration.shown_order import CAUTION, LEAST_ORDER, TELLS, part_left
from varint.integration.two_runs import FLOOR, LEFT, STALLED
from varint.rules.rule import Rule
from varint.scene.system import System

RUNS = 8  # after which it is given up
PATIENCE = 2  # differences, one behind the other, that may not shrink: steps of a drive's period
# times as much may iterations leave in a run that no other one came before, which is no answer: the
# difference to the next one may be some twenty times the wanted error
COARSER = 30.0
# what iterations are to serve at most: what they leave also parts runs, where motions part
CLOSELY = 1e-4


@np.errstate(all="ignore")  # of steps that are too large
def by_short_refinement(
    system: System,
    rule: Rule,
    start: InitialValueProblem,
    tol: float,
    radians: float,
    scale: object,
    backend: str,
    began: float | None = None,
    varying: Varying | None = None,
    by_map: bool = False,
) -> Choice | None:
    """The choice that runs with more and more steps prove; None where they do not soon, or
    `by_map` where the map of a step would be repeated too often.

    Parameters
    ----------
    system : System
        One of `has_plain_trials`, without forces that jump.
    rule, start, tol, radians, scale, backend, varying
        As in `choose_steps`.
    """
    began = perf_counter() if began is None else began
    still, time = np.zeros(system.structure.n), np.array([start.t0])
    quadratic = system.structure.quadratic_kinetic
    # where rates are those of places alone what iterations leave has one sign: it adds up to more
    to_the_end = system.structure.degenerate
    driven = driven_kernel(system, rule) if backend == "auto" else None
    visible = not (driven or to_the_end) and scheme_of(system, rule) is BY_STAGES
    at_stages = stage_looks(system, rule) if visible else None
    stages = at_stages and (at_stages.heights, at_stages.counts[0])

    def run(
        steps: int,
        count: int,
        wanted: float,
        begin: InitialValueProblem = start,
        coarser: float = 1.0,
        looks: bool = False,
    ) -> PlainTrial | None:
        problem, most = first_steps_of(begin, rule, steps, count, tol), POOR
        level = 0.0 if to_the_end else iteration_level(min(wanted, CLOSELY), count)
        if level and coarser > 1.0:  # so much sooner it is over, or hardly contracts
            most = math.floor(POOR * math.log(level * coarser) / math.log(level))
        problem = problem._replace(level=level * coarser, most=most)
        mapped = driven if REPEATED * steps**2 <= tol else None
        kernel = mapped or kernel_for(system, rule, problem, backend)
        at = stages if looks and kernel and not kernel.opening else None
        found = kernel and run_at_once(system, rule, problem, kernel, short=False, looks=at)
        good = found and found.done and np.isfinite(found.rows[-1, 0]).all()
        return PlainTrial(problem, kernel, found) if kernel and found and good else None

    def scales_by(one: PlainTrial) -> np.ndarray:
        if scale is not None:
            return error_scales(system, plain_motion(system, rule, one, began), scale)
        q = one.found.rows[:, 0].copy()
        v = still if quadratic else np.nan_to_num(one.found.rows[0, 2])
        return scales_of_nodes(system, q, v, time, start.c)

    def apart(one: PlainTrial, few: int, other: PlainTrial, many: int) -> np.ndarray:
        """Differences, node by node and coordinate by coordinate."""
        unit = math.gcd(few, many)
        a, b = one.found.rows[:: few // unit, 0], other.found.rows[:: many // unit, 0]
        count = min(len(a), len(b))
        return np.abs(a[:count] - b[:count])

    def by_round_off(one: PlainTrial, steps: int, wanted: float, known: float) -> float:
        """What round-off grows to, the start's included, with which all runs begin alike."""
        scales = scales_by(one)

        def other(way: int) -> float:
            q0, p0 = with_other_digits(start.q0, start.p0, way)
            h = with_other_times(start.h, way)
            found = run(steps, steps, wanted, start._replace(q0=q0, p0=p0, h=h))
            if found is None:
                return math.inf
            return float((apart(one, 1, found, 1) / scales).max())

        return parted(other, known, tol)[0]

    def again(
        steps: int, one: PlainTrial, wanted: float
    ) -> Callable[[int, int], np.ndarray | None]:
        """What does steps of a run once more in parts, from any of its nodes."""
        rows, h = one.found.rows, start.h / steps

        def nodes(k: int, count: int) -> np.ndarray | None:
            begin = start._replace(q0=rows[k, 0], p0=rows[k, 1], t0=h * k + start.t0)
            fine = run(PARTS * steps, count, wanted, begin)
            return fine and fine.found.rows

        return nodes

    first = refined_first(system, priced({rule: 1.0})[0], radians, tol)
    before: tuple[int, PlainTrial] | None = None
    steps, last, runs, ratio, slower = 4 * math.ceil(first / 4), math.inf, 0, *RATIOS
    stalls, shown = 0, math.inf
    growth = between = uneven = 1.0
    looks = True  # whether it is told what the stages of the next run show
    while runs < RUNS:
        if by_map and not (driven and REPEATED * steps**2 <= tol):
            return None
        wanted = tol / (growth * between * uneven)
        motion = run(steps, steps, wanted, coarser=COARSER if before is None else 1.0, looks=looks)
        runs, uneven, looks = runs + 1, 1.0, True
        if motion is None:
            runs -= bool(driven and REPEATED * steps**2 <= tol)  # too long for a map: not made
            before, steps, ratio, stalls = None, 2 * steps, RATIOS[0], 0
            last = shown = math.inf
            continue
        shows = shown_by(motion.found.seen, steps, system.structure.n)
        if before is None:
            if shows.d.size:
                ratio, uneven, looks = planned_by_stages(shows, tol, rule.order)
            before, steps = (steps, motion), round(ratio * steps)
            continue
        if varying and steps >= FOLLOWED:
            followed, varying = varying(plain_motion(system, rule, motion, began)), None
            if followed:
                return replace(followed, runs=followed.runs + runs)
        scales = scales_by(motion)
        differ = apart(before[1], before[0], motion, steps) / scales
        seen = float(differ.max())
        # no smooth motion comes together faster than by the rule's order: less is luck
        off = max(seen, last * slower**-rule.order if last < NO_DIGITS else 0.0)
        stalls = 0 if off <= STALLED * last else stalls + 1
        if math.isnan(seen) or stalls > PATIENCE:
            return None
        if off < NO_DIGITS:
            # the last two runs say it best: unresolved narrow places look like growth
            growth = max(growth_of(*with_early(differ)), 1.0)
            shared = slice(None, None, steps // math.gcd(before[0], steps))
            between = beyond_shared(differ, motion.found.rows[:, 0], shared)
        rounded = rounding(off, radians, steps, growth)
        if stalls and rounded == off:
            return None
        order = LEAST_ORDER
        if last < TELLS:  # or more, where the ratio was smaller before
            drop = math.log(max(last, FLOOR) / max(off, FLOOR)) / math.log(slower)
            if math.gcd(before[0], steps) >= SHARED:
                order = min(max(min(drop, shown), order), rule.order)
            shown = drop
        size = np.abs(motion.found.rows[:, 0]).max(axis=0)
        least = max(FLOOR, REPEATED * steps**2) if motion.kernel is driven else FLOOR
        floor = least * float((size / scales).max(initial=1.0))
        solved = motion.kernel is driven  # by one map: without iterations
        each = (
            0.0
            if solved or to_the_end
            else LEFT * iteration_level(min(wanted, CLOSELY), steps) * math.sqrt(steps)
        )
        iterated = iterated_by(each, off, growth, between)
        left = _left(off, ratio, order, rule.order)
        by_stages = math.inf
        coarse_one = shown_by(before[1].found.seen, before[0], system.structure.n)
        if off < TELLS and not between * left <= tol:
            by_stages = left_by_stages(coarse_one, shows, off, rule.order)
        by_steps = max(min(left, by_stages), rounded)
        by_passages = passed_by(steps / first, off, between, tol)
        estimate = max(between * by_steps, by_passages, floor, iterated)
        # on an order, which may be luck; of two runs alone the finer may err by several times `off`
        by_order = not solved and last < math.inf and math.gcd(before[0], steps) >= SHARED
        counted = by_stages < left or by_order
        if counted and left <= by_stages:
            estimate = max(estimate, between * least_by_stages(coarse_one, shows))
        if counted and off < NO_DIGITS and estimate <= tol:
            coarse = before[1].found.rows[:: before[0] // math.gcd(before[0], steps)]
            nodes = again(steps, motion, wanted)
            estimate = max(estimate, made_at_once(coarse, motion.found.rows, off, scales, nodes))
        if CLOSE * tol < off < NO_DIGITS and estimate <= tol:
            grows, when = growth * between, (start.t0, start.h / steps)
            nodes, rows = again(steps, motion, tol / grows), motion.found.rows
            known = rows, when, start.c, scales, tol / grows, nodes
            estimate = max(estimate, grows * made_by_bends(system, rule, *known))
        if off < NO_DIGITS and estimate <= tol and growth >= GROWS:
            grown = likely_rounding(radians, steps, growth) * between
            if not grown <= tol:
                grown = by_round_off(motion, steps, wanted, estimate)
            if not grown <= tol:
                return None
            estimate = max(estimate, grown)
        begins_well = True
        if off < NO_DIGITS and estimate <= tol:
            few = before_shared(before[0], steps)
            early = 0.0
            if not begins_clearly(coarse_one, shows, few, tol, rule.order):
                fine = run(steps * TRANSIENT_PARTS, few * TRANSIENT_PARTS, wanted)
                if fine is None:
                    return None
                early = float((apart(motion, 1, fine, TRANSIENT_PARTS) / scales).max())
            if math.isnan(early):
                return None
            begins_well = early <= tol
            if begins_well:
                whole = plain_motion(system, rule, motion, began)
                estimate = max(estimate, early, looked_at_closely(rule, whole, scales, tol))
                found = Choice(rule, steps, whole, estimate, runs, True, True)
                return found if estimate <= tol else None
        near, far = RATIOS
        expected = _left(off * near ** (-CAUTION * rule.order), near, rule.order, rule.order)
        closer = begins_well and not stalls and expected <= tol
        before, last, slower = (steps, motion), off, ratio
        ratio = near if closer and steps % 2 == 0 else far
        if by_stages < math.inf and begins_well and not stalls:
            ratio = ratio_to(steps, by_stages, tol / between, rule.order)
        steps = round(ratio * steps)
    return None


def refined_first(system: System, rule: Priced, radians: float, tol: float) -> int:
    """Steps of the first run: those of a small oscillation, which is all that a linear scene has,
    and whose steps are solved for however long they are. Others have some at least: a run of fewer
    takes as long, because these are iterated longer.
    """
    if system.structure.linear and rule.rule.points:
        turned = max(radians, 1.0)
        return math.ceil(turned * (turned * rule.error / ROUGH) ** rule.root)
    return max(first_steps(rule, radians, tol * 2.0 ** (CAUTION / rule.root)), FEWEST)


def _left(apart: float, ratio: float, order: float, best: int) -> float:
    """Error of the finer of two runs that are so far apart, by the order that runs have shown."""
    counted = part_left(ratio, order, best)
    return apart * counted / (1 - counted)

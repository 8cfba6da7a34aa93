"""Steps for a wanted error from runs with more and more of them, whatever order they show."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from varint.errors import InputError
from varint.integration.attempts import energy_errors
from varint.integration.backend import runs_by_stages
from varint.integration.bent_steps import CLOSE, made_by_bends
from varint.integration.choice import Choice
from varint.integration.cost import repays
from varint.integration.energy_check import energy_jump
from varint.integration.error_scale import careful_scales
from varint.integration.hidden import missed_impulse
from varint.integration.narrow_places import PARTS
from varint.integration.problem import InitialValueProblem
from varint.integration.resolved_steps import resolves, strays
from varint.integration.round_off import (
    GROWS,
    growth_of,
    iterated_by,
    late_rounding,
    likely_rounding,
    passed_by,
    rounding,
)
from varint.integration.rule_choice import iteration_level, steps_for
from varint.integration.run_distance import (
    beyond_shared,
    differences,
    ends_apart,
    shared_nodes,
    with_early,
)
from varint.integration.second_looks import (
    Trial,
    blown_apart,
    by_last_digits,
    has_steps,
    luck,
    start_rounding,
    transient,
)
from varint.integration.shown_order import CAUTION, LEAST_ORDER, left_of_pair
from varint.integration.two_runs import (
    EVIDENCE,
    FLOOR,
    LEFT,
    MIDDLE,
    STALLED,
    STILL,
    shows_its_error,
)
from varint.integration.walls import Failure, no_way_on, require_way_on
from varint.results.trajectory import Trajectory
from varint.rules.rule import Rule
from varint.scene.system import System

MOST_STEPS, MOST_INTERPRETED = 60_000_000, 1_000_000
SPARE = 1.1  # more steps than the estimate asks for
NO_DIGITS = 0.01  # of the motion's size: runs that far apart say nothing but that h is too large
PATIENCE = 5  # times that it may, before round-off or chaos is taken for the cause
SCATTERED = 5  # runs that resolve the motion, and of which other last digits leave none
CERTAIN = 2  # times, where there were digits already and nothing jumps
# times the steps of a run with contacts, where that many are missing and runs come together by the
# rule's order: those between would take longer than they tell
LEAP = 4
# steps over forces that jump or hardly last, or whose energy is another one, beyond which more
# would not do
ENOUGH = 2**20
HOPELESS = 2**18  # those over forces that jump, where not even the most would do
# a run that went astray, or which rate varies along it → the choice with steps that follow the
# scene, where it asks for them
Varying = Callable[[Trajectory | int], Choice | None]
# steps of a run over forces beyond which it is seen whether a rate varies along it, once; of one
# that keeps its energy, below which runs that do not come together are taken for unresolved
FOLLOWED = 4096


def refine(
    system: System,
    rule: Rule,
    start: InitialValueProblem,
    tol: float,
    radians: float,
    trial: Trial,
    failures: Sequence[Failure],
    steps: int,
    scale: Any,
    ends_early: bool,
    varying: Varying | None = None,
) -> Choice:
    """Runs with more and more steps until the estimate meets tol, or they stop to come together."""
    before: tuple[int, Trajectory] | None = None
    apart, growth, order, stalls, runs, best = math.inf, 1.0, None, 0, 0, None
    ratio = 2.0  # of the steps of the last two runs
    sample: tuple[int, Trajectory] | None = None  # of runs with contacts: of few steps
    shown = math.inf  # order of the last two pairs of runs, however large
    by_order = math.inf  # what the rule's order leaves of the first difference with digits
    over_jumps = has_steps(system)
    smooth = shows_its_error(system) and not over_jumps
    # blows part runs by as much as their instants are apart, which is no growth
    leaps = system.structure.contacts and not over_jumps
    forced = not (smooth or over_jumps or system.structure.contacts)
    regular, between, wanted = steps_for(rule, radians, tol), 1.0, tol
    # iterations go on to round-off
    solved = (start.steps == 1 and shows_its_error(system)) or system.structure.degenerate
    quick = runs_by_stages(system, rule, "auto") or repays(system, rule, MOST_STEPS)
    most = MOST_STEPS if quick else MOST_INTERPRETED
    s = system.structure
    free, followed = not (s.nonholonomic or system.rays), False
    scattered = 0  # runs whose last digits have become all of them

    def begun(steps: int, motion: Trajectory, known: float) -> float:
        if sample is not None:
            if not blown_apart(trial, rule, sample, scale, tol):
                return 0.0
        elif not (free and growth > GROWS):
            return 0.0
        likely = likely_rounding(radians, steps, growth) * between
        if forced and likely <= tol:
            return likely
        scales = careful_scales(system, motion, scale)
        other = partial(trial, wanted=wanted)
        return start_rounding(other, rule, steps, motion, scales, known, tol)

    def by_bends(steps: int, motion: Trajectory, wanted: float, scales: np.ndarray) -> float:
        if not forced or start.steps > 1 or ends_early or len(motion) != steps + 1:
            return 0.0
        rows = np.stack((motion.q, motion.p, motion.v), axis=1)

        def again(k: int, count: int) -> np.ndarray | None:
            node = rows[k, 0], rows[k, 1], float(motion.t[k])
            fine = trial(rule, PARTS * steps, wanted=wanted, node=node, count=count)
            return None if fine is None else np.stack((fine.q, fine.p), axis=1)

        when = start.t0, motion.h
        return made_by_bends(system, rule, rows, when, start.c, scales, wanted, again)

    while steps <= most:
        wanted = tol / (growth * between) if forced else tol
        motion, runs = trial(rule, steps, wanted=wanted), runs + 1
        if motion is None or not np.isfinite(motion.q).all():
            found = varying and failures and varying(failures[-1][1].trajectory)
            if found:
                return replace(found, runs=found.runs + runs)
            require_way_on(failures, start.h * start.steps, jumps=over_jumps)
            before, apart, by_order, order, steps = None, math.inf, math.inf, None, 2 * steps
            shown = math.inf
            continue
        if smooth and energy_jump(motion):  # steps lead over what turns it back
            before, apart, by_order, order, steps = None, math.inf, math.inf, None, 2 * steps
            shown, stalls = math.inf, 0
            if steps > min(most, ENOUGH):
                return Choice(rule, steps // 2, motion, 1.0, runs, False)
            continue
        if forced and varying and not followed and steps >= FOLLOWED:
            followed, found = True, varying(motion)
            if found:
                return replace(found, runs=found.runs + runs)
        if before is None:
            before, steps = (steps, motion), 2 * steps
            continue
        scales = careful_scales(system, motion, scale)
        # over jumps it is looked for at the end alone, where parts of steps are few
        missed = 0.0 if over_jumps else missed_impulse(system, rule, motion, scales, tol)
        if missed > tol:
            # a pulse passed over: what such runs agree on says nothing
            before, apart, order, stalls, shown = (steps, motion), math.inf, None, 0, math.inf
            if 2 * steps > min(most, ENOUGH):
                best = Choice(rule, steps, motion, missed, runs, False)
                break
            steps *= 2
            continue
        sample = (steps, motion) if leaps and sample is None else sample
        longer, ratio, last, coarse = ratio, steps / before[0], apart, before[0]
        differ = differences(before[1], before[0], motion, steps, scales)
        seen, early = with_early(differ)
        if smooth:
            growth = max(growth, growth_of(seen, early))
        elif forced and seen < NO_DIGITS:
            # the last two runs say it best: unresolved narrow places look like growth
            growth = max(growth_of(seen, early), 1.0)
            shared = shared_nodes(before[1], before[0], motion, steps)[1]
            between = beyond_shared(differ, motion.q, shared, motion.t)
        if ends_early:
            seen = max(seen, ends_apart(before[1], motion, scales))
        # no smooth motion comes together faster than by the rule's order: less is luck
        left = left_of_pair(longer if leaps else ratio, ratio, rule.order)
        apart = max(seen, 0.0 if math.isinf(last) else last * left)
        if ratio in (2, LEAP) and last < math.inf:
            farther = min(max(apart, FLOOR), 1 / FLOOR)  # without end where a run is over at once
            drop = math.log2(max(last, FLOOR) / farther) / max(math.log2(longer), 1.0)
            order = min(max(drop if over_jumps else min(drop, shown), LEAST_ORDER), rule.order)
            shown = drop
        before = steps, motion
        rounded = rounding(apart, radians, steps, growth)
        lost = apart >= NO_DIGITS and free and not (over_jumps or leaps)
        resolved = (lost or apart > STALLED * last) and resolves(motion)
        stalled = apart > STALLED * last and resolved
        strayed = apart >= NO_DIGITS and strays(system, motion, radians, NO_DIGITS)
        stalls = stalls + 1 if stalled and not strayed else 0
        first = math.isinf(by_order) and apart < NO_DIGITS
        by_order = apart if first else by_order * ratio ** (-CAUTION * rule.order)
        sure = best is not None and apart < NO_DIGITS and not over_jumps
        sure = sure and (steps >= FOLLOWED or not smooth)
        if stalls:
            # linear scenes and rolling ones keep their energy whatever the steps; elsewhere runs
            # whose energy has no larger error are apart by the growth of round-off alone
            tells = smooth and free and not s.linear
            still = tells and energy_errors(motion)[MIDDLE] < STILL
            sooner = smooth and apart > EVIDENCE * by_order
            grown = (rounded == apart or sooner) and steps >= FOLLOWED
            wanders = apart > tol and (grown or still)
            if wanders or stalls == (CERTAIN if sure else PATIENCE):
                best = best and replace(best, estimate=max(best.estimate, apart))
                break
        if lost and resolved:
            scattered += by_last_digits(trial, rule, steps, motion, scales, wanted) >= NO_DIGITS
            if scattered == SCATTERED:
                break
        if order is not None and apart < NO_DIGITS:
            # far below the rule's it is that of steps that do not resolve the motion yet
            lasting = order if over_jumps else max(order * (order / rule.order), LEAST_ORDER)
            counted = ratio ** (-CAUTION * lasting)
            floor = FLOOR * float((np.abs(motion.q).max(axis=0) / scales).max(initial=1.0))
            floor = max(floor, late_rounding(motion, scales))
            left = 0.0 if solved else LEFT * iteration_level(wanted, steps) * math.sqrt(steps)
            left = iterated_by(left, apart, growth, between) if forced else left
            passed = passed_by(steps / regular, apart, between, tol) if forced else 0.0
            by_steps = max(apart * counted / (1 - counted), rounded)
            estimate = max(between * by_steps, passed, floor, left)
            hidden = begins = 0.0
            if estimate <= tol:
                if over_jumps:
                    missed = missed_impulse(system, rule, motion, scales, tol)
                hidden = max(
                    transient(trial, rule, coarse, steps, motion, scales),
                    missed,
                    luck(system, trial, rule, start.steps, steps, motion, scales),
                )
                begins = begun(steps, motion, estimate)
                if apart > CLOSE * tol:
                    grows = growth * between
                    hidden = max(hidden, grows * by_bends(steps, motion, tol / grows, scales))
            found = Choice(rule, steps, motion, max(estimate, hidden, begins), runs, True)
            if best is None or found.estimate < best.estimate:
                best = found
            if found.estimate <= tol:
                return found
            if begins > tol or floor >= estimate > tol:  # whatever the steps
                return replace(found, reached=False)
            hopeless = steps * (estimate / tol) ** (1 / order) > most  # by the order that shows
            if hopeless and steps >= HOPELESS and over_jumps:
                break
            more = SPARE * (estimate / tol) ** (1 / (CAUTION * order))
            if 1 < more < 2 and steps // start.steps % 4 == 0:  # whole ones in rows of a table
                steps = steps * math.ceil(4 * more) // 4
            else:
                steps *= LEAP if leaps and more >= LEAP and order >= CAUTION * rule.order else 2
            continue
        steps *= 2
    if best is None and before is not None and math.isfinite(apart):
        best = Choice(rule, *before, apart, runs, False)  # no digit is certain: it says so
    if best is not None:
        estimate = max(best.estimate, begun(best.steps, best.motion, best.estimate))
        return replace(best, estimate=estimate, reached=False, runs=runs)
    if failures:
        raise no_way_on(failures, over_jumps)
    raise InputError(
        f"no number of steps up to {most:.0g} by {rule} leads through the duration "
        f"{start.h * start.steps:g} with finite coordinates; take a shorter duration, or give h "
        "to see where it ends"
    )

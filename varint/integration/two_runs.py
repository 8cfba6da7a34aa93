"""Steps for a wanted error from two runs: a coarse one and the run itself, and their energies.

Two runs that differ by d bound the error of the finer one only together with how fast errors
shrink. Where the scene keeps its energy, every run shows that by itself: its energy error is known
without another run, and both errors are those of the same modified scene (Hairer, Lubich & Wanner,
Geometric Numerical Integration, IX.8 and X.3). So the shrinkage is measured over the whole motion,
not assumed from the rule's order, and a coarse run of half the steps is all that the proof costs.
The first energy error, of a part of a long run, says how many steps to begin with.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

from varint.integration.attempts import Attempt
from varint.integration.energy_check import keeps_energy
from varint.integration.round_off import (
    CHANCE,
    GROWS,
    ROUNDED,
    UNEVEN,
    growth_of,
    likely_rounding,
    magnified,
    parted,
    rounding,
)
from varint.integration.rule_choice import iteration_level
from varint.integration.shown_order import left_by_order
from varint.rules.rule import Rule
from varint.scene.system import System

ROUGH = 0.01  # error of a coarse run at most, for its difference to say something
HALF = 4.0  # less than the errors of runs of half the steps: what a coarse run aims at
# differences below may be round-off, which no order makes less; over forces such an error is told
BY_CHANCE = 1e-11
FLOOR = 4e-15  # relative error that no comparison of two runs resolves
LOST = 0.3  # predicted errors beyond which a run is none
GAIN = 2.0  # error of the phase over the relative error of the energy times the angle turned
MARGIN = 30.0  # of the error: predictions are as uncertain, and the proof is a cautious one
SAFETY = 4.0  # of the measured shrinkage
SPREAD = 1.5  # of errors between the nodes that two runs share
EVIDENCE = 30.0  # times its round-off: an energy error that says something
MIDDLE = 2  # the index of one of them that a few rough nodes do not touch
# of the energy errors of two runs: what iterations leave hides it, or the range of the rule is not
# reached; the finer run is then taken for hardly the better one
NO_SHRINKAGE, NOT_WORSE = 0.3, 2 / 3
HOPELESS = 10.0  # times tol, that round-off makes: far out of reach, whatever the steps
STILL = 1e-13  # of the energy: an error that is hardly more than round-off, mostly
# of the difference before: three runs agree more and more, where energies tell nothing any more
CONVERGES = 0.01
STALLED = 0.6  # a difference that shrinks by less has stopped to shrink
LONG, PARTS = 1500, 16  # steps of a run that is worth a look at a part of it first
PART_CLOSE = 20.0  # factor that a prediction from a part may be off
# parts of a shorter coarse run, the first of which is looked at before the others are run; steps of
# that part at least; fewest parts that are worth it
WATCHED, FIRST_PART, FEWEST = 8, 8, 4
SLOW = 20  # iterations a step of a part beyond which twice the steps take less time
# steps of a smooth motion up to which an iteration that fails is a sign of too few: twice as many
# take less time than Newton's method, but for a stiff part that is at rest
UNRESCUED = 2**15
ATTEMPTS = 6
SHARED = (256, 16), (96, 8)  # steps above which runs have so many parts that both can share
CAUTION = 0.85  # of the rule's order is counted on at most
# ratio of the steps of two runs: at least, what a new coarse run aims at, and at most, where the
# error that is predicted of the first coarse one is not clearly small, and otherwise
LEAST, GOOD, MOST, FAR = 1.25, 2.5, 2.7, 4.0
# the same where the comparison of two runs was not enough: by fewer more energies often do not
# shrink, for steps may lie in a resonance
AGAIN = 1.5
CLEAR = 0.03  # such an error
SEEN_PARTS = 64  # that two runs share: of what is uneven its root is looked past
# of a map that is the same in all steps: where something drifts freely, its round-off grows with
# the square of their number; of 700 runs, some of them drifting, one had five times the difference
SAME_ROUNDING, SAME_CHANCE = 2e-16, 10.0
SAME_STEP = 2e-15  # of a motion in a step of such a map: the floor of what runs resolve
LEFT = 4.0  # of what the iterations of all steps leave, as a random walk


Trial = Callable[[int, float, int], Attempt | None]  # (steps, wanted error, part of the run)
# two runs and their steps → largest difference, that of their first half, and how many times larger
# it is between shared nodes
Apart = Callable[[Any, int, Any, int], tuple[float, float, float]]


class Course(NamedTuple):
    """How a motion is run with so many steps and two runs are compared; how far its fastest small
    motions turn; where the rule's order is sure for all steps that resolve them (linear scenes);
    how often steps are added before it is given up; into how many parts a coarse run is divided at
    most, so that one that is lost in the first of them ends there; part of `ROUGH` that iterations
    of a coarse one leave at most; a run with so many steps for a wanted error, from a start with
    other last digits, in one of `WAYS`; whether all steps are one map; how much the first run that
    is compared expects errors to grow beyond those of regular motions; how many differences show
    an error: where forces act energies do not tell all of it, and a second one shows an order.
    """

    trial: Trial
    apart: Apart
    radians: float
    linear: bool = False
    attempts: int = ATTEMPTS
    watched: int = 1
    closer: float = 1.0
    parted: Callable[[int, float, int], Attempt | None] | None = None
    exact: bool = False
    foreseen: float = 1.0
    pairs: int = 1


class Proved(NamedTuple):
    """A run with so many steps, its estimated error, and how many runs it took."""

    steps: int
    run: Any
    estimate: float
    runs: int


def shows_its_error(system: System) -> bool:
    """Whether the energy of a run tells of its error."""
    s = system.structure
    return keeps_energy(system) and not (s.contacts or s.degenerate)


def run_twice(rule: Rule, course: Course, first: int, tol: float, floor: float) -> Proved | None:
    """A run whose error is below tol by the difference to a coarser one, or as small as round-off
    lets it be where that is far above tol; None where neither can be shown.

    Parameters
    ----------
    rule : Rule
    course : Course
    first : int
        Steps to begin with.
    tol, floor : float
        Wanted error, and the one that no comparison resolves.
    """
    p = rule.order
    rough = min(ROUGH, tol * 2.0**p / HALF)
    steps, runs = _shared(first), 0
    if not course.exact:
        steps, runs = _by_a_part(course, steps, rough, p)
    coarse: Attempt | None = None
    level = min(rough, ROUGH * course.closer)
    expected = before = math.inf
    clear, doubted = CLEAR, False  # once, for steps may lie in a resonance
    growth = start_growth = between = 1.0
    last, still, short, measured = None, False, False, False
    compared, apart, ratio = 0, math.inf, 1.0
    other_starts = course.parted is not None and not course.exact
    for _ in range(course.attempts):
        if coarse is None:
            tried, runs = _coarse(course, steps, level), runs + 1
            expected = _expected(course, tried)
            if tried is None or not expected <= LOST:
                if tried is not None and _by_error(course, tried.digit) > LOST:
                    return None  # it has come to rest: of energies nothing is left but round-off
                steps = _shared(steps * _ratio(expected, rough, p, 2.0))
                continue
            wanted = _ratio(MARGIN * expected, tol, p, math.inf)
            if wanted > (FAR if expected <= clear else MOST):
                steps, clear = _shared(steps * wanted / GOOD), LOST
                continue
            coarse = tried
        finer = _ratio(MARGIN * expected, tol, p, FAR)
        if compared >= course.pairs:
            finer = max(finer, AGAIN)
        elif compared < course.pairs - 1:
            finer = min(finer, AGAIN)
        more = _shared(steps * finer)
        wanted = tol / max(growth * between, course.foreseen)
        fine, runs = course.trial(more, wanted, 1), runs + 1
        if fine is None:
            break
        previous = apart, ratio
        apart, early, beyond = course.apart(coarse.run, steps, fine.run, more)
        seen = apart, early, coarse.swing[MIDDLE]
        growth, start_growth = max(growth, growth_of(*seen)), max(start_growth, magnified(*seen))
        between = max(between, beyond)
        left = LEFT * iteration_level(wanted, more) * math.sqrt(more) * growth * beyond
        uneven = min(start_growth, UNEVEN)
        likely = uneven if math.gcd(steps, more) < SEEN_PARTS else math.sqrt(uneven)
        spread = SPREAD * max(likely, beyond)
        limit = rounding(math.inf, course.radians, more, growth)
        calm = start_growth < GROWS and fine.swing[MIDDLE] < STILL
        if limit > HOPELESS * tol and calm and course.pairs == 1:
            sure = (more / steps) ** (-CAUTION * p)  # energies hide how much smaller errors are
            by_steps = max(spread * apart * sure / (1 - sure), left, floor)
            if by_steps < limit and apart < ROUGH * EVIDENCE:
                rounded = beyond * min(limit, CHANCE * apart)
                return Proved(more, fine.run, max(by_steps, rounded), runs)
        rounded, ratio = min(apart, limit), more / steps
        if course.exact:
            rounded = max(rounded, min(SAME_CHANCE * apart, SAME_ROUNDING * more**2))
        if not math.isfinite(apart):
            return None
        # energies are round-off, and differences shrink by far less than truncation does
        still = not course.linear and fine.swing[MIDDLE] > NO_SHRINKAGE * coarse.swing[MIDDLE]
        fewer = before < ROUGH * EVIDENCE and EVIDENCE * before * ratio ** (-CAUTION * p) < apart
        short = still and fewer
        last = Proved(more, fine.run, max(max(CHANCE * beyond, spread) * apart, left, floor), runs)
        compared += 1
        shrinkage = _shrinkage(coarse, fine, ratio, p, course.linear or course.pairs > 1)
        if shrinkage is not None and compared > 1 and course.pairs > 1:
            shrinkage = max(shrinkage, left_by_order(previous, apart, ratio, p, FLOOR))
        if (short or apart > STALLED * before) and rounded > tol:
            break
        converges = apart < CONVERGES * before < math.inf
        if shrinkage is None and converges and fine.swing[MIDDLE] < STILL:
            shrinkage = NOT_WORSE  # of energies nothing is left but round-off, which grows
        if shrinkage is None:
            expected = max(_expected(course, fine), apart)
            if doubted or not expected <= LOST:
                break
            coarse, steps, doubted = fine, more, True
            continue
        # no reason for more steps: runs from other starts show what round-off makes
        unseen = growth >= GROWS and rounded > tol and other_starts and not measured
        by_steps = spread * apart * shrinkage / (1 - shrinkage)
        shown = max(by_steps, 0.0 if unseen else beyond * rounded, floor)
        if course.pairs > 1:
            shown = max(shown, min(apart, tol, BY_CHANCE))
        if compared >= course.pairs and apart < ROUGH * EVIDENCE and max(shown, left) <= tol:
            found = Proved(more, fine.run, max(shown, left), runs)
            likely = likely_rounding(course.radians, more, start_growth) * beyond
            regular = start_growth < GROWS
            if regular and course.foreseen <= 1:
                return found
            if likely <= tol:  # a run that shows less would only be made for that
                return found._replace(estimate=max(found.estimate, likely))
            if regular:
                return found
            grown, made = by_round_off(course, found, wanted, tol)
            runs, measured = runs + made, unseen
            grown *= CHANCE if unseen else 1.0
            if grown <= tol or not unseen:
                return found._replace(estimate=max(found.estimate, grown), runs=runs)
        coarse, steps, before = fine, more, apart
        expected = shown if apart < ROUGH * EVIDENCE else apart
    if last is None:
        return None
    grown, made = by_round_off(course, last, wanted, tol) if start_growth >= GROWS else (0.0, 0)
    last = last._replace(estimate=max(last.estimate, grown), runs=last.runs + made)
    limited = still and doubted and last.estimate <= tol  # energies hide how small errors are
    # a narrow place that steps are too long for looks like growth: round-off that was measured
    # and is small says that it is none
    hopeless = short and apart > HOPELESS * tol and not (made and grown <= tol)
    if limited or grown > tol or hopeless:  # whatever the steps
        return last
    return None


def by_round_off(course: Course, found: Proved, wanted: float, tol: float) -> tuple[float, int]:
    """What round-off grows to, the start's included, with which all runs begin alike; in so many
    runs.
    """
    run = course.parted
    if run is None:
        return 0.0, 0

    def apart(way: int) -> float:
        other = run(found.steps, wanted, way)
        if other is None:
            return math.inf
        return course.apart(found.run, found.steps, other.run, found.steps)[0]

    return parted(apart, found.estimate, tol)


def _expected(course: Course, tried: Attempt | None) -> float:
    """Error of a run that its energy lets expect."""
    return math.inf if tried is None else _by_error(course, tried.swing[-1])


def _by_error(course: Course, swing: float) -> float:
    return GAIN * swing * max(course.radians, 1.0)


def _coarse(course: Course, steps: int, rough: float) -> Attempt | None:
    """A coarse run, or its first part where that is none already: the whole is not better."""
    parts = 1 if course.exact else min(course.watched, steps // FIRST_PART)
    if steps <= LONG and parts >= FEWEST:
        begun = course.trial(steps, rough, parts)
        if not _expected(course, begun) <= LOST:
            return begun
    return course.trial(steps, rough, 1)


def _by_a_part(course: Course, steps: int, rough: float, p: int) -> tuple[int, int]:
    """Steps of the coarse run by the energy error of a part of it, and how many parts were run."""
    runs = 0
    while steps > LONG and runs < 3:
        expected, runs = _expected(course, course.trial(steps, rough, PARTS)), runs + 1
        if rough / PART_CLOSE < expected < rough * PART_CLOSE:
            break
        factor = (max(expected, 1e-300) / rough) ** (1 / p) if math.isfinite(expected) else 2.0
        steps = _shared(steps * min(max(factor, 0.5), 2.0))
    return steps, runs


def _shrinkage(before: Attempt, after: Attempt, ratio: float, p: int, linear: bool) -> float | None:
    """Part of the coarse run's error that the finer one has left; None where it does not shrink."""
    sure, rounded = ratio ** (-CAUTION * p), max(before.hidden, ROUNDED)
    both = zip(before.swing, after.swing, strict=True)
    left = max([max(b, ROUNDED) / a for a, b in both if a > EVIDENCE * rounded], default=None)
    if left is None and not linear:
        return NOT_WORSE if rounded > ROUNDED else 0.5
    if left is None:
        return sure
    if left > NO_SHRINKAGE:
        return NOT_WORSE if left < 1 else None
    return max(min(SAFETY * left, 0.5), sure)


def _ratio(error: float, wanted: float, p: int, most: float) -> float:
    if not math.isfinite(error):
        return most
    return min(max((error / wanted) ** (1 / p), LEAST), most)


def _shared(steps: float) -> int:
    """As many steps or a few more, so that two runs share nodes: at least these parts of them."""
    parts = next((parts for least, parts in SHARED if steps > least), 4)
    return parts * max(math.ceil(steps / parts), 2)

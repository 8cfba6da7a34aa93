"""Which rule, and about how many steps, for a wanted error: by small oscillations and operations.

The choice is by the number of operations, never by the clock: the same input gives the same digits.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from functools import cache
from itertools import permutations
from typing import NamedTuple

import numpy as np

from varint.codegen.frozen import freezes
from varint.discrete.composed import base_of, shares, steps_by_gauss
from varint.integration.cost import interpreted_seconds
from varint.integration.plan import default_rule
from varint.integration.problem import LEVEL
from varint.rules.rule import Rule, composition, gauss, lobatto
from varint.scene.memory import per_scene
from varint.scene.system import System

RADIANS = 3.0  # of the fastest motion in a step where the trials begin
FEWEST = 8  # steps of a run that is compared with one of twice as many
SECULAR = 2.0  # divided by the square of the number of steps: what iterations leave adds up
# of the fastest frequency: what rules of low order resolve worst
OVERTONES = 2.0
ANHARMONIC = 1.5  # more steps than a small oscillation takes
# of steps of order 2 of scenes that have no other ones; the work of such a step, whose size is
# another one each time: nothing is known from the steps before, as it is between equal ones
COMPOSED = composition("suzuki4"), composition("kahan-li6"), composition("kahan-li8")
COMPOSED_WORK = 1.5
ROUGH = 0.01  # error of a run that says something
BY_FEW_MORE = 10.0  # times the wanted error: what a few more steps mend
MOST_LOGARITHM = 300.0  # of radians over a wanted error: more than anyone asks for


@per_scene
def candidates(system: System, compiled: bool, by_stages: bool = False) -> dict[Rule, float]:
    """Rules worth a try, with the work of a step: evaluations of a compiled one, seconds of an
    interpreted one. By stages: Gauss rules alone, whose loop is there at once.
    """
    s = system.structure
    own = default_rule(system)
    if s.nonholonomic or s.contacts or (s.degenerate and not steps_by_gauss(system)):
        composed = [rule for rule in COMPOSED if base_of(system, rule)]
        return {own: 1.0} | {rule: COMPOSED_WORK * len(shares(system, rule)) for rule in composed}
    if freezes(system):  # matrices are full, and grow with the square of the degree
        return {lobatto(3): 1.0}
    if s.constraints:
        return {lobatto(k): (k - 1) ** 1.5 for k in (3, 5, 7)}
    # stages run side by side in vectors of four or eight
    rules = {gauss(k): 5.0 * math.ceil(k / 4) for k in (2, 4, 6, 8)}
    if by_stages:
        return rules
    if s.explicit:
        explicit = (composition("blanes-moan4"), composition("kahan-li8"))
        rules |= {r: float(len(r.kicks)) for r in explicit}
    return rules if compiled else {rule: interpreted_seconds(system, rule) for rule in rules}


class Priced(NamedTuple):
    """A rule, the work of a step, its `phase_error`, the reciprocal of its order, and by how much
    half of the steps err more.
    """

    rule: Rule
    work: float
    error: float
    root: float
    more: float


def priced(rules: dict[Rule, float]) -> tuple[Priced, ...]:
    """`candidates` with all that does not depend on the motion."""
    return tuple(
        Priced(r, work, phase_error(r), 1 / r.order, 2.0**r.order) for r, work in rules.items()
    )


def _costs(rules: tuple[Priced, ...], turned: float) -> list[float]:
    """Work of each for a small oscillation, over so many radians divided by the wanted error."""
    return [x.work * max(OVERTONES * (turned * x.error) ** x.root, 1 / RADIANS) for x in rules]


def changes(rules: tuple[Priced, ...]) -> tuple[list[float], list[int]]:
    """Where another rule becomes the cheapest, as radians over the wanted error, and the cheapest
    ones before, between and behind.

    Costs are powers of that with a least one: two of them cross where the powers do, or one power
    and the other least.
    """
    crossings = [0.0]  # logarithms
    for a, b in permutations(rules, 2):
        least = math.log(b.work / (RADIANS * OVERTONES * a.work))
        crossings.append(least / a.root - math.log(a.error))
        if a.root != b.root:
            powers = [math.log(x.work) + x.root * math.log(x.error) for x in (a, b)]
            crossings.append((powers[1] - powers[0]) / (a.root - b.root))
    at = [math.exp(x) for x in sorted(crossings) if 0 <= x < MOST_LOGARITHM]
    between = [math.sqrt(x * y) for x, y in zip(at, [*at[1:], 4 * at[-1]], strict=True)]
    best = [costs.index(min(costs)) for costs in (_costs(rules, x) for x in between)]
    kept = [i for i in range(1, len(at)) if best[i] != best[i - 1]]
    return [at[i] for i in kept], [best[0], *(best[i] for i in kept)]


def cheapest(known: tuple[list[float], list[int]], radians: float, tol: float) -> int:
    """Which of the rules has least work for a small oscillation over so many radians, by their
    `changes`.
    """
    at, best = known
    return best[bisect_right(at, (radians if radians > 1 else 1.0) / tol)]


def choose_rule(rules: dict[Rule, float], radians: float, tol: float) -> Rule:
    """The one of `candidates` that has least work for a small oscillation over so many radians."""
    return cheapest_of(priced(rules), radians, tol).rule


def cheapest_of(rules: tuple[Priced, ...], radians: float, tol: float) -> Priced:
    """`choose_rule` of rules whose errors are known."""
    costs = _costs(rules, max(radians, 1.0) / tol)
    return rules[costs.index(min(costs))]


def choose_rule_for_rows(rules: dict[Rule, float], rows: int, radians: float, tol: float) -> Rule:
    """`choose_rule` of runs with as many steps in each of so many rows of a table."""
    known = priced(rules)
    steps = [rows * math.ceil(first_steps(x, radians, tol) / rows) for x in known]
    costs = [x.work * count for x, count in zip(known, steps, strict=True)]
    return known[costs.index(min(costs))].rule


@cache
def phase_error(rule: Rule) -> float:
    """Error of the phase ωt of an oscillator, divided by ωt (ωh)^order, as h → 0."""
    if rule.points:
        s = rule.order // 2
        return math.factorial(s) ** 2 / (math.factorial(2 * s) * math.factorial(2 * s + 1))
    x, step = 0.25, np.eye(2)
    for i, kick in enumerate(rule.kicks):
        if i:
            step = np.array([[1.0, rule.drifts[i - 1] * x], [0.0, 1.0]]) @ step
        step = np.array([[1.0, 0.0], [-kick * x, 1.0]]) @ step
    return max(abs(math.acos(np.clip(np.trace(step) / 2, -1, 1)) - x), 1e-16) / x ** (
        rule.order + 1
    )


def iteration_level(tol: float, steps: int) -> float:
    """Where compiled iterations may stop, so that what they leave adds up to less than tol."""
    return tol * min(LEVEL, SECULAR / steps**2)


def steps_for(rule: Rule, radians: float, tol: float) -> int:
    """Steps of a coarse run to begin with: those of a small oscillation, and half as many more."""
    return first_steps(priced({rule: 1.0})[0], radians, tol)


def first_steps(rule: Priced, radians: float, tol: float) -> int:
    """`steps_for` of a rule whose errors are known."""
    # without `max` and `min`, whose calls a short run notices
    turned, rough = radians if radians > 1.0 else 1.0, tol * rule.more
    each = (turned * rule.error / (rough if rough < ROUGH else ROUGH)) ** rule.root
    return math.ceil(ANHARMONIC * turned * (each if each > 1 / RADIANS else 1 / RADIANS))


def steps_of_map(rule: Rule, radians: float, tol: float) -> int:
    """Steps of a run of a linear scene whose error is ten times as large as wanted, where a few
    more steps show it: that of its phase is known.
    """
    turned = max(radians, 1.0)
    each = (turned * phase_error(rule) / (BY_FEW_MORE * tol)) ** (1 / rule.order)
    return math.ceil(turned * max(each, 1 / RADIANS))

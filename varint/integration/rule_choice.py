"""Which rule, and about how many steps, for a wanted error: by small oscillations and operations.

The choice is by the number of operations, never by the clock: the same input gives the same digits.
"""

from __future__ import annotations

import math
from functools import cache
from typing import NamedTuple

import numpy as np

from varint.codegen.frozen import freezes
from varint.integration.cost import interpreted_seconds
from varint.integration.plan import default_rule
from varint.integration.problem import LEVEL
from varint.rules.rule import Rule, composition, gauss, lobatto
from varint.scene.memory import per_scene
from varint.scene.system import System

RADIANS = 3.0  # of the fastest motion in a step where the trials begin
SECULAR = 2.0  # divided by the square of the number of steps: what iterations leave adds up
# of the fastest frequency: what rules of low order resolve worst
OVERTONES = 2.0
ANHARMONIC = 1.5  # more steps than a small oscillation takes
ROUGH = 0.01  # error of a run that says something


@per_scene
def candidates(system: System, compiled: bool, by_stages: bool = False) -> dict[Rule, float]:
    """Rules worth a try, with the work of a step: evaluations of a compiled one, seconds of an
    interpreted one. By stages: Gauss rules alone, whose loop is there at once.
    """
    s = system.structure
    if s.nonholonomic or s.degenerate or s.contacts:
        return {default_rule(system): 1.0}
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
    """A rule, the work of a step, its `phase_error`, and the reciprocal of its order."""

    rule: Rule
    work: float
    error: float
    root: float


def priced(rules: dict[Rule, float]) -> tuple[Priced, ...]:
    """`candidates` with all that does not depend on the motion."""
    return tuple(Priced(r, work, phase_error(r), 1 / r.order) for r, work in rules.items())


def cheapest(rules: tuple[Priced, ...], radians: float, tol: float) -> Rule:
    """The rule of least work for a small oscillation over so many radians."""
    if len(rules) == 1:
        return rules[0].rule
    turned, fewest = max(radians, 1.0) / tol, 1 / RADIANS
    costs = [
        work * max(OVERTONES * (turned * error) ** root, fewest) for _, work, error, root in rules
    ]
    return rules[costs.index(min(costs))].rule


def choose_rule(rules: dict[Rule, float], radians: float, tol: float) -> Rule:
    """`cheapest` of `candidates`."""
    return cheapest(priced(rules), radians, tol)


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
    rough = min(ROUGH, tol * 2.0**rule.order)
    turned = max(radians, 1.0)
    each = (turned * phase_error(rule) / rough) ** (1 / rule.order)
    return math.ceil(ANHARMONIC * turned * max(each, 1 / RADIANS))

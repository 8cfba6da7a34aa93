"""By which loop a motion is looked at within its steps, where many times lie there."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass

from varint.codegen.cache import CompileError
from varint.codegen.gauss import gauss_form
from varint.codegen.kernel import Kernel
from varint.codegen.within_steps import NOTHING_WITHIN, Within, within
from varint.integration.gears import BY_STAGES, Gears, gears_of, kernel_now, scheme_of
from varint.rules.polynomials import MOST_STAGES
from varint.rules.rule import Rule, gauss
from varint.scene.memory import per_scene
from varint.scene.system import System

# times in all, and in a step: fewer are reached one by one before another loop would be there
MANY, MANY_IN_STEP = 32, 3
# where a step that is no longer than the others takes ten times as long: by Newton's method
SOME, SOME_IN_STEP = 8, 1
# of a motion's own rule: flows of fewer are those of users who look at what a rule does
LEAST_STAGES = 4
NO_GEARS: tuple[Within, Gears | None] = NOTHING_WITHIN, None


@dataclass(eq=False)
class Looking:
    """The loop of a rule of more stages in both gears, and how motions are looked at by the one
    that was there last.
    """

    gears: Gears
    many: int
    in_step: int
    last: tuple[Kernel | None, Within] = (None, NOTHING_WITHIN)


def within_now(system: System, rule: Rule, count: int) -> tuple[Within, Gears | None]:
    """How a motion by this rule is looked at within its steps at so many times, and whose low gear
    that is; nothing where shorter steps of the rule reach them all.
    """
    looking = looking_of(system, rule) if count >= SOME else None
    if looking is None or count < looking.many:
        return NO_GEARS
    kernel = kernel_now(looking.gears)
    if kernel is not looking.last[0]:
        looking.last = kernel, NOTHING_WITHIN
        with suppress(CompileError):
            looking.last = kernel, within(kernel, rule.order, looking.in_step)
    return looking.last[1], looking.gears if kernel is looking.gears.low else None


@per_scene
def looking_of(system: System, rule: Rule) -> Looking | None:
    """Of scenes whose stages can be iterated all at once, and rules of many."""
    stages = len(rule.nodes)
    if stages < LEAST_STAGES or rule != gauss(min(stages, MOST_STAGES)):
        return None
    gears = gears_of(system, gauss(MOST_STAGES), BY_STAGES) if gauss_form(system) else None
    if gears is None:
        return None
    once = scheme_of(system, rule) is BY_STAGES
    return Looking(gears, *((MANY, MANY_IN_STEP) if once else (SOME, SOME_IN_STEP)))

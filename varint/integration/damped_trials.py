"""Runs for a wanted accuracy whose steps grow to what lasts beside stiff dampers, where more is
asked for than `short_call` takes.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from varint.integration.choice import Choice
from varint.integration.compiled_loop import scheme_of
from varint.integration.damped_motions import (
    are_stiff,
    by_lagrangian,
    damped_turns,
    has_slopes_without,
    look_function,
    may_be_damped,
)
from varint.integration.gears import BY_STAGES
from varint.integration.problem import InitialValueProblem
from varint.integration.rule_choice import candidates, choose_rule
from varint.integration.short_trials import by_short_trials
from varint.numerics.arrays import call
from varint.results.records import changed
from varint.rules.rule import Rule
from varint.scene.system import System


def by_damped_trials(
    system: System,
    rule: Rule | None,
    start: InitialValueProblem,
    tol: float,
    radians: float,
    backend: str,
    began: float,
) -> Choice | None:
    """The choice that `short_call` makes beside stiff dampers, by the rule that is asked for or the
    cheapest by stages; None where no dampers are stiff, or steps do not grow.
    """
    if not (may_be_damped(system) and system.structure.quadratic_kinetic):
        return None
    state = start.q0, start.p0, start.t0, start.c
    at = start.q0, start.p0, np.array((start.t0,)), start.c
    n, local = len(start.q0), np.concatenate(call(look_function(system), *at))
    if not are_stiff(local, n, start.h, radians):
        return None
    turned = damped_turns(system, *state, start.h)
    if turned is None:
        return None
    own = rule or choose_rule(candidates(system, True, True), turned[1], tol)
    scene = by_lagrangian(system) if has_slopes_without(system, turned[1]) else system
    if scheme_of(scene, own) is not BY_STAGES:
        return None
    mass = local[: n * n : n + 1]
    trials = scene, own, start, mass, tol, turned, backend, began
    found = by_short_trials(*trials, grows=True)
    if not isinstance(found, Choice):
        return None
    return found if scene is system else replace(found, motion=changed(found.motion, system=system))

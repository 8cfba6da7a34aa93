"""A step whose equations Newton's method cannot solve by whole corrections: where friction with a
steep sign ends a motion.

Only forces that depend on velocities are helped so. Elsewhere a step that fails is too long for its
motion, and what a search finds from farther away is often a solution that is none of the motion's.
"""

from __future__ import annotations

import casadi as ca

from varint.integration.plan import plan
from varint.integration.steppers.constrained import constrained_stepper
from varint.integration.steppers.implicit import implicit_stepper
from varint.integration.steppers.newton import searching_newton
from varint.rules.rule import Rule
from varint.scene.memory import per_system
from varint.scene.system import System

SEARCHING = implicit_stepper, constrained_stepper  # steppers whose root finder is given


@per_system
def careful_step(system: System, rule: Rule) -> ca.Function | None:
    """The step of a scene's stepper with corrections that are halved where they must be; None where
    it solves no equations of motion, or no force depends on velocities.
    """
    if not ca.depends_on(system.force, system.v):
        return None
    build = plan(system, rule).build
    found = next((stepper for stepper in SEARCHING if stepper is build), None)
    return found and found(system, rule, searching_newton).step

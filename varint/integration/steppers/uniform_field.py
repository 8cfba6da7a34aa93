"""Uniform fields: every rule of order two and more gives the exact parabola, so no rule's own
equations are solved.

Rounding repeats itself from step to step there, and would add up: a ball that bounces for ever
would gain or lose some 1e-17 of its energy an impact. So the mean velocity is summed with its
compensation.
"""

from __future__ import annotations

import casadi as ca

from varint.discrete.kick_drift import drift_function, kick_function
from varint.discrete.legendre import mass_solve
from varint.integration.steppers.stepper import (
    Method,
    Stepper,
    compensated_sum,
    first_state,
    state_symbols,
    zeros,
)
from varint.rules.rule import Rule
from varint.scene.memory import per_system
from varint.scene.system import System


@per_system
def is_uniform(system: System) -> bool:
    """L = ½ vᵀMv + a·v + f·q with constant M, a, f; forces are constant too."""
    s = system
    return s.structure.explicit and not ca.depends_on(
        s.generalised_force, ca.vertcat(s.q, s.v, s.t, s.control)
    )


@per_system
def uniform_field_stepper(system: System, rule: Rule) -> Stepper:
    """Stepper for q1 = q0 + h M⁻¹(p0 + ½ h F), p1 = p0 + h F, both compensated."""
    s, n = system, system.structure.n
    x = state_symbols(n, 0)
    q, cq, p, cp, *_ = x
    t, h = ca.SX.sym("t"), ca.SX.sym("h")
    scale, u = ca.SX.sym("scale", 2 * n), ca.SX.sym("u", s.structure.controls * len(rule.nodes))
    force = kick_function(s)(q, ca.SX.zeros(s.control.shape), t, s.c)
    speed, bend = drift_function(s)(p, s.c), mass_solve(s.mass_matrix, h / 2 * force)
    mean, rest = compensated_sum(speed, mass_solve(s.mass_matrix, cp), bend, h)
    q1, cq1 = compensated_sum(q, cq, h * mean + h * rest, h)
    p1, cp1 = compensated_sum(p, cp, h * force, h)
    inputs = [x.vector, u, t, h, s.c, scale]
    after = x._replace(q=q1, q_rest=cq1, p=p1, p_rest=cp1)
    step = ca.Function("flight", inputs, [ca.densify(after.vector)], {"cse": True})
    path = ca.vertcat(*(tau * h * (speed + tau * bend) for tau in rule.points[1:]))
    start = ca.Function("start", [q, p, u, t, h, s.c], [first_state(q, p, zeros(0))])
    return Stepper(step, start, ca.Function("path", inputs, [ca.densify(path)], {"cse": True}))


UNIFORM_FIELD = Method(
    name="flight in a uniform field",
    applies=lambda system, rule: bool(rule.points) and is_uniform(system),
    runs=lambda system, rule: ("q + h M⁻¹(p + ½ h F) and p + h F",),
    skips=lambda system, rule: (
        "root finding: the field is uniform, every rule gives the exact parabola",
    ),
    build=uniform_field_stepper,
)

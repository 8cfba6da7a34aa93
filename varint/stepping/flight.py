"""Uniform fields: every rule of order two and more gives the exact parabola, so no rule's own equations are solved.

Rounding repeats itself from step to step there, and would add up: a ball that bounces for ever would gain or lose some
1e-17 of its energy an impact. So the mean velocity is summed with its compensation.
"""

from __future__ import annotations

import casadi as ca

from varint.legendre import mass_solve
from varint.rules import Rule
from varint.stepping.explicit import drift_function, kick_function
from varint.stepping.stepper import Stepper, compensated, zeros
from varint.system import System, per_system


@per_system
def is_uniform(system: System) -> bool:
    """L = ½ vᵀMv + a·v + f·q with constant M, a, f; forces are constant too."""
    s = system
    push = ca.gradient(s.lagrangian, s.q) + s.force
    return s.structure.explicit and not ca.depends_on(push, ca.vertcat(s.q, s.v, s.t, s.control))


@per_system
def flight_stepper(system: System, rule: Rule) -> Stepper:
    """Stepper for q1 = q0 + h M⁻¹(p0 + ½ h F), p1 = p0 + h F, both compensated."""
    s, n = system, system.structure.n
    q, cq, p, cp = (ca.SX.sym(name, n) for name in ("q", "cq", "p", "cp"))
    worst, t, h = (ca.SX.sym(name) for name in ("worst", "t", "h"))
    scale, u = ca.SX.sym("scale", 2 * n), ca.SX.sym("u", s.structure.controls * len(rule.nodes))
    force = kick_function(s)(q, ca.SX.zeros(s.control.shape), t, s.c)
    speed, bend = drift_function(s)(p, s.c), mass_solve(s.mass_matrix, h / 2 * force)
    mean, rest = compensated(speed, mass_solve(s.mass_matrix, cp), bend, h)
    q1, cq1 = compensated(q, cq, h * mean + h * rest, h)
    p1, cp1 = compensated(p, cp, h * force, h)
    x = ca.vertcat(q, cq, p, cp, worst)
    inputs = [x, u, t, h, s.c, scale]
    step = ca.Function("flight", inputs, [ca.densify(ca.vertcat(q1, cq1, p1, cp1, worst))], {"cse": True})
    path = ca.vertcat(*(tau * h * (speed + tau * bend) for tau in rule.points[1:]))
    first = ca.vertcat(q, zeros(n), p, zeros(n), 0)
    start = ca.Function("start", [q, p, u, t, h, s.c], [first])
    return Stepper(step, start, ca.Function("path", inputs, [ca.densify(path)], {"cse": True}))

"""Scenes whose discrete equations are linear: one constant map a step, inverted once for the whole run.

Where L is quadratic and the forces are linear in q and v, the equations of a step read J y + r(q0, p0, u, t) = 0 with a
matrix J of the step size and the parameters alone. Its inverse is kept in the stepper's memory.
"""

from __future__ import annotations

import casadi as ca

from varint.rules import Rule
from varint.stepping.equations import Equations
from varint.stepping.implicit import implicit_equations
from varint.stepping.stepper import Stepper, compensated, zeros
from varint.system import System, per_system

MOST_UNKNOWNS = 12  # the inverse is full: beyond, a sparse solve in every step is cheaper


def is_linear(system: System, rule: Rule) -> bool:
    """Are the equations of a step linear, with a matrix that state, time and controls do not enter, and few?"""
    s = system.structure
    unknowns = s.n * (rule.degree if rule.points else len(rule.drifts))
    return s.linear and not s.degenerate and unknowns <= MOST_UNKNOWNS and constant_slope(system, rule)


@per_system
def constant_slope(system: System, rule: Rule) -> bool:
    """Does the Jacobian of the equations of a step depend on nothing but step size and parameters?"""
    e = implicit_equations(system, rule)
    return not ca.depends_on(ca.jacobian(e.left, e.y), ca.vertcat(e.y, e.q, e.p, e.t, e.u))


@per_system
def linear_stepper(system: System, rule: Rule) -> Stepper:
    """Stepper by the constant inverse, y = −J⁻¹ r, refined once: the motion of `implicit_stepper` to round-off."""
    e, n = implicit_equations(system, rule), system.structure.n
    size = e.y.numel()
    cq, cp, kept, worst = (ca.SX.sym(name, k) for name, k in (("cq", n), ("cp", n), ("kept", size**2), ("worst", 1)))
    y = _solution(e, ca.reshape(kept, size, size), cp)
    after = ca.Function("after", [e.y, e.q, e.p, e.u, e.t, e.h, e.c, e.scale], [e.increment, e.gain, e.remains])
    increment, gain, remains = after(y, e.q, e.p, e.u, e.t, e.h, e.c, e.scale)
    q1, cq1 = compensated(e.q, cq, increment, e.h)
    p1, cp1 = compensated(e.p, cp, gain, e.h)
    x = ca.vertcat(e.q, cq, e.p, cp, kept, worst)
    inputs = [x, e.u, e.t, e.h, e.c, e.scale]
    next_x = ca.vertcat(q1, cq1, p1, cp1, kept, ca.fmax(worst, ca.norm_inf(remains)))
    step = ca.Function("linear_step", inputs, [next_x], {"cse": True})
    return Stepper(step, _start(e), ca.Function("path", inputs, [e.h * y], {"cse": True}))


def _solution(e: Equations, inverse: ca.SX, carry: ca.SX) -> ca.SX:
    """Unknowns for the momentum p with its carry, which counts in the residual alone: there it is not rounded away."""
    arguments = [e.q, e.p, e.u, e.t, e.h, e.c]
    left = ca.Function("left", [e.y, *arguments], [e.left])
    first = -ca.mtimes(inverse, left(ca.SX.zeros(e.y.shape), *arguments))
    missing = ca.vertcat(zeros(e.y.numel() - carry.numel()), carry)
    return first - ca.mtimes(inverse, left(first, *arguments) - missing)


def _start(e: Equations) -> ca.Function:
    n, size = e.q.numel(), e.y.numel()
    slope = ca.Function("slope", [e.h, e.c], [ca.densify(ca.jacobian(e.left, e.y))])
    q, p, u, t, h, c = (ca.MX.sym(x, k.numel()) for x, k in zip("qputhc", (e.q, e.p, e.u, e.t, e.h, e.c), strict=True))
    inverse = ca.solve(slope(h, c), ca.DM.eye(size))
    x = ca.vertcat(q, ca.DM.zeros(n), p, ca.DM.zeros(n), ca.vec(inverse), 0)
    return ca.Function("start", [q, p, u, t, h, c], [x])

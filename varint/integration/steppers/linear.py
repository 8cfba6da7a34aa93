"""Scenes whose discrete equations are linear: one constant map a step, inverted once for the whole
run.

Where L is quadratic and the forces are linear in q and v, the equations of a step read J y + r(q0,
p0, u, t) = 0 with a matrix J of the step size and the parameters alone. Its inverse is kept in the
stepper's memory.
"""

from __future__ import annotations

import casadi as ca

from varint.discrete.equations import Equations, implicit_equations
from varint.integration.steppers.stepper import (
    Method,
    Stepper,
    compensated_sum,
    first_state,
    state_symbols,
    zeros,
)
from varint.rules.rule import Rule
from varint.scene.memory import per_scene, per_system
from varint.scene.system import System

MOST_UNKNOWNS = 12  # the inverse is full: beyond, a sparse solve in every step is cheaper


def is_linear(system: System, rule: Rule) -> bool:
    """Are the equations of a step linear, with a matrix that state, time and controls do not
    enter, and few?
    """
    s = system.structure
    unknowns = s.n * (rule.degree if rule.points else len(rule.drifts))
    return (
        s.linear and not s.degenerate and unknowns <= MOST_UNKNOWNS and constant_slope(system, rule)
    )


@per_scene
def constant_slope(system: System, rule: Rule) -> bool:
    """Does the Jacobian of the equations of a step depend on nothing but step size and
    parameters?
    """
    e = implicit_equations(system, rule)
    return not ca.depends_on(ca.jacobian(e.left, e.y), ca.vertcat(e.y, e.q, e.p, e.t, e.u))


@per_system
def linear_stepper(system: System, rule: Rule) -> Stepper:
    """Stepper by the constant inverse, y = −J⁻¹ r, refined once: the motion of
    `implicit_stepper` to round-off.
    """
    e, n = implicit_equations(system, rule), system.structure.n
    size = e.y.numel()
    x = state_symbols(n, size**2)._replace(q=e.q, p=e.p)
    y = _solution(e, ca.reshape(x.memory, size, size), x.p_rest)
    after = ca.Function(
        "after", [e.y, e.q, e.p, e.u, e.t, e.h, e.c, e.scale], [e.increment, e.gain, e.remains]
    )
    increment, gain, remains = after(y, e.q, e.p, e.u, e.t, e.h, e.c, e.scale)
    q1, cq1 = compensated_sum(e.q, x.q_rest, increment, e.h)
    p1, cp1 = compensated_sum(e.p, x.p_rest, gain, e.h)
    worst = ca.fmax(x.residual, ca.norm_inf(remains))
    after_it = x._replace(q=q1, q_rest=cq1, p=p1, p_rest=cp1, residual=worst)
    inputs = [x.vector, e.u, e.t, e.h, e.c, e.scale]
    step = ca.Function("linear_step", inputs, [after_it.vector], {"cse": True})
    return Stepper(step, _start(e), ca.Function("path", inputs, [e.h * y], {"cse": True}))


def _solution(e: Equations, inverse: ca.SX, carry: ca.SX) -> ca.SX:
    """Unknowns for the momentum p with its carry, which counts in the residual alone: there it
    is not rounded away.
    """
    arguments = [e.q, e.p, e.u, e.t, e.h, e.c]
    left = ca.Function("left", [e.y, *arguments], [e.left])
    first = -ca.mtimes(inverse, left(ca.SX.zeros(e.y.shape), *arguments))
    missing = ca.vertcat(zeros(e.y.numel() - carry.numel()), carry)
    return first - ca.mtimes(inverse, left(first, *arguments) - missing)


def _start(e: Equations) -> ca.Function:
    slope = ca.densify(ca.jacobian(e.left, e.y))
    # CasADi calls a matrix singular by the size of its numbers, which units decide
    rows = ca.diag(1 / _largest(slope.T))
    columns = ca.diag(1 / _largest(ca.mtimes(rows, slope)))
    parts = [ca.mtimes([rows, slope, columns]), rows, columns]
    scaled = ca.Function("slope", [e.h, e.c], [ca.densify(x) for x in parts])
    q, p, u, t, h, c = (
        ca.MX.sym(x, k.numel())
        for x, k in zip("qputhc", (e.q, e.p, e.u, e.t, e.h, e.c), strict=True)
    )
    matrix, by_rows, by_columns = scaled(h, c)
    inverse = ca.mtimes([by_columns, ca.solve(matrix, ca.DM.eye(e.y.numel())), by_rows])
    return ca.Function("start", [q, p, u, t, h, c], [first_state(q, p, ca.vec(inverse))])


def _largest(matrix: ca.SX) -> ca.SX:
    """The size of the largest number of each column, 1 where all are zero."""
    sizes = [ca.norm_inf(matrix[:, j]) for j in range(matrix.shape[1])]
    return ca.vertcat(*(ca.if_else(x > 0, x, 1) for x in sizes))


LINEAR = Method(
    name="linear map",
    applies=is_linear,
    runs=lambda system, rule: (
        f"one constant linear map for {rule.degree} × {system.structure.n} unknowns, inverted once "
        "for the whole run",
    ),
    skips=lambda system, rule: ("root finding: L is quadratic and the forces are linear",),
    build=linear_stepper,
)

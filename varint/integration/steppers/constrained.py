"""The step with constraints: Newton's method on path, multipliers and constraints together.

Holonomic constraints carry a multiplier at every control point, with the Lobatto weight of that
point, and hold at every new control point; the momentum at the end is projected onto the hidden
constraint G v + ∂g/∂t = 0 (Jay 1996; Marsden & West 2001, §3.4). Non-holonomic rows A v = 0 push
with A(q0)ᵀν at the start and A(q1)ᵀν' at the end of the step and hold for its mean velocity and at
its end: Lagrange–d'Alembert, symmetric in time.
"""

from __future__ import annotations

import casadi as ca

from varint.discrete.constrained_equations import constrained_equations, size_function
from varint.discrete.constraints import tangent_function
from varint.discrete.equations import Equations
from varint.discrete.lagrangian import Interval, constraint_function, interval
from varint.discrete.legendre import velocity_function
from varint.discrete.nonholonomic import half_reaction
from varint.integration.steppers.newton import Root, iterations, newton
from varint.integration.steppers.stepper import (
    Method,
    State,
    Stepper,
    compensated_sum,
    first_state,
    state_parts,
    state_size,
    state_symbols,
    sum_function,
)
from varint.rules.rule import Rule
from varint.scene.memory import per_system
from varint.scene.system import System


@per_system
def constrained_stepper(system: System, rule: Rule, root: Root = newton) -> Stepper:
    """Stepper for scenes with constraints: z_j = (Q_j − q0)/h and the multipliers from (q0, p0).

    The momentum at the end is projected, which needs no unknowns of the step.
    """
    e, n = constrained_equations(system, rule), system.structure.n
    arguments = [e.q, e.p, e.u, e.t, e.h, e.c, e.sizes]
    equations = ca.Function("constrained_step", [e.y, *arguments], [e.scaled], {"cse": True})
    solve = root("newton", equations)

    x = ca.MX.sym("x", state_size(n, e.y.numel()))
    u, t, h, c = (
        ca.MX.sym(name, a.numel()) for name, a in zip("uthc", arguments[2:6], strict=True)
    )
    s = ca.MX.sym("s", 2 * n)
    q0, _, p0, carry, guess, *_ = state_parts(x, n)
    size = size_function(system)(q0, t, h, c, s)
    unit = ca.Function("units", [e.sizes], [e.y_size])(size)
    solution = solve(ca.vertcat(guess / unit, 0), q0, p0, u, t, h, c, size)
    solved, count = ca.vertsplit(solution, [0, e.y.numel(), e.y.numel() + 1])
    found = solved * unit
    q1, cq1, gain, ahead, total, worst = _advance(e, rule)(x, found, count, u, t, h, c, size, s)
    _, reaction = tangent_function(system)(q1, p0 + gain, t + h, c)
    p1, cp1 = sum_function(n)(p0, carry, gain + reaction, h)
    inputs = [x, u, t, h, c, s]
    step = ca.Function("constrained", inputs, [State(q1, cq1, p1, cp1, ahead, total, worst).vector])
    start = _start(system, rule, interval(system, rule), e.y.numel())
    path = ca.Function("path", inputs, [h * found[: n * rule.degree]])
    impulses = ca.horzcat(_impulses(system, rule)(found, q0, t, h, c), reaction)
    reactions = ca.Function("reactions", inputs, [impulses])
    return Stepper(step, start, path, reactions, guided=True)


def _impulses(system: System, rule: Rule) -> ca.Function:
    """(z, λ, ν), q0, t, h, c → h w_j G(Q_j)ᵀλ_j at the control points j < d, with ½h A(q0)ᵀν at
    the first, (n, d).
    """
    s, n, d = system, system.structure.n, rule.degree
    m, k = s.structure.constraints, s.structure.nonholonomic
    z, lam, nu = ca.SX.sym("z", n, d), ca.SX.sym("lam", m, d), ca.SX.sym("nu", k)
    h, impulses = ca.SX.sym("h"), []
    for j in range(d):
        q = s.q + h * z[:, j - 1] if j else s.q
        slope = constraint_function(s)(q, s.t + h * rule.points[j], s.c)[1]
        impulse = h * rule.weights[j] * ca.mtimes(slope.T, lam[:, j]) if m else ca.SX.zeros(n)
        impulses.append(impulse if j or not k else impulse + half_reaction(s, s.q, s.t, s.c, h, nu))
    y = ca.vertcat(ca.vec(z), ca.vec(lam), nu)
    return ca.Function(
        "pushes",
        [y, s.q, s.t, h, s.c],
        [ca.densify(ca.horzcat(*impulses))],
        {"cse": True},
    )


def _advance(e: Equations, rule: Rule) -> ca.Function:
    """(x, y, counter, …) → q, its carry, the momentum gain before projection, start values,
    iterations and residual.
    """
    n, d = e.q.numel(), rule.degree
    x, more = state_symbols(n, e.y.numel())._replace(q=e.q, p=e.p), ca.SX.sym("more")
    z, others = ca.vertsplit(e.y, [0, n * d, e.y.numel()])
    ahead = ca.vertcat(ca.vec(ca.mtimes(ca.reshape(z, n, d), ca.DM(rule.extrapolation).T)), others)
    q1, cq1 = compensated_sum(e.q, x.q_rest, e.increment, e.h)
    done = x.iterations + iterations(more), ca.fmax(x.residual, ca.norm_inf(e.remains))
    outputs = [q1, cq1, e.gain, ahead, *done]
    return ca.Function(
        "advance",
        [x.vector, e.y, more, e.u, e.t, e.h, e.c, e.sizes, e.scale],
        outputs,
        {"cse": True},
    )


def _start(system: System, rule: Rule, one: Interval, unknowns: int) -> ca.Function:
    """Start values: the velocity at the start, kept over the step; no multipliers."""
    n, d = one.dq.shape
    q, p, u = ca.MX.sym("q", n), ca.MX.sym("p", n), ca.MX.sym("u", one.u.numel())
    t, h, c = ca.MX.sym("t"), ca.MX.sym("h"), ca.MX.sym("c", one.c.numel())
    v = velocity_function(system)(q, p, t, c)
    path = ca.vec(ca.mtimes(v, ca.DM(rule.points[1:]).T))
    x = first_state(q, p, ca.vertcat(path, ca.DM.zeros(unknowns - n * d)))
    return ca.Function("start", [q, p, u, t, h, c], [x])


def _runs(system: System, rule: Rule) -> tuple[str, ...]:
    s = system.structure
    rows = s.constraints * rule.degree + s.nonholonomic
    return (
        f"Newton's method for {rule.degree} × {s.n} unknowns and {rows} multipliers, exact sparse "
        "Jacobian",
        "projection of the momentum onto the hidden constraint at the end of the step",
    )


CONSTRAINED = Method(
    name="Newton's method with multipliers",
    applies=lambda system, rule: bool(
        system.structure.constraints or system.structure.nonholonomic
    ),
    runs=_runs,
    skips=lambda system, rule: (),
    build=constrained_stepper,
)

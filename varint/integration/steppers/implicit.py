"""The general step: Newton's method on the discrete Euler–Lagrange equations of one step."""

from __future__ import annotations

import casadi as ca

from varint.discrete.equations import Equations, implicit_equations
from varint.discrete.lagrangian import Interval, interval
from varint.discrete.legendre import velocity_function
from varint.integration.gears import BY_STAGES, scheme_of
from varint.integration.steppers.newton import NEVER, Root, iterations, newton
from varint.integration.steppers.stepper import (
    Method,
    State,
    Stepper,
    compensated_sum,
    first_state,
    state_size,
    state_symbols,
)
from varint.rules.rule import Rule
from varint.scene.memory import per_system
from varint.scene.system import System

IN_LOOPS = (
    "in the core and compiled: all stages iterated side by side, Newton's method only where that "
    "contracts poorly"
)


@per_system
def implicit_stepper(system: System, rule: Rule, root: Root = newton) -> Stepper:
    """Stepper by the position–momentum form: given (q0, p0), solve for the mean velocities z_j =
    (Q_j − q0)/h.

    With the solution of `implicit_equations`, q1 = q0 + h z_d and p1 = p0 + Σ_j e_j, both
    compensated (theory: Marsden & West 2001, §1.5.1).
    """
    n, d = system.structure.n, rule.degree if rule.points else len(rule.drifts)
    e = implicit_equations(system, rule)
    # scaled unknowns and rows, so that the iteration's end does not depend on the units
    arguments = [e.q, e.p, e.u, e.t, e.h, e.c, e.scale]
    equations = ca.Function("momentum_matching", [e.y, *arguments], [e.scaled], {"cse": True})
    solve = root("newton", equations, large=NEVER)
    begin, finish = _begin(e), _finish(e, rule)
    x = ca.MX.sym("x", state_size(n, e.y.numel()))
    u, t, h, c, s = (
        ca.MX.sym(name, size)
        for name, size in zip("uthcs", map(ca.SX.numel, arguments[2:]), strict=True)
    )
    guess, q0, p0 = begin(x, s)
    found = solve(guess, q0, p0, u, t, h, c, s)
    inputs = [x, u, t, h, c, s]
    step = ca.Function("newton_step", inputs, [finish(x, found, u, t, h, c, s)])
    path = ca.Function("path", inputs, [h * found[:-1] * ca.repmat(s[:n], d, 1)])
    start = _start(system, rule, interval(system, rule))
    return Stepper(step, start, path, guided=bool(rule.points))


def _state(e: Equations) -> State:
    """The state of a run; start values of the unknowns are its memory."""
    return state_symbols(e.q.numel(), e.y.numel())._replace(q=e.q, p=e.p)


def _begin(e: Equations) -> ca.Function:
    """(x, scale) → start values in units of the unknowns and the counter's, q, p."""
    x = _state(e)
    return ca.Function("begin", [x.vector, e.scale], [ca.vertcat(x.memory / e.y_size, 0), e.q, e.p])


def _finish(e: Equations, rule: Rule) -> ca.Function:
    """(x, found, …) → x after the step: compensated updates, the next start values, what was
    found on the way.
    """
    n = e.q.numel()
    x = _state(e)
    found = ca.SX.sym("found", e.y.numel() + 1)
    ahead = ca.mtimes(ca.reshape(e.y, n, -1), ca.DM(rule.extrapolation).T)
    q1, cq1 = compensated_sum(e.q, x.q_rest, e.increment, e.h)
    p1, cp1 = compensated_sum(e.p, x.p_rest, e.gain, e.h)
    q1, cq1, p1, cp1, guess, left = ca.substitute(
        [q1, cq1, p1, cp1, ca.vec(ahead), ca.norm_inf(e.remains)],
        [e.y],
        [found[:-1] * e.y_size],
    )
    count, worst = x.iterations + iterations(found[-1]), ca.fmax(x.residual, left)
    after = State(q1, cq1, p1, cp1, guess, count, worst).vector
    return ca.Function(
        "finish", [x.vector, found, e.u, e.t, e.h, e.c, e.scale], [after], {"cse": True}
    )


def _start(system: System, rule: Rule, one: Interval) -> ca.Function:
    """Start values: the velocity at the start, kept over the step."""
    n, tau = system.structure.n, ca.DM(rule.points[1:])
    q, p, u = ca.MX.sym("q", n), ca.MX.sym("p", n), ca.MX.sym("u", one.u.numel())
    t, h, c = ca.MX.sym("t"), ca.MX.sym("h"), ca.MX.sym("c", one.c.numel())
    v = velocity_function(system)(q, p, t, c)
    x = first_state(q, p, ca.vec(ca.mtimes(v, tau.T)))
    return ca.Function("start", [q, p, u, t, h, c], [x])


def _words(system: System, rule: Rule) -> tuple[str, ...]:
    """What a step does, and what loops in the core do in place of it."""
    solved = (
        f"Newton's method for {rule.degree} × {system.structure.n} unknowns, exact sparse Jacobian",
        "start values continued from the last step's polynomial",
    )
    return (*solved, IN_LOOPS) if scheme_of(system, rule) is BY_STAGES else solved


IMPLICIT = Method(
    name="Newton's method",
    applies=lambda system, rule: True,
    runs=_words,
    skips=lambda system, rule: () if system.structure.forced else ("forces: there are none",),
    build=implicit_stepper,
)

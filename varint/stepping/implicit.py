"""The general step: Newton's method on the discrete Euler–Lagrange equations of one step."""

from __future__ import annotations

import casadi as ca

from varint.discrete import Interval, interval
from varint.legendre import velocity_function
from varint.rules import Rule
from varint.stepping.equations import Equations
from varint.stepping.newton import NEVER, iterations, newton
from varint.stepping.stepper import Stepper, compensated
from varint.system import System, per_system

QUIET = 1e-3  # of the largest momentum, and of |∂p/∂q| |q|: round-off of 1e-16 in these stays below 1e-12


@per_system
def implicit_equations(system: System, rule: Rule) -> Equations:
    """e_j = 0 at the inner control points and e_d = p0 + Σ_j e_j at the end, for z_j = (Q_j − q0)/h."""
    one = interval(system, rule)
    n, d = one.dq.shape
    z, p, scale = ca.SX.sym("z", n, d), ca.SX.sym("p", n), ca.SX.sym("scale", 2 * n)
    rows = ca.horzcat(one.inner, one.p_plus - p - one.total)
    rows, total = ca.substitute([rows, one.total], [one.dq], [one.h * z])
    v_scale, p_scale = scale[:n], scale[n:]
    judged = ca.fmax(p_scale, _roundable(system, one, one.q0, z[:, -1], p))
    return Equations(
        ca.vec(z), one.q0, p, ca.vec(one.u), one.t, one.h, one.c, scale, ca.SX(0, 1), ca.densify(ca.vec(rows)),
        ca.repmat(v_scale, d, 1), ca.repmat(p_scale, d, 1), ca.repmat(judged, d, 1), one.h * z[:, -1],
        ca.densify(total),
    )  # fmt: skip


@per_system
def implicit_stepper(system: System, rule: Rule) -> Stepper:
    """Stepper by the position–momentum form: given (q0, p0), solve for the mean velocities z_j = (Q_j − q0)/h.

    With the solution of `implicit_equations`, q1 = q0 + h z_d and p1 = p0 + Σ_j e_j, both compensated (theory: Marsden
    & West 2001, §1.5.1).
    """
    n, d = system.structure.n, rule.degree if rule.points else len(rule.drifts)
    e = implicit_equations(system, rule)
    # scaled unknowns and rows, so that the iteration's end does not depend on the units
    arguments = [e.q, e.p, e.u, e.t, e.h, e.c, e.scale]
    equations = ca.Function("momentum_matching", [e.y, *arguments], [e.scaled], {"cse": True})
    solve = newton("newton", equations, large=NEVER)
    begin, finish = _begin(e), _finish(e, rule)
    x = ca.MX.sym("x", 4 * n + n * d + 2)
    u, t, h, c, s = (ca.MX.sym(name, size) for name, size in zip("uthcs", map(ca.SX.numel, arguments[2:]), strict=True))
    guess, q0, p0 = begin(x, s)
    found = solve(guess, q0, p0, u, t, h, c, s)
    inputs = [x, u, t, h, c, s]
    step = ca.Function("newton_step", inputs, [finish(x, found, u, t, h, c, s)])
    path = ca.Function("path", inputs, [h * found[:-1] * ca.repmat(s[:n], d, 1)])
    return Stepper(step, _start(system, rule, interval(system, rule)), path, counts=True)


def _state(e: Equations) -> list[ca.SX]:
    """Parts of x: q and its carry, p and its carry, start values of the unknowns, iterations and worst residual."""
    n = e.q.numel()
    cq, carry, guess, count, worst = (ca.SX.sym("x", k) for k in (n, n, e.y.numel(), 1, 1))
    return [e.q, cq, e.p, carry, guess, count, worst]


def _begin(e: Equations) -> ca.Function:
    """(x, scale) → start values in units of the unknowns and the counter's, q, p."""
    x = _state(e)
    return ca.Function("begin", [ca.vertcat(*x), e.scale], [ca.vertcat(x[4] / e.y_size, 0), e.q, e.p])


def _finish(e: Equations, rule: Rule) -> ca.Function:
    """(x, found, …) → x after the step: compensated updates, the next start values, what was found on the way."""
    n = e.q.numel()
    x = _state(e)
    _, cq, _, carry, _, count, worst = x
    found = ca.SX.sym("found", e.y.numel() + 1)
    ahead = ca.mtimes(ca.reshape(e.y, n, -1), ca.DM(rule.extrapolation).T)
    q1, cq1 = compensated(e.q, cq, e.increment, e.h)
    p1, cp1 = compensated(e.p, carry, e.gain, e.h)
    after = ca.vertcat(q1, cq1, p1, cp1, ca.vec(ahead))
    after, left = ca.substitute([after, ca.norm_inf(e.remains)], [e.y], [found[:-1] * e.y_size])
    after = ca.vertcat(after, count + iterations(found[-1]), ca.fmax(worst, left))
    return ca.Function("finish", [ca.vertcat(*x), found, e.u, e.t, e.h, e.c, e.scale], [after], {"cse": True})


def _roundable(system: System, one: Interval, q: ca.SX, v: ca.SX, p: ca.SX) -> ca.SX:
    """Sizes (n,) of what adds up to the momenta at q, v: their sum may vanish, its round-off does not.

    A component that hardly moves is given `QUIET` of the largest, compared by energy (p²/M: metres with radians).
    """
    state = [system.q, system.v, system.t, system.c], [q, v, one.t, one.c]
    twist = ca.jacobian(system.momentum, system.q)
    mass, twist = ca.substitute([ca.fabs(system.mass_matrix), ca.fabs(twist)], *state)
    step = ca.fabs(one.h * v)
    parts = ca.fabs(p) + mass @ ca.fabs(v) + (twist + twist.T) @ step + QUIET * (twist @ ca.fabs(q))
    inertia = ca.diag(mass)
    largest = ca.norm_inf(ca.if_else(inertia > 0, parts / ca.sqrt(inertia), 0))
    return ca.fmax(parts, QUIET * ca.sqrt(inertia) * largest)


def _start(system: System, rule: Rule, one: Interval) -> ca.Function:
    """Start values: the velocity at the start, kept over the step."""
    n, tau = system.structure.n, ca.DM(rule.points[1:])
    q, p, u = ca.MX.sym("q", n), ca.MX.sym("p", n), ca.MX.sym("u", one.u.numel())
    t, h, c = ca.MX.sym("t"), ca.MX.sym("h"), ca.MX.sym("c", one.c.numel())
    v = velocity_function(system)(q, p, t, c)
    x = ca.vertcat(q, ca.DM.zeros(n), p, ca.DM.zeros(n), ca.vec(ca.mtimes(v, tau.T)), 0, 0)
    return ca.Function("start", [q, p, u, t, h, c], [x])

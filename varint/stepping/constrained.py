"""The step with constraints: Newton's method on path, multipliers and constraints together.

Holonomic constraints carry a multiplier at every control point, with the Lobatto weight of that point, and hold at
every new control point; the momentum at the end is projected onto the hidden constraint G v + ∂g/∂t = 0 (Jay 1996;
Marsden & West 2001, §3.4). Non-holonomic rows A v = 0 push with A(q0)ᵀν at the start and A(q1)ᵀν' at the end of the
step and hold for its mean velocity and at its end: Lagrange–d'Alembert, symmetric in time.
"""

from __future__ import annotations

import casadi as ca

from varint.discrete import Interval, constraint_function, interval
from varint.legendre import velocity_function
from varint.manifold import rows_function, tangent_function
from varint.rules import Rule
from varint.stepping.equations import Equations
from varint.stepping.newton import iterations, newton
from varint.stepping.stepper import Stepper, compensated
from varint.system import System, per_system

# Round-off in g moves a path by 1e-16 |q| times the condition of the rows (N² for a chain). Newton is quadratic: a last
# correction of LAST_CORRECTION times this part of |q| leaves far less than that.
CORRECTION_FLOOR = 1e-2
# |g| is judged against what a change of q by this part of |q| would make of it (RESIDUAL_LIMIT times it: 1e-12).
GAP_FLOOR = 1e-2
# A momentum is judged no finer than by RESIDUAL_LIMIT times this part of M|q|/h, CORRECTION_FLOOR in it: the momentum
# that shifts q by its round-off.
ROUNDABLE = 1e-3
TINY = 1e-100  # instead of zero under a division


@per_system
def constrained_equations(system: System, rule: Rule) -> Equations:
    """e_j = 0 inside, p⁻ = p0 + ½h A(q0)ᵀν, g(Q_j) = 0 for j = 1 … d, Σ b_i A(q_i) v_i = 0, for z, λ_0 … λ_{d−1}, ν."""
    one = interval(system, rule)
    n, d = one.dq.shape
    m, k = one.lam.shape[0], system.nonholonomic.shape[0]
    z, lam, nu = ca.SX.sym("z", n, d), ca.SX.sym("lam", m, d), ca.SX.sym("nu", k)
    p, scale, sizes = ca.SX.sym("p", n), ca.SX.sym("scale", 2 * n), ca.SX.sym("sizes", 2 * (n + m + k))
    left, total = _equations(system, one, z, lam, nu, p)
    y_size, row_size = (ca.vertcat(ca.repmat(a, d, 1), ca.repmat(b, d, 1), c) for a, b, c in _parts(sizes, n, m, k))
    slope = constraint_function(system)(one.q0, one.t, one.c)[1]
    pulls = ca.fabs(one.h) / d * ca.mtimes(ca.fabs(slope).T, ca.sum2(ca.fabs(lam))) if m else 0
    # reactions set coordinates in motion that were at rest when the scales were taken, and hold massless ones at p = 0:
    # count what is there now
    strong, rest = ca.vertsplit(row_size, [0, n * d, left.numel()])
    moving = scale[n:] + ca.fabs(p) + ca.fabs(total) + pulls + ROUNDABLE * strong[:n]
    return Equations(
        ca.vertcat(ca.vec(z), ca.vec(lam), nu), one.q0, p, ca.vec(one.u), one.t, one.h, one.c, scale, sizes,
        left, y_size, row_size, ca.vertcat(ca.repmat(moving, d, 1), rest), one.h * z[:, -1], total,
    )  # fmt: skip


@per_system
def constrained_stepper(system: System, rule: Rule) -> Stepper:
    """Stepper for scenes with constraints: z_j = (Q_j − q0)/h and the multipliers from (q0, p0).

    The momentum at the end is projected, which needs no unknowns of the step.
    """
    e, n = constrained_equations(system, rule), system.structure.n
    arguments = [e.q, e.p, e.u, e.t, e.h, e.c, e.sizes]
    equations = ca.Function("constrained_step", [e.y, *arguments], [e.scaled], {"cse": True})
    solve = newton("newton", equations)

    x = ca.MX.sym("x", 4 * n + e.y.numel() + 2)
    u, t, h, c = (ca.MX.sym(name, a.numel()) for name, a in zip("uthc", arguments[2:6], strict=True))
    s = ca.MX.sym("s", 2 * n)
    q0, _, p0, carry, guess, _ = ca.vertsplit(x, [0, n, 2 * n, 3 * n, 4 * n, x.numel() - 2, x.numel()])
    size = size_function(system)(q0, t, h, c, s)
    unit = ca.Function("units", [e.sizes], [e.y_size])(size)
    solution = solve(ca.vertcat(guess / unit, 0), q0, p0, u, t, h, c, size)
    solved, count = ca.vertsplit(solution, [0, e.y.numel(), e.y.numel() + 1])
    found = solved * unit
    q1, cq1, gain, ahead, done = _advance(e, rule)(x, found, count, u, t, h, c, size, s)
    _, pull = tangent_function(system)(q1, p0 + gain, t + h, c)
    p1, cp1 = sum_function(n)(p0, carry, gain + pull, h)
    inputs = [x, u, t, h, c, s]
    step = ca.Function("constrained", inputs, [ca.vertcat(q1, cq1, p1, cp1, ahead, done)])
    start = _start(system, rule, interval(system, rule), e.y.numel())
    path = ca.Function("path", inputs, [h * found[: n * rule.degree]])
    pushes = ca.horzcat(_pushes(system, rule)(found, q0, t, h, c), pull)
    return Stepper(step, start, path, ca.Function("reactions", inputs, [pushes]), counts=True)


def _pushes(system: System, rule: Rule) -> ca.Function:
    """(z, λ, ν), q0, t, h, c → h w_j G(Q_j)ᵀλ_j at the control points j < d, with ½h A(q0)ᵀν at the first, (n, d)."""
    s, n, d = system, system.structure.n, rule.degree
    m, k = s.structure.constraints, s.structure.nonholonomic
    z, lam, nu = ca.SX.sym("z", n, d), ca.SX.sym("lam", m, d), ca.SX.sym("nu", k)
    h, pushes = ca.SX.sym("h"), []
    at = ca.Function("A", [s.q, s.t, s.c], [s.nonholonomic])
    for j in range(d):
        q = s.q + h * z[:, j - 1] if j else s.q
        slope = constraint_function(s)(q, s.t + h * rule.points[j], s.c)[1]
        push = h * rule.weights[j] * ca.mtimes(slope.T, lam[:, j]) if m else ca.SX.zeros(n)
        pushes.append(push if j or not k else push + h / 2 * ca.mtimes(at(s.q, s.t, s.c).T, nu))
    y = ca.vertcat(ca.vec(z), ca.vec(lam), nu)
    return ca.Function("pushes", [y, s.q, s.t, h, s.c], [ca.densify(ca.horzcat(*pushes))], {"cse": True})


def _parts(sizes: ca.SX, n: int, m: int, k: int) -> list[list[ca.SX]]:
    """Sizes of (velocities, multipliers, those of non-holonomic rows) and of (momenta, gaps, slips)."""
    return [ca.vertsplit(half, [0, n, n + m, n + m + k]) for half in ca.vertsplit(sizes, n + m + k)]


def _equations(system: System, one: Interval, z, lam, nu, p) -> tuple[ca.SX, ca.SX]:
    """Residual (momenta, gaps, slips) and the momentum gain without the end's own reaction."""
    k = nu.numel()
    at = ca.Function("A", [system.q, system.t, system.c], [system.nonholonomic])
    push = one.h / 2 * ca.mtimes(at(one.q0, one.t, one.c).T, nu) if k else 0
    rows = ca.horzcat(one.inner, one.p_plus - p - one.total - push)
    weights = [1.0] if one.q_nodes.shape[1] == 1 else [0.5, 0.5]
    slips = [
        b * ca.mtimes(at(one.q_nodes[:, i], one.t_nodes[i], one.c), one.v_nodes[:, i])
        for i, b in enumerate(weights)
        if k
    ]
    left = ca.vertcat(ca.vec(rows), ca.vec(one.gaps), sum(slips) if k else ca.SX(0, 1))
    last = ca.SX.zeros(lam.shape[0], 1)
    return ca.substitute(
        [ca.densify(left), ca.densify(one.total + push)], [one.lam, one.dq], [ca.horzcat(lam, last), one.h * z]
    )


@per_system
def size_function(system: System) -> ca.Function:
    """`size_expressions` with derivatives defined to be zero, for steps that are differentiated."""
    sizes = size_expressions(system)
    inputs = sizes.sx_in()
    options = {"is_diff_out": [False], "never_inline": True, "cse": True}
    return ca.Function("sizes", inputs, sizes.call(inputs), options)


@per_system
def size_expressions(system: System) -> ca.Function:
    """(q, t, h, c, scale) → sizes of mean velocities, multipliers, momenta and of the residuals of the rows W v + w.

    A multiplier's size makes h Wᵀλ a momentum of the scene's size. They make the equations dimensionless and decide
    when Newton's method stops.
    """
    s = system
    n, m = s.q.numel(), s.constraint.numel()
    scale, h = ca.SX.sym("scale", 2 * n), ca.SX.sym("h")
    v_size, p_size = scale[:n], scale[n:]
    far = ca.norm_inf(s.q)
    floor = CORRECTION_FLOOR * far / ca.fabs(h)
    _, slope = rows_function(s)(s.q, 0 * s.v, s.t, s.c)
    mass = ca.fabs(ca.substitute(s.mass_matrix, s.v, 0 * s.v))
    strong = p_size + ca.mtimes(mass, ca.repmat(floor, n, 1))
    lam_size = 1 / (ca.fabs(h) * ca.sqrt(ca.sum2(ca.mtimes(slope, ca.diag(1 / strong)) ** 2)) + TINY)
    moves = ca.fabs(h) * v_size + GAP_FLOOR * far
    g_size = ca.sqrt(ca.sum2(ca.mtimes(slope, ca.diag(moves)) ** 2)) + TINY
    slow = ca.sqrt(ca.sum2(ca.mtimes(slope, ca.diag(v_size)) ** 2)) + TINY
    g_size, slow = ca.vertsplit(g_size, [0, m, g_size.numel()])[0], ca.vertsplit(slow, [0, m, slow.numel()])[1]
    sizes = ca.vertcat(v_size + floor, lam_size, strong, g_size, slow)
    return ca.Function("sizes", [s.q, s.t, h, s.c, scale], [ca.densify(sizes)], {"cse": True})


def _advance(e: Equations, rule: Rule) -> ca.Function:
    """(x, y, counter, …) → q, its carry, the momentum gain before projection, start values, iterations and residual."""
    n, d = e.q.numel(), rule.degree
    cq, carry, guess, count, worst, more = (ca.SX.sym("x", i) for i in (n, n, e.y.numel(), 1, 1, 1))
    x = ca.vertcat(e.q, cq, e.p, carry, guess, count, worst)
    z, others = ca.vertsplit(e.y, [0, n * d, e.y.numel()])
    ahead = ca.vertcat(ca.vec(ca.mtimes(ca.reshape(z, n, d), ca.DM(rule.extrapolation).T)), others)
    q1, cq1 = compensated(e.q, cq, e.increment, e.h)
    done = ca.vertcat(count + iterations(more), ca.fmax(worst, ca.norm_inf(e.remains)))
    outputs = [q1, cq1, e.gain, ahead, done]
    return ca.Function("advance", [x, e.y, more, e.u, e.t, e.h, e.c, e.sizes, e.scale], outputs, {"cse": True})


def sum_function(n: int) -> ca.Function:
    """(p, carry, gain, h) → compensated p + gain."""
    p, carry, gain = (ca.SX.sym(name, n) for name in ("p", "carry", "gain"))
    h = ca.SX.sym("h")
    return ca.Function("gained", [p, carry, gain, h], list(compensated(p, carry, gain, h)))


def _start(system: System, rule: Rule, one: Interval, unknowns: int) -> ca.Function:
    """Start values: the velocity at the start, kept over the step; no multipliers."""
    n, d = one.dq.shape
    q, p, u = ca.MX.sym("q", n), ca.MX.sym("p", n), ca.MX.sym("u", one.u.numel())
    t, h, c = ca.MX.sym("t"), ca.MX.sym("h"), ca.MX.sym("c", one.c.numel())
    v = velocity_function(system)(q, p, t, c)
    path = ca.vec(ca.mtimes(v, ca.DM(rule.points[1:]).T))
    x = ca.vertcat(q, ca.DM.zeros(n), p, ca.DM.zeros(n), path, ca.DM.zeros(unknowns - n * d + 2))
    return ca.Function("start", [q, p, u, t, h, c], [x])

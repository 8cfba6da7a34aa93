"""The equations of a step with constraints: path, multipliers and constraints together."""

from __future__ import annotations

import casadi as ca

from varint.discrete.constraints import rows_function
from varint.discrete.equations import Equations
from varint.discrete.lagrangian import Interval, constraint_function, interval
from varint.discrete.nonholonomic import half_reaction, slips
from varint.rules.rule import Rule
from varint.scene.memory import per_scene, per_system
from varint.scene.system import System

# Round-off in g moves a path by 1e-16 |q| times the condition of the rows (N² for a chain). Newton
# is quadratic: a last correction of LAST_CORRECTION times this part of |q| leaves far less than
# that.
CORRECTION_FLOOR = 1e-2
# |g| is judged against what a change of q by this part of |q| would make of it (RESIDUAL_LIMIT
# times it: 1e-12).
GAP_FLOOR = 1e-2
# A momentum is judged no finer than by RESIDUAL_LIMIT times this part of M|q|/h, CORRECTION_FLOOR
# in it: the momentum that shifts q by its round-off.
ROUNDABLE = 1e-3
TINY = 1e-100  # instead of zero under a division


@per_system
def constrained_equations(system: System, rule: Rule) -> Equations:
    """e_j = 0 inside, p⁻ = p0 + ½h A(q0)ᵀν, g(Q_j) = 0 for j = 1 … d, Σ b_i A(q_i) v_i = 0, for
    z, λ_0 … λ_{d−1}, ν.
    """
    one = interval(system, rule)
    n, d = one.dq.shape
    m, k = one.lam.shape[0], system.nonholonomic.shape[0]
    z, lam, nu = ca.SX.sym("z", n, d), ca.SX.sym("lam", m, d), ca.SX.sym("nu", k)
    p, scale, sizes = (
        ca.SX.sym("p", n),
        ca.SX.sym("scale", 2 * n),
        ca.SX.sym("sizes", 2 * (n + m + k)),
    )
    left, total = _equations(system, one, z, lam, nu, p)
    y_size, row_size = (
        ca.vertcat(ca.repmat(a, d, 1), ca.repmat(b, d, 1), c) for a, b, c in _parts(sizes, n, m, k)
    )
    slope = constraint_function(system)(one.q0, one.t, one.c)[1]
    reactions = ca.fabs(one.h) / d * ca.mtimes(ca.fabs(slope).T, ca.sum2(ca.fabs(lam))) if m else 0
    # reactions set coordinates in motion that were at rest when the scales were taken, and hold
    # massless ones at p = 0: count what is there now
    strong, rest = ca.vertsplit(row_size, [0, n * d, left.numel()])
    gained = ca.SX.sym("gained", n)
    moving = scale[n:] + ca.fabs(p) + ca.fabs(gained) + reactions + ROUNDABLE * strong[:n]
    return Equations(
        ca.vertcat(ca.vec(z), ca.vec(lam), nu),
        one.q0,
        p,
        ca.vec(one.u),
        one.t,
        one.h,
        one.c,
        scale,
        sizes,
        left,
        y_size,
        row_size,
        ca.vertcat(ca.repmat(moving, d, 1), rest),
        gained,
        one.h * z[:, -1],
        total,
    )


def _parts(sizes: ca.SX, n: int, m: int, k: int) -> list[list[ca.SX]]:
    """Sizes of (velocities, multipliers, those of non-holonomic rows) and of (momenta, gaps,
    slips).
    """
    return [ca.vertsplit(half, [0, n, n + m, n + m + k]) for half in ca.vertsplit(sizes, n + m + k)]


def _equations(system: System, one: Interval, z, lam, nu, p) -> tuple[ca.SX, ca.SX]:
    """Residual (momenta, gaps, slips) and the momentum gain without the end's own reaction."""
    slip_reaction = (
        half_reaction(system, one.q0, one.t, one.c, one.h, nu) if nu.numel() else ca.SX(0)
    )
    rows = ca.horzcat(one.inner, one.p_plus - p - one.total - slip_reaction)
    left = ca.vertcat(ca.vec(rows), ca.vec(one.gaps), slips(system, one))
    last = ca.SX.zeros(lam.shape[0], 1)
    return ca.substitute(
        [ca.densify(left), ca.densify(one.total + slip_reaction)],
        [one.lam, one.dq],
        [ca.horzcat(lam, last), one.h * z],
    )


@per_scene
def size_function(system: System) -> ca.Function:
    """`size_expressions` with derivatives defined to be zero, for steps that are differentiated."""
    sizes = size_expressions(system)
    inputs = sizes.sx_in()
    options = {"is_diff_out": [False], "never_inline": True, "cse": True}
    return ca.Function("sizes", inputs, sizes.call(inputs), options)


@per_system
def size_expressions(system: System) -> ca.Function:
    """(q, t, h, c, scale) → sizes of mean velocities, multipliers, momenta and of the residuals of
    the rows W v + w.

    A multiplier's size makes h Wᵀλ a momentum of the scene's size. They make the equations
    dimensionless and decide when Newton's method stops.
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
    lam_size = 1 / (
        ca.fabs(h) * ca.sqrt(ca.sum2(ca.mtimes(slope, ca.diag(1 / strong)) ** 2)) + TINY
    )
    moves = ca.fabs(h) * v_size + GAP_FLOOR * far
    g_size = ca.sqrt(ca.sum2(ca.mtimes(slope, ca.diag(moves)) ** 2)) + TINY
    slow = ca.sqrt(ca.sum2(ca.mtimes(slope, ca.diag(v_size)) ** 2)) + TINY
    g_size, slow = (
        ca.vertsplit(g_size, [0, m, g_size.numel()])[0],
        ca.vertsplit(slow, [0, m, slow.numel()])[1],
    )
    sizes = ca.vertcat(v_size + floor, lam_size, strong, g_size, slow)
    return ca.Function("sizes", [s.q, s.t, h, s.c, scale], [ca.densify(sizes)], {"cse": True})

"""Constraints on a separable scene with constant mass by the trapezoidal rule: only the multipliers are unknown.

q1 = q0 + h M⁻¹(p0 + ½h (F0 + G0ᵀλ)) with g(q1) = 0, then p1 with G1 v1 = −∂g/∂t: SHAKE and RATTLE (Andersen 1983;
Leimkuhler & Skeel 1994; Hairer, Lubich & Wanner VII.1). The m × m matrices G M⁻¹Gᵀ are banded for chains.
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from varint.discrete import constraint_function
from varint.manifold import rows_function
from varint.rules import Rule, lobatto
from varint.stepping.constrained import size_function, sum_function
from varint.stepping.equations import Equations
from varint.stepping.explicit import drift_function, kick_function
from varint.stepping.newton import NEVER, iterations, newton
from varint.stepping.stepper import Stepper, compensated
from varint.system import System, per_system


def eliminates_path(system: System, rule: Rule) -> bool:
    """Can q1 be eliminated? Trapezoidal rule, L = ½vᵀMv − V(q, t) with constant regular M, forces free of v."""
    s = system.structure
    plain = s.separable and s.constant_mass and not s.degenerate and not s.force_on_velocity and not s.nonholonomic
    if not (plain and rule == lobatto(2)):
        return False
    if s.diagonal_mass:
        return system.mass_matrix.nnz() == s.n
    mass = ca.Function("mass", [system.c], [ca.densify(system.mass_matrix)])(system.default_vector)
    return bool(np.linalg.matrix_rank(np.asarray(mass)) == s.n)


@per_system
def rattle_stepper(system: System, rule: Rule) -> Stepper:
    """Stepper by the multipliers alone; the same discrete motion as `constrained_stepper`."""
    s, n, m = system, system.structure.n, system.structure.constraints
    e = shake_equations(s)
    solve, travel = _shake(e)
    kick, project = kick_function(s), _projection(s)
    offsets = [0, n, 2 * n, 3 * n, 4 * n, 5 * n, 5 * n + m, 5 * n + m + 1, 5 * n + m + 2]
    x, scale = ca.MX.sym("x", offsets[-1]), ca.MX.sym("scale", 2 * n)
    u, t, h, c = (
        ca.MX.sym(name, k) for name, k in zip("uthc", (2 * s.structure.controls, 1, 1, s.c.numel()), strict=True)
    )
    q0, cq0, p0, cp0, kept, guess, count, worst = ca.vertsplit(x, offsets)
    u0, u1 = ca.vertsplit(u, [0, s.structure.controls, 2 * s.structure.controls])
    force = kick(q0, u0, t, c) if s.structure.controls else kept
    size = size_function(s)(q0, t, h, c, scale)
    unit = ca.vertsplit(size, [0, n, n + m, 2 * (n + m)])[1]
    kicked = p0 + h / 2 * force
    lam, more = ca.vertsplit(solve(ca.vertcat(guess / unit, 0), q0, kicked, t, h, c, size), [0, m, m + 1])
    lam = lam * unit
    q1, cq1, gain, increment, gap = travel(lam, q0, cq0, kicked, t, h, c, size)
    after = ca.densify(kick(q1, u1, t + h, c))  # CasADi drops zeros that a scene without forces has
    gain = gain + h / 2 * (force + after)
    pull = project(q1, p0 + gain, t + h, c)
    p1, cp1 = sum_function(n)(p0, cp0, gain + pull, h)
    inputs = [x, u, t, h, c, scale]
    done = count + iterations(more), ca.fmax(worst, gap)
    step = ca.Function("rattle", inputs, [ca.vertcat(q1, cq1, p1, cp1, after, lam, *done)])
    push = h / 2 * ca.mtimes(constraint_function(s)(q0, t, c)[1].T, lam)
    reactions = ca.Function("reactions", inputs, [ca.horzcat(push, pull)])
    return Stepper(step, _start(s), ca.Function("path", inputs, [increment]), reactions, counts=True)


@per_system
def shake_equations(system: System) -> Equations:
    """g(q1) = 0 for the multipliers alone, q1 = q0 + h M⁻¹(p + ½h G0ᵀλ) with p after the first half kick."""
    s, n, m = system, system.structure.n, system.structure.constraints
    p, lam, t, h = ca.SX.sym("p", n), ca.SX.sym("lam", m), ca.SX.sym("t"), ca.SX.sym("h")
    scale, sizes = ca.SX.sym("scale", 2 * n), ca.SX.sym("sizes", 2 * (n + m))
    _, lam_size, _, g_size = ca.vertsplit(sizes, [0, n, n + m, 2 * n + m, 2 * (n + m)])
    shape = constraint_function(s)
    gain = h / 2 * ca.mtimes(shape(s.q, t, s.c)[1].T, lam)
    increment = h * drift_function(s)(p + gain, s.c)
    gap = ca.densify(shape(s.q + increment, t + h, s.c)[0])
    u = ca.SX(0, 1)
    return Equations(
        lam, s.q, p, u, t, h, s.c, scale, sizes, gap, lam_size, g_size, g_size, increment, ca.densify(gain)
    )


def _shake(e: Equations) -> tuple[ca.Function, ca.Function]:
    """The root finder for the multipliers, and what follows from them: q1, the momentum gain so far, the size of g."""
    arguments = [e.q, e.p, e.t, e.h, e.c, e.sizes]
    # G M⁻¹Gᵀ of a chain is tridiagonal: no zero is filled, sparse QR is safe and fast at any length
    solve = newton("newton", ca.Function("gaps", [e.y, *arguments], [e.scaled], {"cse": True}), large=NEVER)
    cq = ca.SX.sym("cq", e.q.numel())
    q1, cq1 = compensated(e.q, cq, e.increment, e.h)
    outputs = [q1, cq1, e.gain, e.increment, ca.norm_inf(e.remains)]
    return solve, ca.Function("travel", [e.y, e.q, cq, *arguments[1:]], outputs, {"cse": True})


@per_system
def hidden_functions(system: System) -> tuple[ca.Function, ca.Function]:
    """(q, p, t, c) → G M⁻¹Gᵀ, its right side and the size of μ that makes it dimensionless; (q, t, c, μ) → −Gᵀμ."""
    s, n = system, system.structure.n
    p = ca.SX.sym("p", n)
    v = drift_function(s)(p, s.c)
    slope = rows_function(s)(s.q, s.v, s.t, s.c)[1]
    matrix = ca.mtimes([slope, ca.jacobian(v, p), slope.T])
    size = 1 / ca.sqrt(ca.diag(matrix))
    matrix = ca.mtimes([ca.diag(size), matrix, ca.diag(size)])
    right = size * rows_function(s)(s.q, v, s.t, s.c)[0]
    parts = ca.Function("hidden", [s.q, p, s.t, s.c], [matrix, ca.densify(right), ca.densify(size)], {"cse": True})
    mu = ca.SX.sym("mu", s.structure.constraints)
    return parts, ca.Function("pull", [s.q, s.t, s.c, mu], [ca.densify(-ca.mtimes(slope.T, mu))])


def _projection(system: System) -> ca.Function:
    """(q, p, t, c) → Δp = −Gᵀμ with G M⁻¹(p + Δp) = −∂g/∂t."""
    s, n = system, system.structure.n
    parts, pull = hidden_functions(s)
    q, p, t, c = (ca.MX.sym(name, k) for name, k in zip("qptc", (n, n, 1, s.c.numel()), strict=True))
    matrix, right, size = parts(q, p, t, c)
    return ca.Function("projection", [q, p, t, c], [pull(q, t, c, size * ca.solve(matrix, right, "ldl"))])


def _start(system: System) -> ca.Function:
    s, n = system, system.structure.n
    q, p, t, h = ca.SX.sym("q", n), ca.SX.sym("p", n), ca.SX.sym("t"), ca.SX.sym("h")
    u = ca.SX.sym("u", 2 * s.structure.controls)
    force = ca.densify(kick_function(s)(q, u[: s.structure.controls], t, s.c))
    zeros = ca.SX.zeros(n)
    x = ca.vertcat(q, zeros, p, zeros, force, ca.SX.zeros(s.structure.constraints + 2))
    return ca.Function("start", [q, p, u, t, h, s.c], [x])

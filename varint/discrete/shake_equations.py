"""The equations of a step in which only multipliers are unknown: positions are eliminated (SHAKE
and RATTLE).
"""

from __future__ import annotations

from itertools import pairwise

import casadi as ca
import numpy as np

from varint.discrete.constraints import rows_function
from varint.discrete.equations import Equations
from varint.discrete.kick_drift import drift_function
from varint.discrete.lagrangian import constraint_function
from varint.numerics.arrays import is_definite
from varint.rules.rule import Rule, lobatto
from varint.scene.memory import per_system
from varint.scene.system import System


def eliminates_path(system: System, rule: Rule) -> bool:
    """Can q1 be eliminated? Trapezoidal rule, L = ½vᵀMv − V(q, t) with constant definite M (else
    G M⁻¹Gᵀ may be singular where the whole is not, as of a tangent lift), forces free of v.
    """
    s = system.structure
    plain = (
        s.separable
        and s.constant_mass
        and not s.degenerate
        and not s.force_on_velocity
        and not s.nonholonomic
    )
    if not (plain and rule == lobatto(2)):
        return False
    if s.diagonal_mass:
        return system.mass_matrix.nnz() == s.n
    if not _stays_sparse(system):
        return False
    mass = ca.Function("mass", [system.c], [ca.densify(system.mass_matrix)])(system.default_vector)
    return is_definite(np.asarray(mass))


@per_system
def _stays_sparse(system: System) -> bool:
    """Is factorising G M⁻¹Gᵀ no dearer than factorising (M, Gᵀ; G, 0)?

    M⁻¹ of rods with mass is full where M is banded: the cube of their number then stands against
    the number itself.
    """
    s = system
    rows = ca.DM(ca.jacobian_sparsity(s.constraint, s.q), 1)
    count, member, first = s.mass_matrix.sparsity().scc()  # each block's inverse is full
    blocks = [ca.DM.ones(b - a, b - a) for a, b in pairwise(first[: count + 1])]
    inverse = ca.diagcat(*blocks)
    rows_of_blocks = rows[:, member]
    eliminated = ca.mtimes([rows_of_blocks, inverse, rows_of_blocks.T]).sparsity()
    none = ca.DM(ca.Sparsity.diag(s.structure.constraints), 1)
    whole = ca.blockcat([[ca.DM(s.mass_matrix.sparsity(), 1), rows.T], [rows, none]]).sparsity()
    return _factorisation(eliminated) <= _factorisation(whole)


def _factorisation(pattern: ca.Sparsity) -> int:
    """Operations of an LDLᵀ factorisation, roughly."""
    triangle = pattern.ldl()[0]
    filled = np.bincount(triangle.get_triplet()[0], minlength=pattern.size1())
    return int(((1 + filled) ** 2).sum())


@per_system
def shake_equations(system: System) -> Equations:
    """g(q1) = 0 for the multipliers alone, q1 = q0 + h M⁻¹(p + ½h G0ᵀλ) with p after the first
    half kick.
    """
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
        lam,
        s.q,
        p,
        u,
        t,
        h,
        s.c,
        scale,
        sizes,
        gap,
        lam_size,
        g_size,
        g_size,
        ca.SX.sym("gained", n),
        increment,
        ca.densify(gain),
    )


@per_system
def hidden_functions(system: System) -> tuple[ca.Function, ca.Function]:
    """(q, p, t, c) → G M⁻¹Gᵀ, its right side and the size of μ that makes it dimensionless; (q,
    t, c, μ) → −Gᵀμ.
    """
    s, n = system, system.structure.n
    p = ca.SX.sym("p", n)
    v = drift_function(s)(p, s.c)
    slope = rows_function(s)(s.q, s.v, s.t, s.c)[1]
    matrix = ca.mtimes([slope, ca.jacobian(v, p), slope.T])
    size = 1 / ca.sqrt(ca.diag(matrix))
    matrix = ca.mtimes([ca.diag(size), matrix, ca.diag(size)])
    right = size * rows_function(s)(s.q, v, s.t, s.c)[0]
    parts = ca.Function(
        "hidden", [s.q, p, s.t, s.c], [matrix, ca.densify(right), ca.densify(size)], {"cse": True}
    )
    mu = ca.SX.sym("mu", s.structure.constraints)
    return parts, ca.Function("pull", [s.q, s.t, s.c, mu], [ca.densify(-ca.mtimes(slope.T, mu))])


@per_system
def projection_function(system: System) -> ca.Function:
    """(q, p, t, c) → Δp = −Gᵀμ with G M⁻¹(p + Δp) = −∂g/∂t."""
    s, n = system, system.structure.n
    parts, reaction = hidden_functions(s)
    q, p, t, c = (
        ca.MX.sym(name, k) for name, k in zip("qptc", (n, n, 1, s.c.numel()), strict=True)
    )
    matrix, right, size = parts(q, p, t, c)
    return ca.Function(
        "projection", [q, p, t, c], [reaction(q, t, c, size * ca.solve(matrix, right, "ldl"))]
    )

"""The Legendre transform v ↔ p = ∂L/∂v and solves with the mass matrix."""

from __future__ import annotations

from itertools import pairwise

import casadi as ca
import numpy as np

from varint.numerics.limits import LEGENDRE_ITERATIONS
from varint.numerics.operations import constants_of
from varint.scene.memory import per_scene
from varint.scene.system import System

WRITTEN_OUT = 1500  # multiplications of a factorisation up to which it is written out
FULL = 0.3  # of a full matrix's multiplications: fewer are written out whatever their number
HALVINGS = 12  # of a Newton step that would leave the domain of L or make the residual grow
# multiples of p by powers of 4 that Newton's method may begin with where there is no mass at rest
MULTIPLES = 4.0 ** np.arange(-20, 21)


@per_scene
def velocity_function(system: System) -> ca.Function:
    """(q, p, t, c) → v, the inverse Legendre transform p = ∂L/∂v(q, v, t).

    For Lagrangians that are quadratic in v it is the linear solve M v = p − ∂L/∂v(q, 0, t);
    otherwise Newton's method; for degenerate ones (M = 0) the Euler–Lagrange equations, linear in
    v, give it from q alone. With constraints it is the velocity on the manifold.
    """
    s, structure = system, system.structure
    p = ca.SX.sym("p", structure.n)
    if structure.constraints or structure.nonholonomic:
        from varint.discrete.constraints import tangent_function

        sizes = (structure.n, structure.n, 1, s.c.numel())
        inputs = [ca.MX.sym(name, size) for name, size in zip("qptc", sizes, strict=True)]
        return ca.Function("velocity", inputs, [tangent_function(s)(*inputs)[0]])
    if structure.degenerate:
        return _first_order_velocity(s)
    if structure.quadratic_kinetic:
        if (known := known_velocity(s, p)) is not None:
            return ca.Function("velocity", [s.q, p, s.t, s.c], [known], {"cse": True})
        offset = ca.substitute(s.momentum, s.v, ca.SX.zeros(s.v.shape))
        if full_inertia(s):
            inertia = ca.Function(
                "inertia", [s.q, s.t, s.c], [s.mass_matrix, ca.densify(offset)], {"cse": True}
            )
            q, p, t, c = (
                ca.MX.sym(name, x.numel())
                for name, x in zip("qptc", (s.q, p, s.t, s.c), strict=True)
            )
            mass, offset = inertia(q, t, c)
            return ca.Function("velocity", [q, p, t, c], [ca.solve(mass, p - offset, "ldl")])
        v = mass_solve(s.mass_matrix, p - offset)
        return ca.Function("velocity", [s.q, p, s.t, s.c], [ca.densify(v)], {"cse": True})
    iterated = _damped_newton(system).fold(LEGENDRE_ITERATIONS)
    q, p, t, c = (
        ca.MX.sym(name, x.numel()) for name, x in zip("qptc", (s.q, p, s.t, s.c), strict=True)
    )
    constant = (ca.repmat(x, 1, LEGENDRE_ITERATIONS) for x in (q, p, t, c))
    begin = _first_velocity(system)(q, p, t, c)
    return ca.Function("velocity", [q, p, t, c], [iterated(begin, *constant)])


def _first_velocity(system: System) -> ca.Function:
    """(q, p, t, c) → v to begin with: rest, or where a coordinate has no mass there, as with the
    kinetic energy v⁴, or none that is finite, as with powers of √(v·G v), the multiple of p whose
    momentum is nearest to p.
    """
    s, p = system, ca.SX.sym("p", system.v.numel())
    best = ca.SX.zeros(s.v.shape)
    at_rest = ca.substitute(s.mass_matrix, s.v, best)
    massless = any(x.is_zero() for x in ca.vertsplit(ca.diag(at_rest)))
    if massless or not np.isfinite(constants_of(at_rest)).all():
        missing = ca.Function("missing", [s.v, s.q, p, s.t, s.c], [ca.sumsqr(s.momentum - p)])
        size: ca.SX = ca.inf
        for multiple in MULTIPLES:
            off = missing(multiple * p, s.q, p, s.t, s.c)
            best, size = (
                ca.if_else(off < size, multiple * p, best),
                ca.if_else(off < size, off, size),
            )
    return ca.Function("first_velocity", [s.q, p, s.t, s.c], [ca.densify(best)])


def _first_order_velocity(system: System) -> ca.Function:
    """(q, p, t, c) → v of a degenerate scene.

    Where the force is linear in the velocities Newton's method ends after one step.
    """
    s, p = system, ca.SX.sym("p", system.v.numel())
    if (known := first_order_velocity(s)) is not None:
        return ca.Function("velocity", [s.q, p, s.t, s.c], [known], {"cse": True})
    _, (_, correction) = first_order_expressions(s)
    improved = ca.densify(s.v - correction)
    once = ca.Function("improved", [s.v, s.q, s.t, s.c], [improved], {"cse": True})
    q, p, t, c = (
        ca.MX.sym(name, x.numel()) for name, x in zip("qptc", (s.q, p, s.t, s.c), strict=True)
    )
    constant = (ca.repmat(x, 1, LEGENDRE_ITERATIONS) for x in (q, t, c))
    found = once.fold(LEGENDRE_ITERATIONS)(ca.DM.zeros(s.v.numel()), *constant)
    return ca.Function("velocity", [q, p, t, c], [found])


def first_order_velocity(system: System) -> ca.SX | None:
    """v(q, t) of a degenerate scene as an expression; None where a force is not linear in v."""
    s, (missing, correction) = system, first_order_expressions(system)[1]
    if ca.depends_on(ca.jacobian(missing, s.v), s.v):
        return None
    return ca.densify(ca.substitute(-correction, s.v, ca.SX.zeros(s.v.shape)))


def first_order_expressions(system: System) -> tuple[list[ca.SX], list[ca.SX]]:
    """(v, q, p, t), and what is missing in the Euler–Lagrange equations of a degenerate scene, L =
    ϑ·v − H, there, with Newton's correction.

    They are of first order, without controls: G v = −∂H/∂q − ∂ϑ/∂t + F(v), G_ij = ∂ϑ_i/∂q_j −
    ∂ϑ_j/∂q_i; p does not enter.
    """
    s = system
    still, p = ca.SX.zeros(s.v.shape), ca.SX.sym("p", s.v.numel())
    gyroscopic = ca.jacobian(s.momentum, s.q) - ca.jacobian(s.momentum, s.q).T
    rest = ca.substitute(s.lagrangian, s.v, still)
    left = ca.mtimes(gyroscopic, s.v) - ca.gradient(rest, s.q) - s.force
    left += ca.jacobian(s.momentum, s.t)
    left = ca.substitute(left, s.control, 0 * s.control)
    return [s.v, s.q, p, s.t], [ca.densify(left), ca.solve(ca.jacobian(left, s.v), left)]


def known_velocity(system: System, p: ca.SX) -> ca.SX | None:
    """v(q, p, t) where the scene knows it without a factorisation of its mass matrix."""
    known = system.kinetics
    if known is None or not known.velocity.numel():
        return None
    return ca.densify(ca.substitute(known.velocity, known.momentum, p))


def full_inertia(system: System) -> bool:
    """Is the inertia matrix so large and full that its factorisation is better done in loops?"""
    n = system.q.numel()
    if known_velocity(system, system.v) is not None:
        return False
    fill, _ = ca.SX(system.mass_matrix).sparsity().ldl()
    work = (
        sum(
            (end - start + 1) ** 2
            for start, end in zip(fill.colind(), fill.colind()[1:], strict=False)
        )
        / 2
    )
    return work > WRITTEN_OUT and work > FULL * n**3 / 6


def mass_solve(mass: ca.SX, rhs: ca.SX) -> ca.SX:
    """M⁻¹ rhs as an expression: division where M is diagonal, sparse LDLᵀ otherwise, QR for the
    coordinates that others are coupled to where LDLᵀ may break.
    """
    if mass.sparsity().is_diag():
        return rhs / ca.diag(mass)
    if mass.sparsity().get_diag()[0].nnz() < mass.shape[0]:
        count, order, ends = mass.sparsity().scc()
        if count == 1:
            return ca.solve(mass, rhs)
        groups = [order[a:b] for a, b in pairwise(ends)]
        found = ca.vertcat(*(mass_solve(mass[group, group], rhs[group, :]) for group in groups))
        return found[np.argsort(order).tolist(), :]
    d, lt, order = ca.ldl(mass)
    return ca.ldl_solve(rhs, d, lt, order)


def legendre_expressions(system: System) -> tuple[list[ca.SX], list[ca.SX]]:
    """(v, q, p, t) and ∂L/∂v − p there, with Newton's correction M⁻¹ (∂L/∂v − p)."""
    s, p = system, ca.SX.sym("p", system.v.numel())
    missing = s.momentum - p
    return [s.v, s.q, p, s.t], [missing, mass_solve(s.mass_matrix, missing)]


def _damped_newton(system: System) -> ca.Function:
    """(v, q, p, t, c) → v after one Newton step for ∂L/∂v(v) = p, halved until the residual
    shrinks.

    Where the Lagrangian is defined for some v only (relativity: v² < c²) a full step may leave its
    domain; comparisons with NaN are false, so such a step is halved too. At round-off no step
    shrinks the residual and v stays.
    """
    s = system
    (_, _, p, _), (left, correction) = legendre_expressions(system)
    residual = ca.Function("residual", [s.v, s.q, p, s.t, s.c], [left])
    best, size = s.v, ca.sumsqr(left)
    for k in reversed(range(HALVINGS)):
        trial = s.v - correction / 2**k
        trial_size = ca.sumsqr(residual(trial, s.q, p, s.t, s.c))
        better = trial_size < size
        best, size = ca.if_else(better, trial, best), ca.if_else(better, trial_size, size)
    return ca.Function("damped_newton", [s.v, s.q, p, s.t, s.c], [best], {"cse": True})

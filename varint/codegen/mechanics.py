"""The right-hand sides that the compiled loops need, as expressions of a system."""

from __future__ import annotations

import casadi as ca

from varint.discrete.legendre import known_velocity, mass_solve
from varint.scene.system import System


def constant_part(system: System) -> ca.SX:
    """d(c) of the momentum p = M v + d of a separable scene with constant mass."""
    return ca.substitute(system.momentum, system.v, ca.SX.zeros(system.v.numel()))


def velocity(system: System, p: ca.SX) -> ca.SX:
    """v(q, p, t) where the momentum is linear in v: the scene's own, or M⁻¹ (p − p(v = 0))."""
    known = known_velocity(system, p)
    if known is not None:
        return known
    return mass_solve(system.mass_matrix, p - constant_part(system))


def force(system: System) -> ca.SX:
    """∂L/∂q + F in terms of q, v, t, u."""
    known = system.kinetics.slopes if system.kinetics is not None else ca.SX(0, 1)
    return known[: system.q.numel()] + system.force if known.numel() else system.generalised_force


def momentum(system: System) -> ca.SX:
    """∂L/∂v in terms of q, v, t: the scene's own where it knows it."""
    known = system.kinetics.slopes if system.kinetics is not None else ca.SX(0, 1)
    return known[system.q.numel() :] if known.numel() else system.momentum


def acceleration(system: System) -> ca.SX:
    """G(q, v, t, u) = M⁻¹ (∂L/∂q + F) of a separable scene with constant mass."""
    return mass_solve(system.mass_matrix, force(system))


def dense(system: System) -> dict[str, tuple[list[ca.SX], list[ca.SX]]]:
    """The functions of dense.c: M v and ∂L/∂q + F; what both share of q is computed before.

    M v costs no more than the Lagrangian does by reverse differentiation, for a chain N operations
    and not N².
    """
    q, v, t, u, c = system.q, system.v, system.t, system.control, system.c
    rest = constant_part(system)
    moves = momentum(system)
    product = moves if rest.is_zero() else ca.jtimes(moves, v, v)
    both, symbols, values = ca.extract_parametric(
        ca.cse(ca.vertcat(product, force(system))), ca.vertcat(q, t, c), {}
    )
    known, n = ca.vertcat(*symbols), q.numel()
    return {
        "geometry": ([q, t], [ca.vertcat(*values), rest]),
        "product": ([q, known, v, t], [both[:n]]),
        "push": ([q, known, v, t, u], [both[n:]]),
    }

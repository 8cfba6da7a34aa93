"""Accelerations of the scene of one branch, and rates along its motion, as expressions."""

from __future__ import annotations

import casadi as ca

from varint.discrete.constraints import velocity_rows
from varint.discrete.legendre import mass_solve
from varint.scene.system import System

LARGEST_MASS_MATRIX = 8  # that is solved symbolically, where it is not diagonal
MOST_ROWS = 8  # of constraints


def acceleration(system: System, force: ca.SX) -> ca.SX | None:
    """dv/dt along the constraints; None where the mass matrix or the rows are too large for it."""
    found = acceleration_and_reactions(system, force)
    return found and found[0]


def acceleration_and_reactions(system: System, force: ca.SX) -> tuple[ca.SX, ca.SX] | None:
    """dv/dt and λ by M dv/dt − Wᵀλ = ∂L/∂q + F − (∂p/∂q) v − ∂p/∂t and W dv/dt = −dW/dt v − dw/dt,
    the rows W v + w = 0 being those of constraints; None where M or W is too large for that.
    """
    s, push = system, push_without_force(system) + force
    rows = velocity_rows(s)
    if not s.structure.diagonal_mass and s.structure.n > LARGEST_MASS_MATRIX:
        return None
    if rows.numel() > MOST_ROWS:
        return None
    if not rows.numel():
        return mass_solve(s.mass_matrix, push), ca.SX(0, 1)
    slope, mass = ca.jacobian(rows, s.v), s.mass_matrix
    if not s.structure.diagonal_mass:  # the mass matrix may be singular across the rows
        mass = mass + slope.T @ slope
    free, softness = mass_solve(mass, push), mass_solve(mass, ca.densify(slope.T))
    wanted = -ca.jtimes(rows, s.q, s.v) - ca.jacobian(rows, s.t)
    lam = ca.solve(ca.densify(slope @ softness), wanted - slope @ free)
    reactions = lam if s.structure.diagonal_mass else lam - wanted
    return free + softness @ lam, reactions


def push_without_force(system: System) -> ca.SX:
    """What M dv/dt is without the force and the reactions."""
    s, p = system, system.momentum
    return ca.gradient(s.lagrangian, s.q) - ca.jtimes(p, s.q, s.v) - ca.jacobian(p, s.t)


def rate_of(system: System, x: ca.SX, a: ca.SX) -> ca.SX:
    """Derivative in time along the motion with accelerations a."""
    s = system
    if not x.numel():
        return x
    along = ca.jtimes(x, ca.vertcat(s.q, s.v), ca.vertcat(s.v, a))
    return along + ca.jacobian(x, s.t)

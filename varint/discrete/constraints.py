"""The constraint manifold: velocities that keep to it, momenta on it, and the forces that hold the
motion there.

Holonomic constraints g(q, t) = 0 and non-holonomic ones A(q, t) v = 0 both restrict velocities:
together they read W v + w = 0 with W = [∂g/∂q; A] and w = [∂g/∂t; 0]. Everything here solves one
saddle-point (KKT) system, regular as soon as the mass matrix is positive on ker W; the mass matrix
itself may be singular (quaternions, directors).
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from varint.errors import InputError
from varint.numerics.arrays import call, over_columns
from varint.numerics.limits import TANGENT_ITERATIONS
from varint.scene.memory import per_scene, per_system
from varint.scene.system import System

# equilibrated entries are of size 1; a singular matrix shows in the step's residual, never as a
# CasADi dump
QR = {"eps": 1e-300}
LAST_CORRECTION = 1e-10


@per_system
def with_active_rows(system: System, rows: tuple[int, ...], active: tuple[int, ...]) -> System:
    """The scene with those rows of its constraint and those of its contacts held; no contact is
    left open.
    """
    s = system
    kept = [s.constraint[i] for i in rows] + [s.contact[i] for i in active]
    return System(
        s.q,
        s.v,
        s.lagrangian,
        constraint=ca.vertcat(ca.SX(0, 1), *kept),
        nonholonomic=s.nonholonomic,
        force=s.force,
        control=s.control if s.structure.controls else None,
        params=s.params,
        t=s.t,
        kinetics=s.kinetics,
        rays=s.rays,
    )


def velocity_rows(system: System) -> ca.SX:
    """W v + w: dg/dt of the holonomic constraints, then A v of the non-holonomic ones."""
    s = system
    hidden = ca.jtimes(s.constraint, s.q, s.v) + ca.jacobian(s.constraint, s.t)
    return ca.densify(ca.vertcat(hidden, ca.mtimes(s.nonholonomic, s.v)))


@per_scene
def rows_function(system: System) -> ca.Function:
    """(q, v, t, c) → (W v + w, W)."""
    s, rows = system, velocity_rows(system)
    return ca.Function("velocity_rows", [s.q, s.v, s.t, s.c], [rows, ca.jacobian(rows, s.v)])


@per_scene
def hidden_functions(system: System) -> tuple[ca.Function, ca.Function]:
    """(q, p, t, c) → matrix, right side and scales of M v + Wᵀμ = p − ∂L/∂v(v = 0), W v = −w;
    (q, t, c, μ) → Wᵀμ.
    """
    s, rows = system, velocity_rows(system)
    slope = ca.jacobian(rows, s.v)
    p, mu = ca.SX.sym("p", s.q.numel()), ca.SX.sym("mu", rows.numel())
    rest = 0 * s.v
    start = [ca.substitute(x, s.v, rest) for x in (s.momentum, s.mass_matrix, rows)]
    kkt = ca.Function(
        "kkt",
        [s.q, p, s.t, s.c],
        [*_saddle(start[1], slope, p - start[0], -start[2])],
        {"cse": True},
    )
    return kkt, ca.Function("pull", [s.q, s.t, s.c, mu], [ca.densify(ca.mtimes(slope.T, mu))])


@per_scene
def tangent_function(system: System) -> ca.Function:
    """(q, p, t, c) → (v, Δp): the velocity on the manifold that belongs to p, and the Δp = −Wᵀμ
    that makes p fit it.

    Solves ∂L/∂v(q, v, t) + Wᵀμ = p, W v + w = 0.
    """
    s, rows = system, velocity_rows(system)
    n, m = s.q.numel(), rows.numel()
    kkt, reaction = hidden_functions(s)
    q, p, t, c = (
        ca.MX.sym(name, size) for name, size in zip("qptc", (n, n, 1, s.c.numel()), strict=True)
    )
    found = _saddle_solution(kkt(q, p, t, c))
    if not s.structure.quadratic_kinetic:
        slope, mu, wanted = ca.jacobian(rows, s.v), ca.SX.sym("mu", m), ca.SX.sym("p", n)
        pair = ca.vertcat(s.v, mu)
        match = ca.vertcat(s.momentum + ca.mtimes(slope.T, mu) - wanted, rows)
        equation = ca.Function("momentum_match", [pair, s.q, wanted, s.t, s.c], [match])
        if ca.sprank(ca.jacobian(match, pair)) < n + m:
            raise InputError(
                "no velocity along the constraints belongs to a momentum: whatever the "
                "configuration, the mass matrix ∂²L/∂v² is singular along them; give every "
                "coordinate that may move its kinetic energy"
            )
        options = {
            "abstolStep": LAST_CORRECTION,
            "max_iter": TANGENT_ITERATIONS,
            "error_on_fail": False,
        }
        found = ca.rootfinder("tangent", "fast_newton", equation, options)(found, q, p, t, c)
    v, mu = ca.vertsplit(found, [0, n, n + m])
    return ca.Function("tangent", [q, p, t, c], [v, -reaction(q, t, c, mu)])


@per_scene
def multiplier_function(system: System) -> ca.Function:
    """(q, v, u, t, c) → (λ, dv/dt): physical multipliers and accelerations, from the twice
    differentiated constraint.

    The index-1 relation M a − Wᵀλ = ∂L/∂q + F − (∂p/∂q) v − ∂p/∂t, W a = −(∂(Wv + w)/∂q) v − ∂(Wv +
    w)/∂t.
    """
    s, n, m = system, system.structure.n, system.structure.velocity_rows
    inputs = [s.q, s.v, s.control, s.t, s.c]
    kkt = ca.Function("kkt", inputs, [*saddle_parts(s)], {"cse": True})
    sizes = (n, n, s.control.numel(), 1, s.c.numel())
    given = [ca.MX.sym(name, size) for name, size in zip("qvutc", sizes, strict=True)]
    a, lam = ca.vertsplit(_saddle_solution(kkt(*given)), [0, n, n + m])
    return ca.Function("multipliers", given, [-lam, a])


def saddle_parts(system: System) -> tuple[ca.SX, ca.SX, ca.SX]:
    """Matrix, right side and scales of the index-1 relation for (a, −λ)."""
    s, rows = system, velocity_rows(system)
    push = s.generalised_force - _along(s.momentum, s)
    return _saddle(s.mass_matrix, ca.jacobian(rows, s.v), push, -_along(rows, s))


def _along(expression: ca.SX, system: System) -> ca.SX:
    """Change of an expression of q, v, t in time at fixed v."""
    return ca.jtimes(expression, system.q, system.v) + ca.jacobian(expression, system.t)


def _saddle(mass: ca.SX, slope: ca.SX, upper: ca.SX, lower: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
    """[M Wᵀ; W 0], its right-hand side, and the scales that make the unknowns (v, μ) of it
    dimensionless.

    Scaled by the square roots of the masses and by the size of each row of W, the matrix has no
    units.
    """
    inertia = ca.fabs(ca.densify(ca.diag(mass)))
    largest = ca.mmax(inertia)
    by_mass = 1 / ca.sqrt(ca.if_else(inertia > 0, inertia, ca.if_else(largest > 0, largest, 1)))
    scaled = ca.mtimes(slope, ca.diag(by_mass))
    size = ca.sum2(scaled**2)
    by_row = 1 / ca.sqrt(ca.densify(ca.if_else(size > 0, size, 1)))
    scale = ca.vertcat(by_mass, by_row)
    matrix = ca.blockcat([[mass, slope.T], [slope, ca.SX(slope.shape[0], slope.shape[0])]])
    matrix = ca.mtimes([ca.diag(scale), matrix, ca.diag(scale)])
    return matrix, ca.densify(scale * ca.vertcat(upper, lower)), scale


def _saddle_solution(parts) -> ca.MX:
    matrix, right, scale = parts
    return scale * ca.solve(matrix, right, "qr", QR)


@dataclass(frozen=True)
class ActiveSet:
    """Which rows hold the motion: independent rows of the constraint, contacts solved for, contacts
    that touch.

    Redundant rows and contacts touch without being solved for: those that are solved for imply
    them.
    """

    rows: tuple[int, ...]
    contacts: tuple[int, ...] = ()
    holding: tuple[int, ...] = ()

    def scene(self, system: System) -> System:
        """The scene that moves in this active set; the system itself where it is all of it."""
        if (
            self.rows == tuple(range(system.structure.constraints))
            and not system.structure.contacts
        ):
            return system
        return with_active_rows(system, self.rows, self.contacts)


@per_scene
def position_rows_function(system: System) -> ca.Function:
    """(q, t, c) → (g and gaps, their slopes ∂/∂q), dense."""
    s = system
    g = ca.vertcat(s.constraint, s.contact)
    outputs = [ca.densify(x) for x in (g, ca.jacobian(g, s.q))]
    return ca.Function("position_rows", [s.q, s.t, s.c], outputs)


def position_rows(
    system: System, q: np.ndarray, t: float, c: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """g and gaps (m + c,), and their slopes (m + c, n), at one configuration."""
    g, slope = call(position_rows_function(system), q, np.array([t]), c)
    return g, slope.reshape(len(q), -1).T


@per_scene
def every_row_function(system: System) -> ca.Function:
    """(q, v, t, c) → W v + w and W of constraints, non-holonomic rows and contacts, in this
    order.
    """
    s, rows = system, velocity_rows(system)
    closing = ca.jtimes(s.contact, s.q, s.v) + ca.jacobian(s.contact, s.t)
    rows = ca.densify(ca.vertcat(rows, closing))
    return ca.Function(
        "every_row", [s.q, s.v, s.t, s.c], [rows, ca.densify(ca.jacobian(rows, s.v))]
    )


def multipliers_along(system: System, active_set: ActiveSet, q, v, u, t, c) -> np.ndarray:
    """Physical multipliers at many nodes of one active set, (N, m + k + contacts); zero for
    contacts that do not touch.

    Where rows are redundant: those of least norm with the same reaction Wᵀλ.
    """
    m, k, touching = system.constraint.numel(), system.nonholonomic.shape[0], system.contact.numel()
    result = np.zeros((len(q), m + k + touching))
    slots = [*range(m), *range(m, m + k), *(m + k + i for i in active_set.holding)]
    solved = [*active_set.rows, *range(m, m + k), *(m + k + i for i in active_set.contacts)]
    if not solved:
        return result
    lam = over_columns(multiplier_function(active_set.scene(system)), q, v, u, t[:, None], c)[0]
    order = [
        *range(len(active_set.rows)),
        *range(len(lam[0]) - k, len(lam[0])),
        *range(len(active_set.rows), len(lam[0]) - k),
    ]
    lam = lam[:, order]
    if len(slots) > len(solved):
        flat = over_columns(every_row_function(system), q, v, t[:, None], c)[1]
        slope = flat.reshape(len(q), q.shape[1], -1)  # Wᵀ of each node
        lam = np.einsum(
            "ijk,ik->ij",
            np.linalg.pinv(slope[:, :, slots], rcond=1e-10),
            np.einsum("ijk,ik->ij", slope[:, :, solved], lam),
        )
        solved = slots
    result[:, solved] = lam
    return result

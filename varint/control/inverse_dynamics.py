"""Controls that come closest to moving a scene along a path, within the bounds along it."""

from __future__ import annotations

import casadi as ca
import numpy as np

from varint.control.phase import CheckedPhase
from varint.numerics.arrays import over_columns
from varint.scene.system import System, per_system

REGULAR = 1e-10  # of the trace: damping, for points where a control does not act
HALVINGS = 30  # of the way from rest to the controls wanted, to the bound in between
ROOM = 1e-9  # of a bound's size: rows this close to it are within it


def rest_controls(phase: CheckedPhase) -> np.ndarray:
    """No force, or what is closest to that within the bounds of each control, (k,)."""
    return np.clip(0.0, *(np.where(np.isfinite(side), side, 0) for side in phase.bounds.u))


def controls_along(
    phase: CheckedPhase, t0: float, duration: float, c: np.ndarray, points: np.ndarray
) -> np.ndarray:
    """Controls at the quadrature nodes, (N, r, k): least squares, one Gauss–Newton step from rest,
    drawn back towards rest where a bound along the path is violated.

    Accelerations are differences of the mean velocities of the steps: a guess has kinks where
    steps meet.

    Parameters
    ----------
    points : ndarray (N, d + 1, n)
        The path at the control points.
    """
    rule, (count, _, n) = phase.rule, points.shape
    h = duration * np.diff(phase.mesh)
    q = np.einsum("ij,kjn->kin", rule.basis, points)
    v = np.einsum("ij,kjn->kin", rule.slopes, points) / h[:, None, None]
    q, v = q.reshape(-1, n), v.reshape(-1, n)
    local = phase.mesh[:-1, None] + np.diff(phase.mesh)[:, None] * np.array(rule.nodes)
    t = (t0 + duration * local).ravel()
    a = np.zeros_like(v)
    if count > 1:
        middles = t0 + duration * (phase.mesh[:-1] + phase.mesh[1:]) / 2
        with np.errstate(all="ignore"):  # what is not finite is left out below
            rates = np.gradient((points[:, -1] - points[:, 0]) / h[:, None], middles, axis=0)
        a = np.array([np.interp(t, middles, rate) for rate in rates.T]).T
    rest = rest_controls(phase)
    u = over_columns(_inverse(phase.system), q, v, a, rest, t[:, None], c)[0]
    u = np.clip(np.where(np.isfinite(u), u, rest), *phase.bounds.u)
    return _drawn_back(phase, u, rest, q, v, t, c).reshape(count, len(rule.nodes), -1)


def _drawn_back(phase: CheckedPhase, u, rest, q, v, t, c) -> np.ndarray:
    """The controls furthest from rest that violate the bounds along the path no more than rest
    does.
    """
    s, bounds = phase.system, phase.bounds
    if not ca.depends_on(bounds.at_nodes, s.control):
        return u
    rows = ca.Function("rows", [s.q, s.v, s.control, s.t, s.c], [ca.densify(bounds.at_nodes)])
    room = ROOM * (1 + np.maximum(*(np.where(np.isfinite(y), np.abs(y), 0) for y in _sides(phase))))

    def violation(at: np.ndarray) -> np.ndarray:
        value = over_columns(rows, q, v, at, t[:, None], c)[0]
        return np.maximum(bounds.nodes_low - value, value - bounds.nodes_high)

    allowed = np.maximum(violation(np.broadcast_to(rest, u.shape)), 0) + room
    share = np.where((violation(u) <= allowed).all(axis=1), 1.0, 0.0)
    most, width = share, np.ones(len(u))
    for _ in range(HALVINGS):
        width = width / 2
        tried = np.minimum(most + width, 1.0)
        at = rest + tried[:, None] * (u - rest)
        most = np.where((violation(at) <= allowed).all(axis=1), tried, most)
    return rest + most[:, None] * (u - rest)


def _sides(phase: CheckedPhase) -> tuple[np.ndarray, np.ndarray]:
    return phase.bounds.nodes_low, phase.bounds.nodes_high


@per_system
def _inverse(system: System) -> ca.Function:
    """(q, v, a, u0, t, c) → u with the least |F(u) − (d/dt ∂L/∂v − ∂L/∂q)|, F linear about u0."""
    s, n = system, system.structure.n
    a = ca.SX.sym("a", n)
    p = s.momentum
    rate = ca.jtimes(p, s.q, s.v) + ca.mtimes(s.mass_matrix, a) + ca.jacobian(p, s.t)
    lacking = rate - ca.gradient(s.lagrangian, s.q) - s.force
    slope = ca.jacobian(s.force, s.control)
    f = ca.Function(
        "lacking", [s.q, s.v, a, s.control, s.t, s.c], [ca.densify(lacking), ca.densify(slope)]
    )
    q, v, a, u, t, c = (ca.MX.sym(f"i{i}", f.size1_in(i)) for i in range(6))
    need, act = f(q, v, a, u, t, c)
    return ca.Function("inverse_dynamics", [q, v, a, u, t, c], [u + _least_squares(act, need)])


def _least_squares(matrix: ca.MX, rhs: ca.MX) -> ca.MX:
    """The damped least-squares solution: finite also where a control does not act at this point."""
    normal = ca.mtimes(matrix.T, matrix)
    damping = REGULAR * (1 + ca.trace(normal)) * ca.DM.eye(matrix.shape[1])
    return ca.solve(normal + damping, ca.mtimes(matrix.T, rhs))

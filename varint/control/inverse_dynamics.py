"""Controls that come closest to moving a scene along a path, within the bounds along it."""

from __future__ import annotations

import casadi as ca
import numpy as np

from varint.control.phase import CheckedPhase
from varint.discrete.constraints import velocity_rows
from varint.numerics.arrays import over_columns
from varint.scene.system import System, per_system

REGULAR = 1e-10  # of the trace: damping, for points where a control does not act
HALVINGS = 30  # of the way from rest to the controls wanted, to the bound in between
ROOM = 1e-9  # of a bound's size: rows this close to it are within it


def rest_controls(phase: CheckedPhase) -> np.ndarray:
    """No force, or what is closest to that within the bounds of each control, (k,); states are as
    they start.
    """
    rest = np.clip(0.0, *(np.where(np.isfinite(side), side, 0) for side in phase.bounds.u))
    rest[phase.states.index] = states_between_ends(phase)[0]
    return rest


def states_between_ends(phase: CheckedPhase) -> np.ndarray:
    """States at the nodes on a straight line between their ends, as far as these are known, and 1
    where they are not (a mass of 0 would be singular), (N + 1, m).
    """
    first, last = phase.start.states[0], phase.end.states[0]
    first, last = np.where(np.isnan(first), last, first), np.where(np.isnan(last), first, last)
    line = first + phase.mesh[:, None] * (last - first)
    return np.clip(np.nan_to_num(line, nan=1.0), *phase.bounds.u[:, phase.states.index])


def controls_along(
    phase: CheckedPhase,
    t0: float,
    duration: float,
    c: np.ndarray,
    points: np.ndarray,
    states: np.ndarray,
) -> np.ndarray:
    """Controls at the quadrature nodes, (N, r, k): least squares, one Gauss–Newton step from rest,
    drawn back towards rest where a bound along the path is violated.

    Accelerations are differences of the mean velocities of the steps: a guess has kinks where
    steps meet.

    Parameters
    ----------
    points : ndarray (N, d + 1, n)
        The path at the control points.
    states : ndarray (N, r, m)
        The states at the quadrature nodes; they are no force to choose.
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
    rest = np.tile(rest, (len(q), 1))
    rest[:, phase.states.index] = states.reshape(len(q), -1)
    free = np.setdiff1d(np.arange(rest.shape[1]), phase.states.index)
    inverse = _inverse(phase.system, tuple(free.tolist()))
    u = over_columns(inverse, q, v, a, rest, t[:, None], c)[0]
    u = np.clip(np.where(np.isfinite(u), u, rest), *phase.bounds.u)
    return _drawn_back(phase, u, rest, q, v, t, c).reshape(count, len(rule.nodes), -1)


def _drawn_back(phase: CheckedPhase, u, rest, q, v, t, c) -> np.ndarray:
    """The controls furthest from rest that violate the bounds along the path no more than rest
    does.
    """
    s, bounds = phase.system, phase.bounds
    if not ca.depends_on(bounds.at_nodes, s.control):
        return u
    rates = phase.rates.symbols
    still = ca.substitute(bounds.at_nodes, rates, ca.SX.zeros(rates.numel()))
    rows = ca.Function("rows", [s.q, s.v, s.control, s.t, s.c], [ca.densify(still)])
    room = ROOM * (1 + np.maximum(*(np.where(np.isfinite(y), np.abs(y), 0) for y in _sides(phase))))

    def violation(at: np.ndarray) -> np.ndarray:
        value = over_columns(rows, q, v, at, t[:, None], c)[0]
        return np.maximum(bounds.nodes_low - value, value - bounds.nodes_high)

    allowed = np.maximum(violation(rest), 0) + room
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
def _inverse(system: System, free: tuple[int, ...]) -> ca.Function:
    """(q, v, a, u0, t, c) → u with the least |F(u) + Wᵀλ − (d/dt ∂L/∂v − ∂L/∂q)|, F linear about
    u0, Wᵀλ what constraints can give; only these controls are changed.
    """
    s, n = system, system.structure.n
    a = ca.SX.sym("a", n)
    p = s.momentum
    rate = ca.jtimes(p, s.q, s.v) + ca.mtimes(s.mass_matrix, a) + ca.jacobian(p, s.t)
    lacking = rate - ca.gradient(s.lagrangian, s.q) - s.force
    slope = ca.jacobian(s.force, s.control)[:, list(free)]
    slope = ca.horzcat(slope, ca.jacobian(velocity_rows(s), s.v).T)
    f = ca.Function(
        "lacking", [s.q, s.v, a, s.control, s.t, s.c], [ca.densify(lacking), ca.densify(slope)]
    )
    q, v, a, u, t, c = (ca.MX.sym(f"i{i}", f.size1_in(i)) for i in range(6))
    need, act = f(q, v, a, u, t, c)
    change = _least_squares(act, need)[: len(free)] if free else ca.MX(0, 1)
    among = ca.DM.eye(s.structure.controls)[:, list(free)]
    return ca.Function("inverse_dynamics", [q, v, a, u, t, c], [u + ca.mtimes(among, change)])


def _least_squares(matrix: ca.MX, rhs: ca.MX) -> ca.MX:
    """The damped least-squares solution: finite also where a control does not act at this point."""
    normal = ca.mtimes(matrix.T, matrix)
    damping = REGULAR * (1 + ca.trace(normal)) * ca.DM.eye(matrix.shape[1])
    return ca.solve(normal + damping, ca.mtimes(matrix.T, rhs))

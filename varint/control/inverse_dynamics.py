"""Controls that come closest to moving a scene along a path, within the bounds along it."""

from __future__ import annotations

from collections.abc import Callable

import casadi as ca
import numpy as np

from varint.control.phase import CheckedPhase
from varint.discrete.constraints import velocity_rows
from varint.numerics.arrays import over_columns
from varint.scene.memory import per_system
from varint.scene.system import System

REGULAR = 1e-10  # of the trace: damping, for points where a control does not act
PROJECTIONS = 12  # steps to the bounds along the path
DEPENDENT = 1e-8  # of the largest singular value: rows of one direction
HALVINGS = 30  # of the way from rest to the controls wanted, to the bound in between
ROOM = 1e-9  # of a bound's size: rows this close to it are within it

# controls (M, k) → by how much they violate each row, (M, b)
Excess = Callable[[np.ndarray], np.ndarray]


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
    then within the bounds along the path.

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
    free = np.delete(np.arange(rest.shape[1]), phase.states.index)
    inverse = _inverse(phase.system, tuple(free.tolist()))
    u = over_columns(inverse, q, v, a, rest, t[:, None], c)[0]
    u = np.clip(np.where(np.isfinite(u), u, rest), *phase.bounds.u)
    return _within_bounds(phase, u, rest, q, v, t, c).reshape(count, len(rule.nodes), -1)


def _within_bounds(phase: CheckedPhase, u, rest, q, v, t, c) -> np.ndarray:
    """The controls moved into the bounds along the path: to the nearest point of them, by steps of
    sequential quadratic programming at every node; where that finds none, towards rest.
    """
    s, bounds = phase.system, phase.bounds
    acting = [ca.depends_on(row, s.control) for row in ca.vertsplit(bounds.at_nodes)]
    if not any(acting):
        return u
    rates = phase.rates.symbols
    still = ca.substitute(bounds.at_nodes, rates, ca.SX.zeros(rates.numel()))
    slope = ca.jacobian(still, s.control)
    slope[:, phase.states.index.tolist()] = 0
    at_node = [s.q, s.v, s.control, s.t, s.c]
    rows = ca.Function("rows", at_node, [ca.densify(still), ca.densify(slope)])
    room = ROOM * (1 + np.maximum(*(np.where(np.isfinite(y), np.abs(y), 0) for y in _sides(phase))))

    def at_rows(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        value, flat = over_columns(rows, q, v, x, t[:, None], c)
        return value, flat.reshape(len(q), x.shape[1], -1).transpose(0, 2, 1)

    def excess(x: np.ndarray) -> np.ndarray:
        value = at_rows(x)[0]
        return np.maximum(np.maximum(bounds.nodes_low - value, value - bounds.nodes_high), 0)

    near, side = (
        u,
        np.zeros((len(u), len(room))),
    )  # −1, 1: this row stands at its lower, upper bound
    for _ in range(PROJECTIONS):
        value, slopes = at_rows(near)
        above, below = value > bounds.nodes_high + room, value < bounds.nodes_low - room
        if not (above | below).any():
            return near
        side = np.where(above, 1.0, np.where(below, -1.0, side))
        bound = np.where(side > 0, bounds.nodes_high, bounds.nodes_low)
        lacking = np.where(side == 0, 0.0, value - bound)[..., None]
        slopes = slopes * (side != 0)[:, :, None]
        sound = np.isfinite(slopes).all(axis=(1, 2)) & np.isfinite(lacking).all(axis=(1, 2))
        slopes, lacking = (np.where(sound[:, None, None], x, 0.0) for x in (slopes, lacking))
        # the nearest point to u on the rows at their bounds, linear about the last one
        inverse = np.linalg.pinv(slopes, rcond=DEPENDENT)
        step = inverse @ (slopes @ (u - near)[..., None] + lacking)
        near = np.clip(u - step[..., 0], *bounds.u)
        pulls = inverse.transpose(0, 2, 1) @ step
        side = np.where(side * pulls[..., 0] < 0, 0.0, side)  # a bound pushes, it does not pull
    inside = np.asarray((excess(near)[:, acting] <= room[acting]).all(axis=1))
    return np.where(inside[:, None], near, _drawn_back(u, rest, excess, room))


def _drawn_back(u: np.ndarray, rest: np.ndarray, excess: Excess, room: np.ndarray) -> np.ndarray:
    """The controls furthest from rest that violate the bounds along the path no more than rest
    does.
    """
    allowed = excess(rest) + room

    def fits(at: np.ndarray) -> np.ndarray:
        return (excess(at) <= allowed).all(axis=1)

    most, width = np.where(fits(u), 1.0, 0.0), np.ones(len(u))
    for _ in range(HALVINGS):
        width = width / 2
        tried = np.minimum(most + width, 1.0)
        most = np.where(fits(rest + tried[:, None] * (u - rest)), tried, most)
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
    lacking = rate - s.generalised_force
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

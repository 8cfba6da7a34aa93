"""The least-squares problem of a moving horizon, and what is kept of data that leave it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import casadi as ca
import numpy as np

from varint.discrete.legendre import velocity_function
from varint.errors import ConvergenceError
from varint.estimation.gauss_newton import huber_weights, null_space
from varint.estimation.residuals import Residuals
from varint.estimation.sensors import seen_by
from varint.estimation.single_steps import single_steps
from varint.numerics.arrays import over_columns
from varint.rules.rule import Rule
from varint.scene.memory import per_system
from varint.scene.system import System


@dataclass(frozen=True, eq=False)
class Observed:
    """A scene whose state is estimated.

    Attributes
    ----------
    system, rule, h : System, Rule, float
    sensor : Function
        (q, p, t, c) → ψ with its derivatives.
    sigma : ndarray (o,)
        Spread of what is measured.
    disturbance : ndarray (n,)
        Spread of the momentum that every step adds from outside; 0 where there is none.
    c : ndarray
        Parameter values; `theta` are the places of those that are estimated, `lower` and `upper`
        their bounds.
    huber : float or None
    """

    system: System
    rule: Rule
    h: float
    sensor: ca.Function
    sigma: np.ndarray
    disturbance: np.ndarray
    c: np.ndarray
    theta: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    huber: float | None

    @property
    def held(self) -> bool:
        """Whether there are constraints."""
        return bool(self.system.structure.constraints)


class Arrival(NamedTuple):
    """What is known of (θ, x_0) at the begin of a horizon, |R (θ, x_0) − s|²."""

    r: np.ndarray
    s: np.ndarray


class Horizon(NamedTuple):
    """Data of the last N steps.

    Attributes
    ----------
    arrival : Arrival
    t : ndarray (N + 1,)
    y : ndarray (N + 1, o)
        What was measured, NaN where it was not.
    u : ndarray (N, nodes k)
        Controls of the steps.
    z : ndarray
        Estimates, or guesses: θ, then (q, p) at every node.
    """

    arrival: Arrival
    t: np.ndarray
    y: np.ndarray
    u: np.ndarray
    z: np.ndarray


def parts_of(scene: Observed, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """All parameters, and the states (N + 1, 2n)."""
    c, many = scene.c.copy(), len(scene.theta)
    c[scene.theta] = z[:many]
    return c, z[many:].reshape(-1, 2 * scene.system.structure.n)


def deviations(scene: Observed, horizon: Horizon, z: np.ndarray) -> Residuals:
    """Residuals r of arrival, measurements and disturbances, defects d of what nothing disturbs,
    with their derivatives.

    Raises
    ------
    ConvergenceError
        If a step cannot be solved.
    """
    c, x = parts_of(scene, z)
    many, width, nodes = len(scene.theta), x.shape[1], len(x)
    n, count = width // 2, len(z)
    value, by_x, by_c = seen_by(scene.sensor, x, horizon.t, c)
    of_value = _at_nodes(by_x, by_c[:, :, scene.theta], np.arange(nodes), count)
    there = np.isfinite(horizon.y)
    left = ((value - horizon.y) / scene.sigma)[there]
    of_left = (of_value / scene.sigma[:, None])[there]
    begin = np.eye(count)[: many + width]
    r = [horizon.arrival.r @ z[: many + width] - horizon.arrival.s, left]
    of_r = [horizon.arrival.r @ begin, of_left]
    d, of_d = np.zeros(0), np.zeros((0, count))
    if nodes > 1:
        size = np.full(nodes - 1, scene.h)
        end, by_start, by_c = single_steps(
            scene.system, scene.rule, x[:-1], horizon.t[:-1], size, horizon.u, c
        )
        if not np.isfinite(end).all():
            raise ConvergenceError(
                "a step of the horizon cannot be taken: try a smaller h",
                step=int(np.flatnonzero(~np.isfinite(end).all(axis=1))[0]),
                time=float(horizon.t[0]),
                residual=float("nan"),
            )
        gap = x[1:] - end
        of_gap = -_at_nodes(by_start, by_c[:, :, scene.theta], np.arange(nodes - 1), count)
        of_gap += _at_nodes(
            np.broadcast_to(np.eye(width), by_start.shape),
            np.zeros((nodes - 1, width, many)),
            np.arange(1, nodes),
            count,
        )
        pushed = np.concatenate([np.zeros(n, dtype=bool), scene.disturbance > 0])
        spread = scene.disturbance[scene.disturbance > 0]
        r.append((gap[:, pushed] / spread).ravel())
        of_r.append((of_gap[:, pushed] / spread[:, None]).reshape(-1, count))
        d, of_d = gap[:, ~pushed].ravel(), of_gap[:, ~pushed].reshape(-1, count)
    if scene.held:
        rows, of_rows = _kept_rows(scene, x, horizon.t, c, count)
        d, of_d = np.concatenate([d, rows]), np.concatenate([of_d, of_rows])
    signal = float(np.linalg.norm((horizon.y / scene.sigma)[there]))
    return Residuals(np.concatenate(r), np.concatenate(of_r), d, of_d, (x,), signal)


def _kept_rows(
    scene: Observed, x: np.ndarray, t: np.ndarray, c: np.ndarray, count: int
) -> tuple[np.ndarray, np.ndarray]:
    """Constraints of the first node, which the steps hand on; where they are disturbed those of the
    velocities at every node.
    """
    value, slope = _rows(scene, x, t, c)
    many, size = len(scene.theta), value.shape[1]
    of_z = _at_nodes(slope, np.zeros((len(x), size, many)), np.arange(len(x)), count)
    velocity_rows = np.arange(size) >= scene.system.structure.constraints
    kept = np.zeros(value.shape, dtype=bool)
    kept[0] = True
    kept[1:] = velocity_rows & bool((scene.disturbance > 0).any())
    return value[kept], of_z[kept]


def _rows(
    scene: Observed, x: np.ndarray, t: np.ndarray, c: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """`kept_function` at states (q, p): values (T, rows) and their derivatives (T, rows, 2n)."""
    width = x.shape[1]
    q, p = np.split(x, 2, axis=1)
    value, flat = over_columns(kept_function(scene.system), q, p, t[:, None], c)
    return value, flat.reshape(len(x), width, -1).transpose(0, 2, 1)


@per_system
def kept_function(system: System) -> ca.Function:
    """(q, p, t, c) → g and G (p − ∂L/∂v), v the velocity that keeps to the constraints, and their
    Jacobian with respect to (q, p).
    """
    s, n = system, system.structure.n
    slope, p0 = ca.jacobian(s.constraint, s.q), ca.SX.sym("p", n)
    rows = ca.vertcat(s.constraint, slope @ (p0 - s.momentum))
    of_both = ca.Function("rows", [s.q, p0, s.v, s.t, s.c], [rows], {"cse": True})
    x, t, c = ca.MX.sym("x", 2 * n), ca.MX.sym("t"), ca.MX.sym("c", s.c.numel())
    q, p = ca.vertsplit(x, n)
    value = of_both(q, p, velocity_function(s)(q, p, t, c), t, c)
    kept = ca.Function("kept", [x, t, c], [value, ca.densify(ca.jacobian(value, x))])
    q, p = ca.MX.sym("q", n), ca.MX.sym("p", n)
    return ca.Function("kept", [q, p, t, c], kept(ca.vertcat(q, p), t, c))


def _tangent(slope: np.ndarray) -> np.ndarray:
    """Changes that rows (m, k) allow, (k, k − m)."""
    return null_space(slope)[1]


def _at_nodes(by_x: np.ndarray, by_theta: np.ndarray, node: np.ndarray, count: int) -> np.ndarray:
    """Derivatives by θ and by the states of single nodes, (T, o, …), among all unknowns."""
    many, width = by_theta.shape[2], by_x.shape[2]
    found = np.zeros((*by_x.shape[:2], count))
    found[:, :, :many] = by_theta
    columns = many + width * node[:, None] + np.arange(width)
    np.put_along_axis(found, np.broadcast_to(columns[:, None], by_x.shape), by_x, axis=2)
    return found


def moved_on(scene: Observed, horizon: Horizon) -> Horizon:
    """The horizon without its first node: what that told is kept as the arrival at the second,
    linearised at the estimates (an extended Kalman filter's step in square-root information form,
    Bierman, Factorization Methods for Discrete Sequential Estimation, 1977, V).

    The least squares over (θ, x_0) and the disturbance w of the first step are reduced to (θ, x_1):
    x_0 = x̂_0 + F⁻¹ (x_1 − Φ̂ − B (θ − θ̂) − G w), with constraints along the changes that keep to
    them.
    """
    c, x = parts_of(scene, horizon.z)
    many, width = len(scene.theta), x.shape[1]
    theta, first = horizon.z[:many], x[:1]
    value, by_x, by_c = seen_by(scene.sensor, first, horizon.t[:1], c)
    there = np.isfinite(horizon.y[0])
    left = ((value[0] - horizon.y[0]) / scene.sigma)[there]
    root = np.sqrt(huber_weights(left, scene.huber))[:, None]
    slope = root * (np.hstack([by_c[0][:, scene.theta], by_x[0]]) / scene.sigma[:, None])[there]
    rows = np.vstack([horizon.arrival.r, slope])
    s = np.concatenate([horizon.arrival.s, slope @ horizon.z[: many + width] - root[:, 0] * left])
    size = np.array([scene.h])
    end, by_start, by_c = single_steps(
        scene.system, scene.rule, first, horizon.t[:1], size, horizon.u[:1], c
    )
    drift, n = by_c[0][:, scene.theta], width // 2
    pushed = np.flatnonzero(scene.disturbance > 0)
    ways, kicks = np.eye(width), np.diag(scene.disturbance)[:, pushed]
    if scene.held:  # states, and momenta that are added, keep to the constraints
        ways = _tangent(_rows(scene, first, horizon.t[:1], c)[1][0])
        after = _rows(scene, x[1:2], horizon.t[1:2], c)[1][0]
        kicks = _tangent(after[scene.system.structure.constraints :, n:])[
            :, : n * bool(len(pushed))
        ]
    back = ways @ np.linalg.pinv(by_start[0] @ ways)
    of_theta, of_x = rows[:, :many], rows[:, many:] @ back
    kick = np.vstack([np.zeros((n, kicks.shape[1])), kicks])
    s = s - rows[:, many:] @ first[0] + of_x @ (end[0] - drift @ theta)
    old = np.hstack([-of_x @ kick, of_theta - of_x @ drift, of_x, s[:, None]])
    in_sigma = kicks[pushed] / scene.disturbance[pushed, None]
    own = np.hstack([in_sigma, np.zeros((len(pushed), many + width + 1))])
    triangle, out = np.linalg.qr(np.vstack([own, old]))[1], kicks.shape[1]
    r = triangle[out : out + many + width]
    z = np.concatenate([theta, x[1:].ravel()])
    return Horizon(Arrival(r[:, out:-1], r[:, -1]), horizon.t[1:], horizon.y[1:], horizon.u[1:], z)

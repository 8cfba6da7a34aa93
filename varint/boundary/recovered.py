"""The path between the nodes of a trajectory: inner control points and multipliers, found again
from q and p.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from varint.boundary.iterate import point_times
from varint.boundary.stationary import interval_rows
from varint.errors import InputError
from varint.numerics.arrays import over_columns
from varint.numerics.limits import RECOVERY_ITERATIONS
from varint.results.dense_output import step_controls
from varint.results.trajectory import Trajectory
from varint.rules.rule import Rule
from varint.scene.memory import per_system
from varint.scene.system import System

LAST_CORRECTION = 1e-9
ROUNDING = 1e-6  # of a step
# of the coordinates: corrections of a motion so slow, or of steps so short, are not known better
ROUND_OFF = 1e-14
# of a step: corrections that no longer shrink to this part of the last ones are round-off there, as
# where constraints bind small coordinates to large ones
NOISE, STALLED = 1e-4, 0.5


@dataclass(frozen=True, eq=False)
class IntervalPaths:
    """Increments (B, d, n), multipliers (B, d + 1, m) and curvature ∂(e_j, h b_j g_j)/∂(Q_i,
    λ_i), (B, L, L).
    """

    increments: np.ndarray
    multipliers: np.ndarray
    curvature: np.ndarray


def require_every_step(trajectory: Trajectory) -> None:
    """Refuse trajectories whose nodes are not all one step apart."""
    if len(trajectory) > 1 and (np.diff(trajectory.k) == 1).all():
        steps = np.diff(trajectory.t) / step_sizes(trajectory)
        if np.abs(steps - 1).max() <= ROUNDING and not trajectory.events:
            return
    raise InputError(
        "this needs every step of the motion at its full length: save_every=1, no times of at(), "
        "no event in between"
    )


def step_sizes(trajectory: Trajectory) -> np.ndarray:
    """Size of the step after every node but the last, (N,)."""
    k = trajectory.k[:-1]
    return np.full(len(k), trajectory.h) if trajectory.sizes is None else trajectory.sizes[k]


def _cubic(
    trajectory: Trajectory, k: np.ndarray, whole: np.ndarray, share: np.ndarray
) -> np.ndarray:
    """Increments from the nodes k to shares (B, d) of the steps after them, on the cubic with both
    nodes' places and velocities, (B, d, n).
    """
    along, v, s = trajectory.q[k + 1] - trajectory.q[k], trajectory.v, share[..., None]
    begin, end = (whole[:, None] * x - along for x in (v[k], v[k + 1]))
    return s * along[:, None] + s * (1 - s) * ((1 - s) * begin[:, None] - s * end[:, None])


@per_system
def curvature_function(system: System, rule: Rule) -> ca.Function:
    """Arguments of `interval_rows` → (rows, ∂rows/∂(Q_j, λ_j)), symmetric where there are no
    forces.
    """
    kernel = interval_rows(system, rule)
    inputs = [ca.SX.sym(f"a{i}", kernel.numel_in(i)) for i in range(kernel.n_in())]
    n, m = system.structure.n, system.structure.constraints
    d = inputs[1].numel() // n
    rows, _ = kernel(*inputs)
    ahead = ca.jacobian(rows, inputs[1])
    start = ca.jacobian(rows, inputs[0]) - sum(ahead[:, j * n : (j + 1) * n] for j in range(d))
    by_point = [start, *(ahead[:, j * n : (j + 1) * n] for j in range(d))]
    by_lam = ca.jacobian(rows, inputs[2])
    columns = [x for j in range(d + 1) for x in (by_point[j], by_lam[:, j * m : (j + 1) * m])]
    return ca.Function("curvature", inputs, [rows, ca.densify(ca.horzcat(*columns))], {"cse": True})


def interval_paths(
    trajectory: Trajectory, k: np.ndarray, size: np.ndarray, ends: np.ndarray | None
) -> IntervalPaths:
    """The paths that leave the nodes k and last for the times `size`.

    `ends` are the nodes where they arrive, whose momenta give the last multipliers; None where
    these do not matter.
    """
    system, rule = trajectory.system, trajectory.rule
    kernel, tau = curvature_function(system, rule), point_times(rule)[1:]
    n, m, d, count = system.structure.n, system.structure.constraints, len(tau), len(k)
    block = n + m
    q, p, t, h = trajectory.q[k], trajectory.p[k], trajectory.t[k][:, None], size[:, None]
    whole = step_sizes(trajectory)[k]
    ahead = _cubic(trajectory, k, whole, (size / whole)[:, None] * tau)
    lam = np.zeros((count, d + 1, m))
    u = step_controls(trajectory, trajectory.k[k], size / whole)
    # where a motion turns its own step is no measure
    longest = np.abs(np.diff(trajectory.q, axis=0)).max()
    reach = (longest + np.finfo(float).tiny) * np.abs(size / whole)
    target = np.zeros((count, (d + 1) * block))
    target[:, :n] = -p
    y = np.array(
        [j * block + i for j in range(d + 1) for i in range(block) if (j > 0 if i < n else j < d)]
    )
    rows = np.array(
        [j * block + i for j in range(d + 1) for i in range(block) if (j < d if i < n else j > 0)]
    )
    polish, last = False, np.full(count, np.inf)
    rounding = ROUND_OFF * np.abs(trajectory.q).max(axis=0)
    for _ in range(RECOVERY_ITERATIONS):
        flat = ahead.reshape(count, -1), lam.reshape(count, -1)
        values, slopes = over_columns(kernel, q, *flat, u, trajectory.c, t, h)
        slopes = slopes.reshape(count, (d + 1) * block, -1).transpose(0, 2, 1)
        if polish:
            break
        step = np.zeros((count, (d + 1) * block))
        try:
            step[:, y] = -np.linalg.solve(
                slopes[:, rows][:, :, y], (values - target)[:, rows, None]
            )[..., 0]
        except np.linalg.LinAlgError:
            raise InputError(
                "the steps' equations are singular: redundant constraints, or a singular mass"
            ) from None
        change = step.reshape(count, d + 1, block)
        ahead, lam = ahead + change[:, 1:, :n], lam + change[:, :, n:]
        moved = np.abs(change[:, :, :n]).max(axis=1)
        noise = (moved.max(axis=1) >= STALLED * last) & (moved.max(axis=1) <= NOISE * reach)
        found = (moved <= np.maximum(LAST_CORRECTION * reach[:, None], rounding)).all(axis=1)
        polish, last = bool((found | noise).all()), moved.max(axis=1)
    if not polish or not np.isfinite(slopes).all():
        raise InputError(
            "the steps are too long to find the path between their nodes; use more steps"
        )
    if m and ends is not None:
        impulse, gained = (
            slopes[:, -block:-m, -m:],
            trajectory.p[ends] - values[:, -block:-m],
        )
        lam[:, -1] = (np.linalg.pinv(impulse) @ gained[..., None])[..., 0]
        slopes = over_columns(
            kernel, q, ahead.reshape(count, -1), lam.reshape(count, -1), u, trajectory.c, t, h
        )[1]
        slopes = slopes.reshape(count, (d + 1) * block, -1).transpose(0, 2, 1)
    return IntervalPaths(ahead, lam, slopes)

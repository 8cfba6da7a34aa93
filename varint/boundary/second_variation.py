"""Second variation of the action along a trajectory: Morse index and conjugate times.

The second variation is block-tridiagonal in the nodes. Eliminating inner control points and then node after node, the
number of negative pivots up to a node is the index of the path that ends there (Sylvester's law of inertia); it grows
by one at every time conjugate to the start (Morse's index theorem; Milnor, Morse Theory, §15). With constraints the
pivots are saddle-point matrices: each constraint brings one negative eigenvalue that is not counted.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from varint.arrays import over_columns
from varint.boundary.stationary import interval_rows, point_times
from varint.legendre import velocity_function
from varint.errors import InputError
from varint.rules import Rule
from varint.system import System, per_system
from varint.trajectory import Trajectory

LAST_CORRECTION = 1e-9
MOST_ITERATIONS = 30
SMALLEST_PIVOT = 1e-10  # relative; a node conjugate to the start to round-off counts with the next one
SYMMETRY = 1e-7  # relative; eigenvalues of closed paths this small belong to shifts and turns of the whole path
PARTS = 32  # of an interval of time in one round of the search for a conjugate time
LOCATED = 1e-13  # relative to the step


def morse_index(trajectory: Trajectory) -> int:
    """Number of independent variations, ends kept, that lower the action of the path to second order.

    Closed paths (`Trajectory.closure`) vary among closed paths; directions along families of such paths do not count.
    """
    chain = _chain(trajectory)
    index = int(chain.found.sum())
    if trajectory.closure is None:
        return index
    n, m = trajectory.q.shape[1], trajectory.system.structure.constraints
    turn = trajectory.closure[:, :n]
    joined = np.block([[np.eye(n + m)], [turn, np.zeros((n, m))], [np.zeros((m, n + m))]])
    values = np.linalg.eigvalsh(joined.T @ chain.ends @ joined)
    return index + int((values < -SYMMETRY * np.abs(chain.ends).max()).sum()) - m


def conjugate_times(trajectory: Trajectory) -> np.ndarray:
    """Times conjugate to the start, where ∂q(t)/∂p(0) is singular; each as often as its multiplicity."""
    chain = _chain(trajectory)
    times = []
    for k in np.flatnonzero(chain.found):
        for which in range(1, chain.found[k] + 1):
            times.append(trajectory.t[k] + _located(trajectory, int(k), chain.left[k], chain.unit, which))
    return np.array(times)


@dataclass(frozen=True, eq=False)
class Chain:
    """The second variation, node after node eliminated.

    Attributes
    ----------
    found : ndarray of int (N,)
        Conjugate times within each step.
    left : ndarray (N, P, P)
        At the start of each step: second derivatives of the action so far by the position there.
    ends : ndarray (2P, 2P)
        Second derivatives of the whole action by the positions (and multipliers) of the two ends.
    unit : ndarray (P,)
        Scale of coordinates and multipliers, the same for all nodes.
    """

    found: np.ndarray
    left: np.ndarray
    ends: np.ndarray
    unit: np.ndarray


def _chain(trajectory: Trajectory) -> Chain:
    remembered = trajectory.__dict__.get("_second_variation")
    if remembered is None:
        remembered = trajectory.__dict__["_second_variation"] = _eliminated(trajectory)
    return remembered


def _eliminated(trajectory: Trajectory) -> Chain:
    system, rule = trajectory.system, trajectory.rule
    _has_action(trajectory)
    steps, h = len(trajectory) - 1, trajectory.h
    paths = _paths(trajectory, np.arange(steps), np.full(steps, h), np.arange(1, steps + 1))
    n, m = system.structure.n, system.structure.constraints
    unit = _unit(paths, n, m)
    negative, two = _condensed(paths, unit)
    size = n + m
    left, found = np.zeros((steps, size, size)), negative - _ordinary(system, rule, inner=True)
    whole = two[0]
    for k in range(1, steps):
        left[k] = whole[size:, size:]
        pivots, inverse = _inverted(left[k] + two[k, :size, :size])
        found[k] += pivots - m
        side = np.concatenate([whole[:size, size:], two[k, size:, :size]])
        joined = np.zeros((2 * size, 2 * size))
        joined[:size, :size], joined[size:, size:] = whole[:size, :size], two[k, size:, size:]
        whole = joined - side @ inverse @ side.T
    scale = np.tile(unit, 2)
    return Chain(found, left, whole / np.outer(scale, scale), unit)


def _has_action(trajectory: Trajectory) -> None:
    """Refuse trajectories that have no second variation."""
    system = trajectory.system
    if system.structure.forced:
        raise InputError("the scene has forces: its paths make no action stationary, so they have no second variation")
    if system.structure.degenerate or system.structure.nonholonomic or system.structure.contacts:
        raise InputError("only regular scenes without non-holonomic rows and contacts have a second variation")
    if len(trajectory) < 2 or (np.diff(trajectory.k) != 1).any() or abs(np.diff(trajectory.t) / trajectory.h - 1).max() > 1e-6:
        raise InputError("the second variation needs every step of the trajectory: save_every=1, no cut, no times of at()")
    mass = ca.Function("mass", [system.q, system.v, system.t, system.c], [ca.densify(system.mass_matrix)])
    if not system.structure.constraints:
        start = trajectory[0]
        if np.linalg.eigvalsh(np.array(mass(start.q, start.v, start.t, trajectory.c)))[0] < 0:
            raise InputError("the mass matrix is not positive: infinitely many variations lower the action")


def _ordinary(system: System, rule: Rule, inner: bool) -> int:
    """Negative eigenvalues that belong to the method: n for every backward drift of a composition, m an inner point."""
    s = system.structure
    if rule.points:
        return s.constraints * (rule.degree - 1)
    return s.n * sum(a < 0 for a in rule.drifts)


@per_system
def curvature_function(system: System, rule: Rule) -> ca.Function:
    """Arguments of `interval_rows` → (rows, ∂rows/∂(Q_j, λ_j)), symmetric where there are no forces."""
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


def _paths(trajectory: Trajectory, k: np.ndarray, size: np.ndarray, ends: np.ndarray | None) -> np.ndarray:
    """Curvatures (B, L, L) of the paths that leave the nodes k and last for the times `size`.

    `ends` are the nodes where they arrive, whose momenta give the last multipliers; None where these do not matter.
    """
    system, rule = trajectory.system, trajectory.rule
    kernel, tau = curvature_function(system, rule), point_times(rule)[1:]
    n, m, d, count = system.structure.n, system.structure.constraints, len(tau), len(k)
    block = n + m
    q, p, t, h = trajectory.q[k], trajectory.p[k], trajectory.t[k][:, None], size[:, None]
    v = over_columns(velocity_function(system), q, p, t, trajectory.c)[0]
    ahead, lam = (h * v)[:, None] * tau[:, None], np.zeros((count, d + 1, m))
    u = trajectory._step_controls(trajectory.k[k], size / trajectory.h)
    reach = np.abs(ahead).max(axis=(1, 2)) + np.finfo(float).tiny
    target = np.zeros((count, (d + 1) * block))
    target[:, :n] = -p
    y = np.array([j * block + i for j in range(d + 1) for i in range(block) if (j > 0 if i < n else j < d)])
    rows = np.array([j * block + i for j in range(d + 1) for i in range(block) if (j < d if i < n else j > 0)])
    polish = False
    for _ in range(MOST_ITERATIONS):
        flat = ahead.reshape(count, -1), lam.reshape(count, -1)
        values, slopes = over_columns(kernel, q, *flat, u, trajectory.c, t, h)
        slopes = slopes.reshape(count, (d + 1) * block, -1).transpose(0, 2, 1)
        if polish:
            break
        change = np.zeros((count, (d + 1) * block))
        change[:, y] = -np.linalg.solve(slopes[:, rows][:, :, y], (values - target)[:, rows, None])[..., 0]
        change = change.reshape(count, d + 1, block)
        ahead, lam = ahead + change[:, 1:, :n], lam + change[:, :, n:]
        polish = bool((np.abs(change[:, :, :n]).max(axis=(1, 2)) <= LAST_CORRECTION * reach).all())
    if not polish or not np.isfinite(slopes).all():
        raise InputError("the steps are too long for the second variation; use more steps")
    if m and ends is not None:
        push, gained = slopes[:, -block:-m, -m:], trajectory.p[ends] - values[:, -block:-m]
        lam[:, -1] = (np.linalg.pinv(push) @ gained[..., None])[..., 0]
        slopes = over_columns(kernel, q, ahead.reshape(count, -1), lam.reshape(count, -1), u, trajectory.c, t, h)[1]
        slopes = slopes.reshape(count, (d + 1) * block, -1)
    return (slopes + slopes.transpose(0, 2, 1)) / 2


def _unit(paths: np.ndarray, n: int, m: int) -> np.ndarray:
    """Scale of a node's unknowns that makes constraint rows as large as the stiffness of coordinates."""
    corner = np.abs(paths[:, : n + m, : n + m]).max(axis=0)
    size = corner[:n, :n].max()
    rows = corner[n:, :n].max(axis=1) if m else np.zeros(0)
    return np.concatenate([np.ones(n), size / np.where(rows > 0, rows, size)])


def _condensed(paths: np.ndarray, unit: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Number of negative eigenvalues of the inner points (B,), and the curvature of the two ends (B, 2P, 2P)."""
    size = len(unit)
    scale = np.tile(unit, paths.shape[1] // size)
    scaled = paths * scale[:, None] * scale
    ends = np.r_[:size, paths.shape[1] - size : paths.shape[1]]
    inner = slice(size, paths.shape[1] - size)
    outside = scaled[:, ends[:, None], ends]
    if paths.shape[1] == 2 * size:
        return np.zeros(len(paths), dtype=int), outside
    block, side = scaled[:, inner, inner], scaled[:, inner][:, :, ends]
    negative = (np.linalg.eigvalsh(block) < 0).sum(axis=1)
    return negative, outside - side.transpose(0, 2, 1) @ np.linalg.solve(block, side)


def _inverted(pivot: np.ndarray) -> tuple[int, np.ndarray]:
    """Number of negative eigenvalues and the inverse, with vanishing eigenvalues replaced by tiny ones."""
    values, vectors = np.linalg.eigh(pivot)
    floor = SMALLEST_PIVOT * np.abs(values).max()
    values = np.where(np.abs(values) < floor, np.where(values < 0, -floor, floor), values)
    return int((values < 0).sum()), (vectors / values) @ vectors.T


def _located(trajectory: Trajectory, k: int, left: np.ndarray, unit: np.ndarray, which: int) -> float:
    """Time after node k at which the `which`-th conjugate point of that step is passed."""
    system, size = trajectory.system, len(unit)
    m, ordinary = system.structure.constraints, _ordinary(system, trajectory.rule, inner=True)
    low, high = 0.0, trajectory.h
    while high - low > LOCATED * trajectory.h:
        trial = np.linspace(low, high, PARTS + 1)[1:-1]
        paths = _paths(trajectory, np.full(len(trial), k), trial, None)
        negative, two = _condensed(paths, unit)
        found = negative - ordinary
        if k:
            found = found + (np.linalg.eigvalsh(left + two[:, :size, :size]) < 0).sum(axis=1) - m
        passed = np.flatnonzero(found >= which)
        high, low = (
            (trial[passed[0]], trial[passed[0] - 1] if passed[0] else low) if len(passed) else (high, trial[-1])
        )
        if not trial[-1] > trial[0]:
            break
    return (low + high) / 2

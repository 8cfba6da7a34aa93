"""Second variation of the action along a trajectory: Morse index and conjugate times.

The second variation is block-tridiagonal in the nodes. Eliminating inner control points and then
node after node, the number of negative pivots up to a node is the index of the path that ends there
(Sylvester's law of inertia); it grows by one at every time conjugate to the start (Morse's index
theorem; Milnor, Morse Theory, §15). With constraints the pivots are saddle-point matrices: each
constraint brings one negative eigenvalue that is not counted.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from varint.boundary.recovered import interval_paths, require_every_step, step_sizes
from varint.errors import InputError
from varint.results.records import require_motion
from varint.results.trajectory import Trajectory
from varint.rules.rule import Rule
from varint.scene.system import System

# relative; a node conjugate to the start to round-off counts with the next one
SMALLEST_PIVOT = 1e-10
# relative; eigenvalues of closed paths this small belong to shifts and turns of the whole path
SYMMETRY = 1e-7
PARTS = 32  # of an interval of time in one round of the search for a conjugate time
LOCATED = 1e-13  # relative to the step


def morse_index(trajectory: Trajectory) -> int:
    """Number of independent variations, ends kept, that lower the action of the path to second
    order.

    Closed paths (`Trajectory.closure`) vary among closed paths; directions along families of such
    paths do not count.
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
    """Times conjugate to the start, where ∂q(t)/∂p(0) is singular; each as often as its
    multiplicity.
    """
    chain = _chain(trajectory)
    times = []
    for k in np.flatnonzero(chain.found):
        for which in range(1, chain.found[k] + 1):
            times.append(
                trajectory.t[k] + _locate(trajectory, int(k), chain.left[k], chain.unit, which)
            )
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
        remembered = trajectory.__dict__["_second_variation"] = _eliminate(trajectory)
    return remembered


def _eliminate(trajectory: Trajectory) -> Chain:
    system, rule = trajectory.system, trajectory.rule
    _has_action(trajectory)
    steps = len(trajectory) - 1
    paths = _curvatures(
        trajectory, np.arange(steps), step_sizes(trajectory), np.arange(1, steps + 1)
    )
    n, m = system.structure.n, system.structure.constraints
    unit = _unit(paths, n, m)
    negative, two = _condense(paths, unit)
    size = n + m
    left, found = np.zeros((steps, size, size)), negative - _ordinary(system, rule)
    whole = two[0]
    for k in range(1, steps):
        left[k] = whole[size:, size:]
        pivots, inverse = _invert(left[k] + two[k, :size, :size])
        found[k] += pivots - m
        side = np.concatenate([whole[:size, size:], two[k, size:, :size]])
        joined = np.zeros((2 * size, 2 * size))
        joined[:size, :size], joined[size:, size:] = whole[:size, :size], two[k, size:, size:]
        whole = joined - side @ inverse @ side.T
    scale = np.tile(unit, 2)
    return Chain(found, left, whole / np.outer(scale, scale), unit)


def _curvatures(
    trajectory: Trajectory, k: np.ndarray, size: np.ndarray, ends: np.ndarray | None
) -> np.ndarray:
    """Second derivatives of the actions of the paths that leave the nodes k; of a motion backwards
    in time those of the path forwards, whose action has the other sign.
    """
    return interval_paths(trajectory, k, size, ends).curvature * np.sign(trajectory.h)


def _has_action(trajectory: Trajectory) -> None:
    """Refuse trajectories that have no second variation."""
    system = trajectory.system
    if system.structure.forced:
        raise InputError(
            "the scene has forces: its paths make no action stationary, so they have no second "
            "variation"
        )
    if system.structure.degenerate or system.structure.nonholonomic or system.structure.contacts:
        raise InputError(
            "only regular scenes without non-holonomic rows and contacts have a second variation"
        )
    require_every_step(trajectory)
    require_motion(trajectory, "it is least among the paths within them, and has no index")
    mass = ca.Function(
        "mass", [system.q, system.v, system.t, system.c], [ca.densify(system.mass_matrix)]
    )
    if not system.structure.constraints:
        start = trajectory[0]
        if np.linalg.eigvalsh(np.array(mass(start.q, start.v, start.t, trajectory.c)))[0] < 0:
            raise InputError(
                "the mass matrix is not positive: infinitely many variations lower the action"
            )


def _ordinary(system: System, rule: Rule) -> int:
    """Negative eigenvalues that belong to the method: n for every backward drift of a
    composition, m an inner point.
    """
    s = system.structure
    if rule.points:
        return s.constraints * (rule.degree - 1)
    return s.n * sum(a < 0 for a in rule.drifts)


def _unit(paths: np.ndarray, n: int, m: int) -> np.ndarray:
    """Scale of a node's unknowns that makes constraint rows as large as the stiffness of
    coordinates.
    """
    corner = np.abs(paths[:, : n + m, : n + m]).max(axis=0)
    size = corner[:n, :n].max()
    rows = corner[n:, :n].max(axis=1) if m else np.zeros(0)
    return np.concatenate([np.ones(n), size / np.where(rows > 0, rows, size)])


def _condense(paths: np.ndarray, unit: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Number of negative eigenvalues of the inner points (B,), and the curvature of the two ends
    (B, 2P, 2P).
    """
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


def _invert(pivot: np.ndarray) -> tuple[int, np.ndarray]:
    """Number of negative eigenvalues and the inverse, with vanishing eigenvalues replaced by
    tiny ones.
    """
    values, vectors = np.linalg.eigh(pivot)
    floor = SMALLEST_PIVOT * np.abs(values).max()
    values = np.where(np.abs(values) < floor, np.where(values < 0, -floor, floor), values)
    return int((values < 0).sum()), (vectors / values) @ vectors.T


def _locate(
    trajectory: Trajectory, k: int, left: np.ndarray, unit: np.ndarray, which: int
) -> float:
    """Time after node k at which the `which`-th conjugate point of that step is passed."""
    system, size = trajectory.system, len(unit)
    m, ordinary = system.structure.constraints, _ordinary(system, trajectory.rule)
    low, high = 0.0, float(step_sizes(trajectory)[k])
    smallest = LOCATED * abs(high)
    while abs(high - low) > smallest:
        trial = np.linspace(low, high, PARTS + 1)[1:-1]
        paths = _curvatures(trajectory, np.full(len(trial), k), trial, None)
        negative, two = _condense(paths, unit)
        found = negative - ordinary
        if k:
            found = found + (np.linalg.eigvalsh(left + two[:, :size, :size]) < 0).sum(axis=1) - m
        passed = np.flatnonzero(found >= which)
        high, low = (
            (trial[passed[0]], trial[passed[0] - 1] if passed[0] else low)
            if len(passed)
            else (high, trial[-1])
        )
        if trial[-1] == trial[0]:
            break
    return (low + high) / 2

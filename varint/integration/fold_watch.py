"""Nodes on a fold: where constraint rows lose their rank the motion is not determined.

A linkage that folds passes through a configuration in which its rows are dependent. A step over it
goes on as before. A node on it does not: there positions are known to the square root of round-off
alone, the multipliers have no bound, and the run would go on with any energy, on any branch. So it
is with a node within a step, or with one that is not saved (`fold_crossing`).
"""

from __future__ import annotations

from collections.abc import Iterator

import casadi as ca
import numpy as np

from varint.discrete.constraints import velocity_rows
from varint.discrete.row_independence import pivot_function
from varint.errors import StepRefused
from varint.integration.fold_crossing import KEPT, Nodes, joined, leaps_over_folds
from varint.integration.problem import InitialValueProblem
from varint.integration.row_watch import BlocksFrom
from varint.integration.state import NodeBlock, RunState
from varint.numerics.arrays import call, over_columns
from varint.results.trajectory import Trajectory
from varint.rules.rule import Rule
from varint.scene.system import System, per_scene

# of the largest distance of a row from the others during the run: nearer ones have energies off by
# 1e-6 to 10 of the kinetic energy, those that are farther none (four-bar linkages, all rules)
ON_FOLD = 1e-6
# of the row's gradient at the node before: where a constraint's curve crosses itself or ends
VANISHED = 1e-6
MARGIN = (
    10.0  # times this: farther nodes that a compiled loop has looked at are not looked at again
)
CROSSED = 0.2  # of the largest distance of a row: where no node is nearer no fold is crossed
FEW = 10  # nodes that are always looked at
SAMPLES = 33  # between two nodes, or of a motion
NEARER = 0.2  # of the usual smallest singular value: a fold is near
TIED = 0.1  # of the largest part in the dependence: rows that are named


def with_folds_watched(
    blocks_from: BlocksFrom, scene: System, rule: Rule, problem: InitialValueProblem
) -> BlocksFrom:
    """The blocks of a run, up to the first node at which the constraint rows lose their rank, or
    between which a fold was met by a node that is not saved.

    Raises
    ------
    StepRefused
        While the blocks come: a node lies on a fold.
    """

    def watched(at: RunState | None) -> Iterator[NodeBlock]:
        q, k = (problem.q0, problem.first) if at is None else (at.x[: len(problem.q0)], at.k)
        far, size = _independence(
            scene, problem, np.stack([problem.q0, q]), np.array([problem.first, k])
        )
        most, before = far.max(), size[1:]
        recent: Nodes | None = None
        for block in blocks_from(at):
            told = block.independence if block.good > FEW else None
            if told is not None and _are_far(told, most):
                most, last = max(most, told[1] ** 0.5), slice(block.good - 1, block.good)
                before = _independence(scene, problem, block.q[last], block.k[last])[1]
                recent = None
            elif block.good:
                nodes = tuple(x[: block.good] for x in (block.q, block.p, block.k))
                far, size = _independence(scene, problem, nodes[0], nodes[2])
                largest = np.maximum.accumulate(np.maximum(far, most))
                sizes = np.concatenate([before, size])
                folded = far < ON_FOLD * largest
                vanished = (sizes[1:] < VANISHED * sizes[:-1]).any(axis=1)
                lost = np.flatnonzero(folded | vanished)
                if len(lost):
                    yield from _up_to(block, int(lost[0]))
                    node = int(lost[0])
                    raise StepRefused(_why(scene, problem, block.q[node], int(block.k[node])))
                known = 0 if recent is None else len(recent[0])
                recent = joined(recent, (*nodes, far))
                leaps = leaps_over_folds(scene, rule, problem, recent)
                if len(leaps):
                    j = int(leaps[0])
                    yield from _up_to(block, max(j + 1 - known, 0))
                    raise StepRefused(_why_beyond(problem, tuple(x[j : j + 2] for x in recent)))
                most, before = largest[-1], size[-1:]
                recent = tuple(x[-KEPT:] for x in recent)
            yield block

    return watched


def _up_to(block: NodeBlock, good: int) -> Iterator[NodeBlock]:
    """The first nodes of a block, where there are any."""
    if good:
        yield block._replace(
            k=block.k[:good],
            q=block.q[:good],
            p=block.p[:good],
            good=good,
            after=None,
            counts=None,
        )


def _are_far(told: tuple[float, float, float], most: float) -> bool:
    """Whether what the compiled loop has seen of its nodes tells that none is near a fold."""
    nearest, farthest, shrunk = told
    near = CROSSED * max(most, farthest**0.5)
    return nearest > near**2 and shrunk > MARGIN * VANISHED


def _independence(
    scene: System, problem: InitialValueProblem, q: np.ndarray, k: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """At each node: the smallest distance of a row from those before it, of rows scaled to length
    one, and the rows' lengths.
    """
    t = problem.t0 + problem.h * k[:, None]
    pivot, size = over_columns(pivot_function(scene), np.ascontiguousarray(q), t, problem.c)
    return np.sqrt(np.maximum(pivot[:, 0], 0)), size


@per_scene
def _rows_function(system: System) -> ca.Function:
    """(q, t, c) → the gradients of all rows."""
    s = system
    slope = ca.densify(ca.jacobian(velocity_rows(s), s.v))
    return ca.Function("fold_rows", [s.q, s.t, s.c], [slope])


def rows_of_fold(motion: Trajectory, a: int, b: int) -> tuple[int, ...]:
    """The rows that are nearly dependent somewhere between two nodes of a motion, as far as
    straight lines between its nodes tell; none where the rows are as independent as elsewhere.
    """
    nodes = np.arange(a, b + 1)
    at = np.linspace(a, b, SAMPLES)
    q = np.stack([np.interp(at, nodes, x) for x in motion.q[nodes].T], axis=1)
    left, values = _directions(motion, q, np.interp(at, nodes, motion.t[nodes]))
    some = np.unique(np.linspace(0, len(motion) - 1, SAMPLES).astype(int))
    elsewhere = _directions(motion, motion.q[some], motion.t[some])[1]
    worst = int(np.argmin(values[:, -1]))
    if not values[worst, -1] < NEARER * np.median(elsewhere[:, -1]):
        return ()
    part = np.abs(left[worst, :, -1])
    return tuple(np.flatnonzero(part > TIED * part.max()).tolist())


def _directions(motion: Trajectory, q: np.ndarray, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Left singular vectors and singular values of the rows scaled to length one."""
    flat = over_columns(_rows_function(motion.system), q, t[:, None], motion.c)[0]
    rows = flat.reshape(len(q), q.shape[1], -1).transpose(0, 2, 1)
    size = np.linalg.norm(rows, axis=2, keepdims=True)
    left, values, _ = np.linalg.svd(rows / np.where(size > 0, size, 1))
    return left, values


def _why_beyond(problem: InitialValueProblem, ends: Nodes) -> str:
    """Between which nodes the motion is not determined, and what to do."""
    q, _, k, far = ends
    begin, end = (problem.t0 + problem.h * k).tolist()
    where = ", ".join(f"{x:.6g}" for x in q[np.argmin(far)])
    return (
        f"between t = {begin:.6g} and t = {end:.6g} (steps {k[0]} to {k[1]}) the motion goes over "
        f"a fold near q = [{where}], where the gradients of constraint rows are dependent, and a "
        "node of a step, one within it or one that is not saved, lies on it: other steps lead "
        "elsewhere, and neither the branch nor the energy of the motion beyond is determined; "
        "change h or the start a little"
    )


def _why(scene: System, problem: InitialValueProblem, q: np.ndarray, k: int) -> str:
    """Which rows are dependent at the node after k steps, where, and what to do."""
    t = problem.t0 + problem.h * k
    flat = call(_rows_function(scene), q.copy(), np.array([t]), problem.c)[0]
    slope = flat.reshape(len(q), -1).T
    size = np.linalg.norm(slope, axis=1, keepdims=True)
    left = np.linalg.svd(slope / np.where(size > 0, size, 1))[0]
    flat_rows = size[:, 0] <= VANISHED * size.max()
    part = np.where(flat_rows.any(), flat_rows, np.abs(left[:, -1]))
    tied = np.flatnonzero(part > TIED * part.max()).tolist()
    where = ", ".join(f"{x:.6g}" for x in q)
    return (
        f"the node at t = {t:.6g} (step {k}) lies on a fold, q = [{where}]: the gradients of the "
        f"constraint rows {tied} are dependent or vanish there, as where a linkage is folded flat "
        "or a curve crosses itself, and neither the branch nor the energy of the motion beyond is "
        "determined; change h or the start a little, so that a step passes over the fold"
    )

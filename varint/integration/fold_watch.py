"""Nodes on a fold: where constraint rows lose their rank the motion is not determined.

A linkage that folds passes through a configuration in which its rows are dependent. A step over it
goes on as before. A node on it does not: there positions are known to the square root of round-off
alone, the multipliers have no bound, and the run would go on with any energy, on any branch. So it
is with a node within a step (`fold_crossing`). Every step is looked at, saved or not: by compiled
loops themselves, which note folds, or here.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, NamedTuple

import casadi as ca
import numpy as np

from varint.discrete.constraints import velocity_rows
from varint.discrete.row_independence import FOLDED, VANISHED, pivot_function
from varint.errors import StepRefused
from varint.integration.fold_crossing import (
    OVER,
    WIDE,
    Windows,
    are_leaps,
    crossed_folds,
    windows_around,
)
from varint.integration.many_steps import steps_of
from varint.integration.problem import InitialValueProblem
from varint.integration.row_watch import BlocksFrom
from varint.integration.state import NodeBlock, Passed, RunState
from varint.integration.steppers.stepper import state_layout
from varint.numerics.arrays import call, median, over_columns
from varint.results.trajectory import Trajectory
from varint.rules.rule import Rule
from varint.scene.memory import per_scene
from varint.scene.system import System

if TYPE_CHECKING:
    from varint.codegen.kernel import Kernel

KEPT = 5  # nodes before a block that tell of folds at its beginning
SAMPLES = 33  # between two nodes, or of a motion
NEARER = 0.2  # of the usual smallest singular value: a fold is near
TIED = 0.1  # of the largest part in the dependence: rows that are named
ON_FOLD = 1  # the kind of a note of c/folds.h, which is a window

# steps over folds, and the number and place of a node on one
Found = tuple[Windows, tuple[int, np.ndarray] | None]


def with_folds_watched(
    blocks_from: BlocksFrom,
    scene: System,
    rule: Rule,
    problem: InitialValueProblem,
    kernel: Kernel | None,
) -> BlocksFrom:
    """The blocks of a run, up to the first node, saved or not, at which the constraint rows lose
    their rank, or the first step of which a node within does.

    Raises
    ------
    StepRefused
        While the blocks come: a node lies on a fold.
    """
    steps = steps_of(scene, rule, kernel, problem.c)

    def look(windows: Windows, lost: tuple[int, np.ndarray] | None) -> tuple[int, str] | None:
        """The step after which nodes are no good, and why."""
        some = windows if lost is None else windows.at(windows.k[:, OVER + 1] < lost[0])
        if len(some.k):
            leaps = np.flatnonzero(are_leaps(steps, rule, problem, some))
            if len(leaps):
                first = some.at(leaps[:1])
                return int(first.k[0, OVER]), _why_beyond(problem, first)
        return lost and (lost[0] - 1, _why(scene, problem, lost[1], lost[0]))

    def watched(at: RunState | None) -> Iterator[NodeBlock]:
        recent, most = None, 0.0
        for block in blocks_from(at):
            passed = block.passed
            if passed is None or not len(passed.k):
                yield block
                continue
            seen, found = _seen(scene, problem, passed), None
            if passed.notes is None:
                before = recent or _seen(scene, problem, _start(problem, at))
                seen = _joined(before, seen)
                found = _noted(seen, len(seen.nodes.k) - len(passed.k), most)
                most = float(np.fmax.reduce(seen.nodes.far, initial=most))
            elif len(passed.notes):
                found = _as_noted(passed, scene)
            wrong = found and look(*found)
            if wrong:
                yield from _up_to(block, int((block.k[: block.good] <= wrong[0]).sum()))
                raise StepRefused(wrong[1], wrong[0])
            recent = seen.last(KEPT)
            yield block
        behind = _behind(recent) if recent else None
        if behind and (wrong := look(behind, None)):
            raise StepRefused(wrong[1], wrong[0])

    return watched


class _Seen(NamedTuple):
    """Successive nodes (nodes, …), and the lengths of the rows there."""

    nodes: Windows
    size: np.ndarray

    def last(self, count: int) -> _Seen:
        """The last of them."""
        return _Seen(self.nodes.at(slice(-count, None)), self.size[-count:])


def _start(problem: InitialValueProblem, at: RunState | None) -> Passed:
    """The node from which a run goes on."""
    if at is None:
        return Passed(np.array([problem.first]), problem.q0[None], problem.p0[None])
    n = len(problem.q0)
    layout = state_layout(n)
    q, p = (at.x[:n], at.x[n:]) if len(at.x) == 2 * n else (at.x[layout.q], at.x[layout.p])
    return Passed(np.array([at.k]), q[None].copy(), p[None].copy())


def _seen(scene: System, problem: InitialValueProblem, passed: Passed) -> _Seen:
    """Nodes with the smallest distance of a row from those before it, of rows scaled to length
    one, and the rows' lengths.
    """
    t = problem.t0 + problem.h * passed.k[:, None]
    q = np.ascontiguousarray(passed.q)
    pivot, size = over_columns(pivot_function(scene), q, t, problem.c)
    far = np.sqrt(np.maximum(pivot[:, 0], 0))
    return _Seen(Windows(passed.k, passed.q, passed.p, far), size)


def _joined(before: _Seen, after: _Seen) -> _Seen:
    """Nodes after those kept from before, where they follow on them."""
    if before.nodes.k[-1] + 1 != after.nodes.k[0]:
        return after
    nodes = Windows(*(np.concatenate(x) for x in zip(before.nodes, after.nodes, strict=True)))
    return _Seen(nodes, np.concatenate([before.size, after.size]))


def _noted(seen: _Seen, known: int, most: float) -> Found:
    """The steps over folds that the nodes beyond the first `known` ones show, and the first of
    these nodes that lies on a fold.
    """
    nodes, size = seen
    largest = np.maximum(np.fmax.accumulate(nodes.far), most)
    lost = ~(nodes.far >= FOLDED * largest)
    lost[1:] |= (size[1:] < VANISHED * size[:-1]).any(axis=1)
    lost[:known] = False
    over = crossed_folds(nodes.far)
    over = over[(over + OVER + 1 >= known) & (over + OVER + 1 < len(nodes.k))]
    first = np.flatnonzero(lost)[:1]
    at = (int(nodes.k[first[0]]), nodes.q[first[0]]) if len(first) else None
    return windows_around(over, nodes), at


def _as_noted(passed: Passed, scene: System) -> Found:
    """The same from the notes of a compiled loop, see c/folds.h."""
    n, notes = scene.structure.n, passed.notes
    assert notes is not None
    nodes = notes[:, 1:].reshape(len(notes), WIDE, notes.shape[1] // WIDE)
    k, pivot, q, p, _ = np.split(nodes, [1, 2, 2 + n, 2 + 2 * n], axis=2)
    far = np.where(pivot < 0, -1.0, np.sqrt(np.abs(pivot)))
    windows = Windows(k[..., 0].astype(int), q, p, far[..., 0])
    lost = np.flatnonzero(notes[:, 0] == ON_FOLD)
    at = (int(windows.k[lost[0], -1]), windows.q[lost[0], -1].copy()) if len(lost) else None
    return windows.at(notes[:, 0] != ON_FOLD), at


def _behind(recent: _Seen) -> Windows | None:
    """Windows of steps over folds at the very end of a run, which have no nodes behind them; None
    where there are none.
    """
    over = crossed_folds(recent.nodes.far)
    over = over[over + OVER + 1 >= len(recent.nodes.k)]
    return windows_around(over, recent.nodes) if len(over) else None


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
    if not values[worst, -1] < NEARER * median(elsewhere[:, -1]):
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


def _why_beyond(problem: InitialValueProblem, first: Windows) -> str:
    """Between which nodes the motion is not determined, and what to do."""
    ends = slice(OVER, OVER + 2)
    k, q, far = first.k[0, ends], first.q[0, ends], first.far[0, ends]
    begin, end = (problem.t0 + problem.h * k).tolist()
    nearest = int(np.argmin(np.where(far >= 0, far, np.inf)))
    where = ", ".join(f"{x:.6g}" for x in q[nearest])
    return (
        f"between t = {begin:.6g} and t = {end:.6g} (steps {k[0]} to {k[1]}) the motion goes over "
        f"a fold near q = [{where}], where the gradients of constraint rows are dependent, and a "
        "node within the step lies on it: other steps lead elsewhere, and neither the branch nor "
        "the energy of the motion beyond is determined; change h or the start a little"
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

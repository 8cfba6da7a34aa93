"""A run cut into pieces with all their nodes: as they were kept, or run once more between those
that were.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from varint.discrete.legendre import velocity_function
from varint.errors import ConvergenceError, InputError
from varint.integration.backend import blocks_of, kernel_for
from varint.integration.problem import InitialValueProblem
from varint.numerics.arrays import over_columns
from varint.results.dense_output import step_controls
from varint.results.trajectory import Trajectory
from varint.rules.rule import Rule
from varint.scene.system import System

if TYPE_CHECKING:
    from varint.codegen.kernel import Kernel

LONGEST_PIECE = 100_000  # steps: what stands in memory beside the run is bounded
OFF_GRID = 1e-6  # of a step: what lies further from the end of one lies within it
SHORTEST_RUN = 1_000  # steps that are run once more at a time, where fewer were left out


class Piece(NamedTuple):
    """Some steps of a run and the nodes between them.

    Attributes
    ----------
    node : int
        Index of the kept node at which it begins; `last` that at which it ends.
    first : int
        Steps from the start of the run to the first of these.
    x : ndarray (S + 1, 2n)
        (q, p) at every node.
    v : ndarray (S + 1, n)
        Velocities there.
    t, h : ndarray (S,)
        Time at the beginning of every step, and its size.
    u : ndarray (S, nodes, k)
        Controls at the rule's nodes.
    kept : ndarray of int
        Places in x of the nodes that were kept, the first included.
    """

    node: int
    last: int
    first: int
    x: np.ndarray
    v: np.ndarray
    t: np.ndarray
    h: np.ndarray
    u: np.ndarray
    kept: np.ndarray


def scene_of(motion: Trajectory) -> System:
    """The scene whose steps the run took; of a scene with contacts that itself.

    Raises
    ------
    InputError
        If the run has no step, or its Lagrangian is of first order.
    """
    if motion.system.structure.degenerate:
        raise InputError(
            "the Lagrangian is of first order in the velocities: its momenta are functions of q "
            "and cannot be varied on their own"
        )
    if len(motion) < 2:
        raise InputError("the run has no step to differentiate")
    sets = motion.active_sets
    if motion.system.structure.contacts or not sets:
        return motion.system
    return sets[0].scene(motion.system)


def pieces(
    motion: Trajectory, first: int = 0, last: int | None = None, *, backwards: bool = False
) -> Iterator[Piece]:
    """The steps from the kept node `first` to the kept node `last`, piece by piece.

    Where nodes were left out (`save_every`) the steps between are taken once more from the kept
    node before them: with nodes kept every √N steps, 2√N states stand in memory at a time.
    """
    last = len(motion) - 1 if last is None else last
    scene = scene_of(motion)
    ends = list(_cuts(motion, first, last))
    for a, b in reversed(ends) if backwards else ends:
        yield piece_between(motion, scene, a, b, int(motion.k[a] - motion.k[first]))


def _cuts(motion: Trajectory, first: int, last: int) -> Iterator[tuple[int, int]]:
    """Kept nodes between which pieces lie."""
    k = motion.k
    whole = bool((np.diff(k[first : last + 1]) == 1).all())
    longest = LONGEST_PIECE if whole else SHORTEST_RUN
    while first < last:
        following = int(np.searchsorted(k, k[first] + longest, side="right")) - 1
        following = min(max(following, first + 1), last)
        yield first, following
        first = following


def piece_between(motion: Trajectory, scene: System, a: int, b: int, first: int) -> Piece:
    """The steps between two kept nodes at whole steps; `first` of them from the start."""
    k0, k1 = int(motion.k[a]), int(motion.k[b])
    steps = np.arange(k0, k1)
    kept = motion.k[a : b + 1] - k0
    if len(kept) == k1 - k0 + 1:
        x = np.hstack([motion.q[a : b + 1], motion.p[a : b + 1]])
        v, t = motion.v[a : b + 1], motion.t[a:b]
    else:
        x, v, t = run_once_more(motion, scene, a, k0, k1)
    h = np.full(k1 - k0, motion.h) if motion.sizes is None else motion.sizes[k0:k1]
    u = step_controls(motion, steps, np.ones(len(steps)))
    nodes, controls = len(motion.rule.nodes), motion.system.structure.controls
    x, v, t, h = (np.ascontiguousarray(y, dtype=float) for y in (x, v, t, h))
    return Piece(a, b, first, x, v, t, h, u.reshape(k1 - k0, nodes, controls), kept)


def run_once_more(
    motion: Trajectory, scene: System, a: int, k0: int, k1: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """All nodes from step k0 to step k1, by the same steps from the kept node."""
    if motion.sizes is not None:
        raise InputError(
            "steps of this run differ in size and not every one was kept: run it with save_every=1"
        )
    start = float(motion.t[a] - k0 * motion.h)
    problem = InitialValueProblem(
        motion.q[a],
        motion.p[a],
        start,
        motion.h,
        k1,
        1,
        motion.u,
        motion.c,
        len(motion.rule.nodes),
        motion.active_sets[0] if motion.active_sets else None,
        first=k0,
    )
    kernel = kernel_for(scene, motion.rule, problem._replace(steps=int(motion.k[-1])), "auto")
    x = all_nodes(scene, motion.rule, problem, kernel)
    t = start + motion.h * np.arange(k0, k1)
    return x, velocities(scene, x, start + motion.h * np.arange(k0, k1 + 1), motion.c), t


def velocities(scene: System, x: np.ndarray, t: np.ndarray, c: np.ndarray) -> np.ndarray:
    """v at many states (q, p) and times, (N, n)."""
    n = x.shape[1] // 2
    return over_columns(velocity_function(scene), x[:, :n], x[:, n:], t[:, None], c)[0]


def all_nodes(
    scene: System, rule: Rule, problem: InitialValueProblem, kernel: Kernel | None
) -> np.ndarray:
    """(q, p) at every node of a run, the first included, (steps + 1, 2n).

    Raises
    ------
    ConvergenceError
        If a step cannot be solved.
    """
    parts = [np.hstack([problem.q0, problem.p0])[None]]
    for block in blocks_of(scene, rule, problem, kernel):
        parts.append(np.hstack([block.q[: block.good], block.p[: block.good]]))
        if block.good < len(block.q):
            break
    x = np.concatenate(parts)
    k = problem.first + len(x) - 1
    if k < problem.steps:
        raise ConvergenceError(
            f"step {k} of the run cannot be taken: try a smaller h",
            step=k,
            time=problem.t0 + k * problem.h,
            residual=float("nan"),
        )
    return x

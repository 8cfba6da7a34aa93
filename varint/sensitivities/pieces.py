"""A run cut into pieces with all their nodes: as they were kept, or run once more between those
that were.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from varint.discrete.legendre import velocity_function
from varint.errors import ConvergenceError, InputError
from varint.integration.backend import blocks_of, kernel_for, run_at_once
from varint.integration.problem import InitialValueProblem
from varint.numerics.arrays import over_columns
from varint.results.dense_output import step_controls
from varint.results.records import require_motion
from varint.results.trajectory import Trajectory
from varint.rules.rule import Rule
from varint.scene.system import System

if TYPE_CHECKING:
    from varint.codegen.kernel import Kernel

LONGEST_PIECE = 100_000  # steps: what stands in memory beside the run is bounded
OFF_GRID = 1e-6  # of a step: what lies further from the end of one lies within it
SHORTEST_RUN = 1_000  # steps that are run once more at a time


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
    require_motion(motion, "there it is no motion from its start, and has no derivatives by it")
    sets = motion.active_sets
    if motion.system.structure.contacts or not sets:
        return motion.system
    return sets[0].scene(motion.system)


def pieces(motion: Trajectory, first: int = 0, last: int | None = None) -> Iterator[Piece]:
    """The steps from the kept node `first` to the kept node `last`, piece by piece.

    Where nodes were left out (`save_every`) the steps between are taken once more from the kept
    node before them.
    """
    last = len(motion) - 1 if last is None else last
    scene, begin = scene_of(motion), int(motion.k[first])
    for a, b in cuts(motion, first, last, SHORTEST_RUN):
        yield from _between(motion, scene, a, b, begin)


def _between(motion: Trajectory, scene: System, a: int, b: int, begin: int) -> Iterator[Piece]:
    """The steps between two kept nodes, in pieces where they are many."""
    k0, k1 = int(motion.k[a]), int(motion.k[b])
    if b > a + 1 or k1 - k0 <= SHORTEST_RUN:
        yield piece_between(motion, scene, a, b, k0 - begin)
        return
    part = motion[a : a + 2]
    n = motion.q.shape[1]
    for k in range(k0, k1, SHORTEST_RUN):
        end = min(k + SHORTEST_RUN, k1)
        piece = piece_again(part, scene, 0, end, k - begin)
        yield piece._replace(node=a, last=b)
        at, q, p = np.array([end, k1]), part.q.copy(), part.p.copy()
        q[0], p[0] = piece.x[-1, :n], piece.x[-1, n:]
        part = replace(part, t=times_of(part, 0, at), q=q, p=p, k=at)


def cuts(motion: Trajectory, first: int, last: int, again: int) -> Iterator[tuple[int, int]]:
    """Kept nodes between which pieces lie; of what has to be run once more `again` steps at most
    where nodes lie that close.
    """
    k = motion.k
    whole = bool((np.diff(k[first : last + 1]) == 1).all())
    longest = LONGEST_PIECE if whole else again
    while first < last:
        following = int(np.searchsorted(k, k[first] + longest, side="right")) - 1
        following = min(max(following, first + 1), last)
        yield first, following
        first = following


def piece_between(motion: Trajectory, scene: System, a: int, b: int, first: int) -> Piece:
    """The steps between two kept nodes at whole steps; `first` of them from the start."""
    k0, k1 = int(motion.k[a]), int(motion.k[b])
    kept = motion.k[a : b + 1] - k0
    if len(kept) == k1 - k0 + 1:
        x = np.hstack([motion.q[a : b + 1], motion.p[a : b + 1]])
        v, t = motion.v[a : b + 1], motion.t[a:b]
    else:
        x, v, t = run_once_more(motion, scene, a, k0, k1)
    return _piece(motion, (a, b, first), k0, (x, v, t), kept)


def piece_again(motion: Trajectory, scene: System, a: int, k1: int, first: int) -> Piece:
    """The steps from a kept node to step k1, all of them taken once more."""
    k0 = int(motion.k[a])
    found = run_once_more(motion, scene, a, k0, k1)
    return _piece(motion, (a, a + 1, first), k0, found, np.array([0, k1 - k0]))


def _piece(
    motion: Trajectory,
    about: tuple[int, int, int],
    k0: int,
    found: tuple[np.ndarray, np.ndarray, np.ndarray],
    kept: np.ndarray,
) -> Piece:
    """From (q, p), v and times of the nodes; `about` are its nodes and its first step."""
    x, v, t = found
    k1 = k0 + len(t)
    steps = np.arange(k0, k1)
    h = np.full(k1 - k0, motion.h) if motion.sizes is None else motion.sizes[k0:k1]
    t, h = (np.ascontiguousarray(y, dtype=float) for y in (t, h))
    u = step_controls(motion, steps, np.ones(len(steps)))
    nodes, controls = len(motion.rule.nodes), motion.system.structure.controls
    return Piece(*about, x, v, t, h, u.reshape(k1 - k0, nodes, controls), kept)


def run_once_more(
    motion: Trajectory, scene: System, a: int, k0: int, k1: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """All nodes from step k0 to step k1, by the same steps from the kept node: (q, p), v, and the
    times of the steps.
    """
    problem, kernel = problem_again(motion, scene, a, k0, k1)
    found = None if kernel is None else run_at_once(scene, motion.rule, problem, kernel, False)
    if found is not None and len(found.rows) == k1 - k0 + 1:
        rows, end = found.rows.reshape(k1 - k0 + 1, -1), 2 * motion.q.shape[1]
        return rows[:, :end], rows[:, end:], times_of(motion, a, np.arange(k0, k1))
    x, told = nodes_with_velocities(scene, motion.rule, problem, kernel)
    t = times_of(motion, a, np.arange(k0, k1 + 1))
    if told is None:
        return x, velocities(scene, x, t, motion.c), t[:-1]
    begin = velocities(scene, x[:1], t[:1], motion.c)
    return x, np.concatenate([begin, told]), t[:-1]


def times_of(motion: Trajectory, a: int, k: np.ndarray) -> np.ndarray:
    """Times of whole steps, counted from that of a kept node."""
    return float(motion.t[a] - motion.k[a] * motion.h) + motion.h * k


def problem_again(
    motion: Trajectory, scene: System, a: int, k0: int, k1: int
) -> tuple[InitialValueProblem, Kernel | None]:
    """The problem of the steps from k0 to k1, and the loop that took them."""
    if motion.sizes is not None:
        raise InputError(
            "steps of this run differ in size and not every one was kept: run it without at= and "
            "save_every="
        )
    problem = InitialValueProblem(
        motion.q[a],
        motion.p[a],
        float(motion.t[a] - k0 * motion.h),
        motion.h,
        k1,
        1,
        motion.u,
        motion.c,
        len(motion.rule.nodes),
        motion.active_sets[0] if motion.active_sets else None,
        first=k0,
    )
    whole = problem._replace(steps=max(int(motion.k[-1]), k1))
    return problem, kernel_for(scene, motion.rule, whole, "auto")


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
    return np.concatenate([x for x, _ in _blocks(scene, rule, problem, kernel)])


def nodes_with_velocities(
    scene: System, rule: Rule, problem: InitialValueProblem, kernel: Kernel | None
) -> tuple[np.ndarray, np.ndarray | None]:
    """`all_nodes`, and v at all but the first, None where the loop does not tell it."""
    blocks = _blocks(scene, rule, problem, kernel)
    parts = [v for _, v in blocks[1:] if v is not None]
    told = len(parts) == len(blocks) - 1
    return np.concatenate([x for x, _ in blocks]), np.concatenate(parts) if told else None


def _blocks(
    scene: System, rule: Rule, problem: InitialValueProblem, kernel: Kernel | None
) -> list[tuple[np.ndarray, np.ndarray | None]]:
    """(q, p) and, where the loop tells them, v at every node, block by block after the first."""
    found: list[tuple[np.ndarray, np.ndarray | None]] = []
    found.append((np.hstack([problem.q0, problem.p0])[None], None))
    k = problem.first
    for block in blocks_of(scene, rule, problem, kernel):
        good = slice(block.good)
        v = None if block.v is None else block.v[good]
        found.append((np.hstack([block.q[good], block.p[good]]), v))
        k += block.good
        if block.good < len(block.q):
            break
    if k < problem.steps:
        raise cannot_go_on(problem, k)
    return found


def cannot_go_on(problem: InitialValueProblem, k: int) -> ConvergenceError:
    return ConvergenceError(
        f"step {k} of the run cannot be taken: try a smaller h",
        step=k,
        time=problem.t0 + k * problem.h,
        residual=float("nan"),
    )

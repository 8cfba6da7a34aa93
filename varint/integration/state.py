"""Where a run stands between two blocks of steps, and the nodes that a block makes."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from varint.discrete.constraints import ActiveSet
from varint.results.records import Event


class RunState(NamedTuple):
    """Where a run stands between two blocks: all that it needs to go on as if it had not stopped.

    The stepper's state x, typical sizes of v and p and the inertia between them, k steps taken, and
    how many nodes the next block may have (few after a failure). Of a compiled run: q and p as x,
    what its loop carries along, and whether Newton's method has taken over from fixed-point
    iteration. Of a run with contacts: when it is, what holds, and how many events there were in
    step k.
    """

    x: np.ndarray
    scale: np.ndarray
    inertia: np.ndarray
    k: int
    largest: int
    carry: np.ndarray | None = None
    by_newton: bool = False
    t: float | None = None
    active_set: ActiveSet | None = None
    events: int = 0


class Passed(NamedTuple):
    """Nodes that a block has passed, saved or not, for the watch of folds: all of its steps, or the
    last few of a compiled loop, with what that has noted (`LoopResult.notes`).
    """

    k: np.ndarray
    q: np.ndarray
    p: np.ndarray
    notes: np.ndarray | None = None


class NodeBlock(NamedTuple):
    """Some saved nodes: step counts k, coordinates, momenta.

    The first `good` of them are solved, with `residual` the worst among them; `failed` is that of
    the next one. Scenes with contacts also say when the nodes are (`t`), what holds from there on
    (`active_set`) and what happened before them. `iterations` are those of Newton's method, or of
    the stages, in the solved steps; `counts` the sums up to each node, where runs may be cut. The
    run goes on from `after`, where it can be taken up again. `v` are the velocities, where a
    compiled loop has them; `passed` is told of scenes with constraints that may fold. `impacts` are
    the nodes of the events, where a block has more nodes than that of its only event.
    """

    k: np.ndarray
    q: np.ndarray
    p: np.ndarray
    residual: float
    good: int
    failed: float = 0.0
    t: np.ndarray | None = None
    active_set: ActiveSet | None = None
    events: tuple[Event, ...] = ()
    iterations: int = 0
    after: RunState | None = None
    counts: np.ndarray | None = None
    v: np.ndarray | None = None
    passed: Passed | None = None
    impacts: tuple[int, ...] | None = None

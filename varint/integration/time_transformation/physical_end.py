"""Runs in fictitious time that end at a physical time: how far to step, and where to cut."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple, Protocol

import casadi as ca
import numpy as np

from varint.discrete.legendre import velocity_function
from varint.errors import ConvergenceError, InputError
from varint.integration.backend import blocks_of
from varint.integration.state import NodeBlock
from varint.integration.time_transformation.physical_time import LOCATED, end_at
from varint.integration.time_transformation.transformed_scene import TransformedScene, level_of
from varint.integration.trajectories import Run, first_node, moving_system, trajectory_of
from varint.integration.walls import TOO_FAST
from varint.numerics.arrays import over_columns
from varint.results.trajectory import Trajectory
from varint.scene.memory import per_system
from varint.scene.system import System

# steps before the mean rate of the clock is known well enough to look further ahead
FIRST_CHUNK = 200
PATIENCE = 8  # times the steps that the pace of the start would take
CAREFUL = 0.95  # of the steps that this rate asks for, so that the end is not passed unseen
# more steps than that rate asks for where all are seen: they are cheaper than another look
MARGIN = 1.02
SHARE = 8  # of the steps so far, that come next where it takes more than these
REACHED = 1e-9  # of the duration: its end is located
ENDED = 1e-13  # of the duration: less is round-off of the clock, and the end is its own
# steps after which a chunk of them is the last one, at whose pace it were so many more to the end:
# the motion comes to where it has no end of turns, and no run leads farther
MANY, ENDLESS = 2**16, 60_000_000
OFF_LEVEL = 0.1  # of the largest kinetic energy: the motion is another one


class Nodes(Protocol):
    """Nodes in fictitious time: a trajectory is one, and numbers alone."""

    @property
    def t(self) -> np.ndarray: ...
    @property
    def q(self) -> np.ndarray: ...
    @property
    def p(self) -> np.ndarray: ...
    @property
    def k(self) -> np.ndarray: ...


def blocks_until(scene: TransformedScene, run: Run, total: float) -> Iterator[NodeBlock]:
    """Blocks until the physical time has passed `total`, more and more of its steps saved towards
    the end.

    The clock's mean rate says how many steps it takes; the last of them are all kept, so that the
    end lies in one.
    """
    problem, every = run.problem, run.problem.save_every
    own = moving_system(run)
    expected, done, passed, at = problem.steps, 0, 0.0, None
    ahead: float = expected
    patience = PATIENCE * (expected + FIRST_CHUNK)
    while True:
        count, each = next_steps(ahead, done, every), every
        if done > patience:  # a rate that falls behind its mean would ask for ever fewer
            count = max(count, done // SHARE)
        if ahead <= FIRST_CHUNK:
            each = 1
        elif done % every == 0 and count >= every:
            count -= count % every
        else:  # within the interval between two nodes
            count = min(count, every - done % every)
            each = done + count + 1
        for block in blocks_of(
            own,
            run.plan.rule,
            problem._replace(steps=done + count, save_every=each, u=np.empty((done + count, 1, 0))),
            run.kernel,
            at,
        ):
            beyond = np.flatnonzero(block.q[:, -1] * math.copysign(1.0, total) >= abs(total))
            if len(beyond):  # what comes after the end, were it a failure, is nobody's concern
                yield _cut(block, int(beyond[0]) + 1)
                return
            yield block
            at, last = block.after, block
        clock, done = float(last.q[-1, -1]), int(last.k[-1])
        if clock / problem.h <= 0 or abs(clock) >= abs(total):
            return
        # does the clock stand still where σ vanishes?
        if done > patience:
            require_level(scene, run, trajectory_of(run, run.nodes))
        if done > MANY and abs(clock - passed) * ENDLESS < abs(total - clock) * count:
            so_far = trajectory_of(run, run.nodes)
            why = f"time hardly goes on after t = {clock:g}: {TOO_FAST}"
            raise _lost(why, so_far, math.inf, TOO_FAST)
        passed = clock
        ahead = steps_ahead(total, clock, done)


def next_steps(ahead: float, done: int, every: int) -> int:
    """How many steps to take after so many, with about so many ahead."""
    if ahead <= FIRST_CHUNK or (done and every == 1):
        return math.ceil(MARGIN * ahead) + 1
    return max(1, int(CAREFUL * ahead)) if done else FIRST_CHUNK


def steps_ahead(total: float, clock: float, done: int) -> float:
    """About how many steps are ahead where the clock shows so much after so many."""
    return min((total - clock) / (clock / done), 16 * done)


def _cut(block: NodeBlock, count: int) -> NodeBlock:
    """The first nodes of a block."""
    k, q, p = block.k[:count], block.q[:count], block.p[:count]
    t = None if block.t is None else block.t[:count]
    return block._replace(k=k, q=q, p=p, t=t, good=count, failed=0.0, events=block.events)


def end_at_duration(run: Run, inner: Trajectory, total: float) -> Trajectory:
    """The nodes before the physical time `total`, and one there, by a shorter step from the last
    of them.
    """
    kept, near = nodes_around(inner, total)
    if near.k[1] - near.k[0] > 1:  # the nodes between them
        first, last = near.k.tolist()
        part = run.problem._replace(
            q0=near.q[0], p0=near.p[0], first=first, steps=last, save_every=1
        )
        fine = trajectory_of(
            run, [first_node(part), *blocks_of(moving_system(run), run.plan.rule, part, run.kernel)]
        )
        _, near = nodes_around(fine, total)
    end = located_end(run, near, total)
    wanted = (
        np.flatnonzero(inner.k[:kept] % run.problem.save_every == 0)
        if run.problem.save_every > 1
        else slice(kept)
    )
    t, q, p, k = with_end((inner.t, inner.q, inner.p, inner.k), wanted, end)
    active_set = (
        None
        if inner.active_set is None
        else np.append(inner.active_set[wanted], inner.active_set[kept - 1])
    )
    return replace(inner, t=t, q=q, p=p, k=k, active_set=active_set)


def located_end(run: Run, near: NodeBlock, total: float) -> tuple[Any, ...]:
    """τ, q, p, k at the physical time `total` between two nodes.

    Raises
    ------
    InputError
        If it is not found there.
    """
    end = end_at(run, near, total)
    if not abs(end[1][-1] - total) <= REACHED * abs(total):
        raise InputError(
            f"the duration {total:g} cannot be located between t = {near.q[0, -1]:g} and "
            f"{near.q[1, -1]:g}, one step of the fictitious time: time_scale grows too much within "
            "it; take a smaller h or a smaller time_scale there"
        )
    if abs(end[1][-1] - total) <= ENDED * abs(total):
        end[1][-1] = total
    return end


def with_end(
    nodes: tuple[np.ndarray, ...], wanted: slice | np.ndarray, end: tuple[Any, ...]
) -> Iterator[np.ndarray]:
    """τ, q, p, k of the wanted nodes and the end."""
    return (np.concatenate((x[wanted], np.array(y)[None])) for x, y in zip(nodes, end, strict=True))


def nodes_around(nodes: Nodes, total: float) -> tuple[int, NodeBlock]:
    """How many nodes there are before the physical time `total`, and the two around it."""
    kept = int(np.searchsorted(np.abs(nodes.q[:, -1]), abs(total) * (1 - LOCATED)))
    two = slice(kept - 1, kept + 1)
    return kept, NodeBlock(nodes.k[two], nodes.q[two], nodes.p[two], 0.0, 2)


def require_level(scene: TransformedScene, run: Run, inner: Trajectory) -> None:
    """Time must go on, and the motion stay on the energy level that σ (H − E0) = 0 means as long
    as σ is not near 0.
    """
    if lost := lost_level(scene, moving_system(run), inner, inner.c):
        raise _lost(lost.why, inner[: lost.node + 1], lost.residual)


class Lost(NamedTuple):
    """The node after which a motion is lost, why, and by how much."""

    node: int
    why: str
    residual: float


def lost_level(scene: TransformedScene, moving: System, nodes: Nodes, c: np.ndarray) -> Lost | None:
    """Where `require_level` is not met."""
    t, q, p = nodes.t, nodes.q, nodes.p
    if len(t) < 2:
        return None
    clock = q[:, -1]
    passed = clock[1:] - clock[:-1]
    pace = passed / (t[1:] - t[:-1])
    slowest = int(pace.argmin())
    if not pace[slowest] > 0:
        return Lost(
            slowest,
            f"time does not go on after t = {clock[slowest]:g}: time_scale must stay positive, and "
            "h small enough for the motion where time_scale is large; take a smaller h",
            math.inf,
        )
    start, two = c[-2], slice(slowest, slowest + 2)
    energies, sizes = over_columns(_level_function(moving, scene), q[two], p[two], c)
    here = float(sizes.max())  # at most the largest one on the way
    if not np.abs(energies - start).max() <= OFF_LEVEL * here:
        here = float(over_columns(_level_function(moving, scene), q, p, c)[1].max())
    for energy, time in zip(energies[:, 0].tolist(), clock[two].tolist(), strict=True):
        if not abs(energy - start) <= OFF_LEVEL * here:
            return Lost(
                slowest,
                f"the energy is {energy:g} at t = {time:g} and was {start:g} at the start: "
                "time_scale comes too close to zero there, or h is too large; choose another "
                "time_scale or a smaller h",
                abs(energy - start) / here,
            )
    return None


def _lost(why: str, before: Trajectory, residual: float, cause: str = "") -> ConvergenceError:
    """What ends a run whose clock or level is lost, with the nodes before it."""
    step, time = int(before.k[-1]), float(before.q[-1, -1])
    told = partial(ConvergenceError, why, step=step, time=time, trajectory=before)
    return told(residual=residual, cause=cause)


@per_system
def _level_function(moving: System, scene: TransformedScene) -> ca.Function:
    """(q, p, c) of the rescaled scene that moves → what is E0 all along, and its |p·dq/dt|: the
    size that errors of the energy are measured by.
    """
    n, velocity = moving.structure.n, velocity_function(moving)
    q, p, c = (
        ca.MX.sym(name, size) for name, size in zip("qpc", (n, n, moving.c.numel()), strict=True)
    )
    return ca.Function("level", [q, p, c], list(level_of(scene, q, p, velocity(q, p, 0, c), c)))

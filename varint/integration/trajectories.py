"""A run and the trajectory that its blocks make: joined, cut at an event, thinned."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from time import perf_counter
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from varint.discrete.constraints import ActiveSet
from varint.integration.many_steps import in_gear, interpreted, steps_again
from varint.integration.plan import Plan
from varint.integration.problem import InitialValueProblem
from varint.integration.state import NodeBlock
from varint.results.dense_output import node_tolerance
from varint.results.records import IMPACTS, Event, changed
from varint.results.trajectory import Trajectory
from varint.scene.rays import make_nodes_unit
from varint.scene.system import System

if TYPE_CHECKING:
    from varint.codegen.kernel import Kernel
    from varint.integration.events.crossings import Crossings

ABRUPT = (*IMPACTS, "detachment")  # events after which the motion is another one


class Run(NamedTuple):
    """A run: what moves and how, the nodes there are, the blocks that follow, and the compiled
    loops behind them: that of the scene, and those of its active sets where it has some.
    """

    system: System
    plan: Plan
    problem: InitialValueProblem
    nodes: list[NodeBlock]
    blocks: Iterator[NodeBlock]
    kernel: Kernel | None
    began: float
    loop_in: Callable[[ActiveSet], Kernel | None] | None = None


def moving_system(run: Run) -> System:
    """The scene that moves: without redundant rows."""
    return active_scene(run.system, run.problem)


def active_scene(system: System, problem: InitialValueProblem) -> System:
    return system if problem.active_set is None else problem.active_set.scene(system)


def first_node(problem: InitialValueProblem) -> NodeBlock:
    """The node at the start as a block."""
    return NodeBlock(np.array([problem.first]), problem.q0[None], problem.p0[None], 0.0, 1)


def last_node(nodes: Sequence[NodeBlock]) -> NodeBlock:
    """The last saved node alone: the blocks of a long interval between two nodes have none."""
    block = next(b for b in reversed(nodes) if b.good)
    i = block.good - 1
    t = None if block.t is None else block.t[i:]
    v = None if block.v is None else block.v[i : i + 1]
    return block._replace(
        k=block.k[i : i + 1],
        q=block.q[i:],
        p=block.p[i:],
        v=v,
        t=t,
        good=1,
        events=(),
        impacts=None,
        iterations=0,
    )


def trajectory_of(
    run: Run, nodes: Sequence[NodeBlock], noted: Sequence[Event] = (), interrupted: bool = False
) -> Trajectory:
    """The motion that these blocks of the run hold."""
    problem = run.problem
    k = np.concatenate([block.k[: block.good] for block in nodes])
    t = problem.h * k
    t += problem.t0
    if [block for block in nodes if block.t is not None]:
        t = np.concatenate(
            [problem.t0 + problem.h * b.k[: b.good] if b.t is None else b.t for b in nodes]
        )
    active_sets, active_set = _active_sets(run.system, problem, nodes)
    events = [*one_by_one([event for block in nodes for event in block.events], problem.h), *noted]
    q, p = (np.concatenate([block[i] for block in nodes]) for i in (1, 2))
    iterations = sum([block.iterations for block in nodes])
    residual = max([block.residual for block in nodes])
    return motion_of(
        run,
        (k, t, q, p),
        (iterations, residual),
        (active_sets, active_set),
        in_order(events, problem.h),
        interrupted,
    )


def one_by_one(events: Sequence[Event], h: float) -> list[Event]:
    """Events as they came, those of contacts none later than the one that follows: a stop is told
    with the time when all bounces are over, and what another contact does before that ends them.
    """
    forward, after = 1.0 if h > 0 else -1.0, np.inf
    found = list[Event]()
    for event in reversed(events):
        if event.contact is not None:
            if event.time * forward > after:
                event = replace(event, time=after * forward)
            after = event.time * forward
        found.append(event)
    return found[::-1]


def in_order(events: list[Event], h: float) -> tuple[Event, ...]:
    """Events in the order of time, backwards in a run backwards."""
    forward = 1.0 if h > 0 else -1.0
    return tuple(sorted(events, key=lambda event: event.time * forward))


def motion_of(
    run: Run,
    nodes: tuple[np.ndarray, ...],
    work: tuple[int, float],
    active: tuple[tuple[ActiveSet, ...], np.ndarray | None] = ((), None),
    events: tuple[Event, ...] = (),
    interrupted: bool = False,
) -> Trajectory:
    """The motion with these nodes, (k, t, q, p) and perhaps v, found by so many iterations with
    such a residual; what holds at each node, and what happened.
    """
    system, chosen, problem, _, _, kernel, began, _ = run
    grid = problem.h, problem.t0, problem.u, problem.c
    seconds = {"seconds": perf_counter() - began}
    stats = stats_of(chosen, kernel, int(nodes[0][-1]), work, seconds, interrupted)
    motion = _motion(system, chosen, kernel, nodes, grid, stats)
    motion.__dict__.update(active_sets=active[0], active_set=active[1], events=events)
    if system.rays:
        make_nodes_unit(motion)
    return motion


def plain_motion_of(
    system: System,
    chosen: Plan,
    kernel: Kernel,
    nodes: tuple[np.ndarray, ...],
    grid: tuple[float, float, np.ndarray, np.ndarray],
    work: tuple[int, float],
    **more: Any,
) -> Trajectory:
    """`motion_of` one that nothing held or turned into another: (k, t, q, p) and perhaps v,
    (h, t0, u, c) and what is told besides.
    """
    stats = stats_of(chosen, kernel, len(grid[2]), work, more)
    return _motion(system, chosen, kernel, nodes, grid, stats)


def stats_of(
    chosen: Plan,
    kernel: Kernel | None,
    steps: int,
    work: tuple[int, float],
    more: dict[str, Any],
    interrupted: bool = False,
) -> Mapping[str, Any]:
    """How a motion was found, for the user."""
    backend = kernel.told if kernel else "interpreted"
    told = {"plan": chosen, "backend": backend, "steps": steps, "iterations": work[0]}
    told["residual"], told["interrupted"] = work[1], interrupted
    told.update(more)
    return MappingProxyType(told)


def _motion(
    system: System,
    chosen: Plan,
    kernel: Kernel | None,
    nodes: tuple[np.ndarray, ...],
    grid: tuple[float, float, np.ndarray, np.ndarray],
    stats: Mapping[str, Any],
) -> Trajectory:
    """In half the time of its constructor, which short runs notice."""
    (k, t, q, p, *v), (h, t0, u, c) = nodes, grid
    motion, rule = object.__new__(Trajectory), chosen.rule
    known = {
        "system": system,
        "rule": rule,
        "t": t,
        "q": q,
        "p": p,
        "h": h,
        "k": k,
        "u": u,
        "c": c,
        "functions": steps_again(rule, in_gear if kernel else interpreted),
        "origin": t0,
        "stats": stats,
    }
    if v:
        (known["v"],) = v
    object.__setattr__(motion, "__dict__", known)
    return motion


def with_stats(motion: Trajectory, **more: Any) -> Trajectory:
    """The same motion with more told of how it was found; what is known of it stays known."""
    told = object.__new__(Trajectory)
    told.__dict__.update(motion.__dict__, stats=MappingProxyType({**motion.stats, **more}))
    return told


def with_velocities(motion: Trajectory, nodes: Sequence[NodeBlock]) -> Trajectory:
    """The motion of these blocks, its velocities those of the compiled loop where all are known
    from there.
    """
    if motion.system.rays:  # lengths that the loop has no part in are not those of the nodes
        return motion
    if not all(b.v is not None for b in nodes if b.good > 1):
        return motion
    some = [b for b in nodes if b.good]
    v = np.concatenate([b.q[:1] if b.v is None else b.v[: b.good] for b in some])
    first = np.cumsum([0] + [b.good for b in some[:-1]])
    others = first[[b.v is None for b in some]]
    if len(others):
        v[others] = motion[others].v
    motion.__dict__["v"] = v
    return motion


def _active_sets(
    system: System, problem: InitialValueProblem, nodes: Sequence[NodeBlock]
) -> tuple[tuple[ActiveSet, ...], np.ndarray | None]:
    """The active sets that occurred, and the one of each node; nothing where all constraints
    held all the time.
    """
    if not system.structure.contacts and (
        problem.active_set is None or problem.active_set.scene(system) is system
    ):
        return (), None
    each = [block.active_set or problem.active_set for block in nodes]
    active_sets = tuple(dict.fromkeys(active_set for active_set in each if active_set is not None))
    where = {active_set: i for i, active_set in enumerate(active_sets)}
    numbers = [where[active_set] for active_set in each if active_set is not None]
    return active_sets, np.repeat(numbers, [block.good for block in nodes])


def subsample(motion: Trajectory, every: int) -> Trajectory:
    """Every so many nodes and the last, and those off the grid or of events, where the motion
    begins anew. Nodes of a transformed time have its grid, whatever their own times; so have those
    of steps that differ.
    """
    assert motion.origin is not None
    off = np.abs(motion.t - (motion.origin + motion.h * motion.k))
    grid = off <= node_tolerance(motion) * abs(motion.h)
    if motion.fictitious is not None or motion.sizes is not None:
        grid[:] = True
    abrupt = [event.time for event in motion.events if event.kind in ABRUPT]
    asked = (motion.k % every == 0) | np.isin(motion.t, abrupt)
    asked[-1] = True
    return motion[np.flatnonzero(asked | ~grid)]


def cut_at(motion: Trajectory, first: int, end: Crossings) -> Trajectory:
    """The trajectory until the first of the crossings after node `first`, its last node; what was
    made behind it is no part of its steps.
    """
    node, t = first + int(end.before.node[0]), float(end.before.t[0])
    if end.jump[0]:  # by the impact at the next node, which is kept as the motion leaves it
        late = motion.t[node + 2 :][:1] * np.sign(motion.h)
        events = tuple(e for e in motion.events if not (e.time * np.sign(motion.h) >= late).any())
        return _with_own_steps(changed(motion[: node + 2], events=events))
    last = end.after
    times, q, p = (
        np.concatenate([getattr(motion, name)[: node + 1], getattr(last, name)[:1]])
        for name in "tqp"
    )
    k = np.append(motion.k[: node + 1], motion.k[node])
    active_set = (
        None
        if motion.active_set is None
        else np.concatenate([motion.active_set[: node + 1], motion.active_set[node : node + 1]])
    )
    before = tuple(event for event in motion.events if (t - event.time) * motion.h >= 0)
    cut = changed(motion, t=times, q=q, p=p, k=k, active_set=active_set, events=before)
    return _with_own_steps(cut)


def _with_own_steps(motion: Trajectory) -> Trajectory:
    """Its steps are those until its last node, of which the last one may be a shorter one."""
    last, origin = int(motion.k[-1]), motion.origin
    whole = origin is not None and float(motion.t[-1]) == origin + motion.h * last
    return with_stats(motion, steps=last + (not whole))


def energy_note(run: Run, last: NodeBlock) -> str:
    """Energy error of the last node for the progress bar; the energy where forces or time may
    change it.
    """
    before, after = trajectory_of(
        run, [last_node([block]) for block in (run.nodes[0], last)]
    ).energy
    s = run.system.structure
    if s.forced or not s.autonomous or before == 0:
        return f"H={after:.6g}"
    return f"ΔH/|H|={(after - before) / abs(before):.1e}"

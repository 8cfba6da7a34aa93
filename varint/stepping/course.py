"""The course of a run: its blocks, watched as they come, become one trajectory."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from time import perf_counter
from types import MappingProxyType
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from varint.between import rounding
from varint.errors import InputError, StepRefused
from varint.progress import progress_bar
from varint.rules import Rule
from varint.stepping.backend import blocks_of, divided, kernel_for
from varint.stepping.events import Watch, crossings, logged
from varint.stepping.plan import Plan
from varint.stepping.run import Block, Task
from varint.system import System
from varint.trajectory import Event, Trajectory

if TYPE_CHECKING:
    import casadi as ca

    from varint.compiled.kernel import Kernel
    from varint.manifold import Phase
    from varint.stepping.checkpoint import Checkpoint


ABRUPT = ("impact", "stop", "detachment")  # events after which the motion is another one


class Course(NamedTuple):
    """A run: what moves and how, the nodes there are, the blocks that follow, and the compiled loop behind them."""

    system: System
    plan: Plan
    task: Task
    nodes: list[Block]
    blocks: Iterator[Block]
    kernel: Kernel | None
    began: float


def course_of(
    system: System,
    chosen: Plan,
    task: Task,
    began: float,
    *,
    backend: str,
    on_failure: str = "raise",
    file: Checkpoint | None = None,
) -> Course:
    """The run that `task` describes, from its checkpoint on where there is one.

    Raises
    ------
    InputError
        If the backend or `on_failure` is unknown or not possible here.
    """
    if on_failure not in ("raise", "subdivide"):
        raise InputError(f"on_failure must be 'raise' or 'subdivide', got {on_failure!r}")
    kernel: Kernel | None = None
    if system.structure.contacts:
        if backend not in ("auto", "interpreted"):
            raise InputError(f"runs with contacts are interpreted; backend={backend!r} is not for them")
        from varint.stepping import contact_divide
        from varint.stepping.contact_run import contact_run

        run = partial(contact_run, system, chosen.rule, task)
        remedy = partial(contact_divide.divided, system, chosen.rule, task)
    else:
        scene = _scene(system, task)
        kernel = kernel_for(scene, chosen.rule, task, backend)
        run = partial(blocks_of, scene, chosen.rule, task, kernel)
        remedy = partial(divided, scene, chosen.rule, task, kernel)
    nodes = file.read() if file else []
    if not nodes and not system.structure.contacts:
        nodes = [first_node(task)]
    at = nodes[-1].after if nodes else None
    blocks = run(at)
    if on_failure == "subdivide":
        from varint.stepping.subdivide import around_failures

        blocks = around_failures(run, remedy, task.steps, at)
    return Course(system, chosen, task, nodes or [next(blocks)], blocks, kernel, began)


def moving(course: Course) -> System:
    """The scene that moves: without redundant rows."""
    return _scene(course.system, course.task)


def _scene(system: System, task: Task) -> System:
    return system if task.phase is None else task.phase.scene(system)


def first_node(task: Task) -> Block:
    """The node at the start as a block."""
    return Block(np.array([task.first]), task.q0[None], task.p0[None], 0.0, 1)


def travelled(
    course: Course,
    *,
    stop: Watch | None = None,
    watches: Sequence[Watch] = (),
    file: Checkpoint | None = None,
    progress: bool | None = None,
    on_failure: str = "raise",
) -> Trajectory:
    """The whole run, or its nodes until `stop` crosses zero or Ctrl-C.

    Raises
    ------
    ConvergenceError
        If a step cannot be solved.
    """
    task, nodes, noted, interrupted = course.task, course.nodes, [], False
    reached = int(nodes[-1].k[-1])
    try:
        with (
            progress_bar(task.steps, "step", progress, reached) as move,
            np.errstate(all="ignore"),
        ):  # blocks are checked
            for block in course.blocks:
                found: list[tuple[int, float]] = []
                if watches or stop:
                    recent = trajectory(course, [last_node(nodes), block])
                    noted += [event for watch in watches for event in logged(recent, watch)]
                    found = crossings(recent, stop)[:1] if stop else []
                nodes.append(block)
                if found or block.good < len(block.k):
                    motion = trajectory(course, nodes, noted)
                    if found:
                        return _cut(motion, len(motion) - len(recent) + found[0][0] + 1, found[0][1])
                    from varint.stepping.diagnosis import failure

                    raise failure(motion, _next_step(block), block.failed, on_failure)
                if block.good:
                    before, reached = reached, int(block.k[block.good - 1])
                    move(reached - before, partial(_energy_note, course, block))
                if file and file.due():
                    file.write(task.t0, task.h, nodes, noted)
    except StepRefused as error:
        from varint.stepping.diagnosis import refusal

        raise refusal(trajectory(course, nodes, noted), _next_step(nodes[-1]), str(error)) from None
    except KeyboardInterrupt:
        interrupted = True
    if file and len(nodes) > 1:
        file.write(task.t0, task.h, nodes, noted)
    return trajectory(course, nodes, noted, interrupted)


def last_node(nodes: Sequence[Block]) -> Block:
    """The last saved node alone: the blocks of a long interval between two nodes have none."""
    block = next(b for b in reversed(nodes) if b.good)
    i = block.good - 1
    t = None if block.t is None else block.t[i:]
    return block._replace(k=block.k[i : i + 1], q=block.q[i:], p=block.p[i:], t=t, good=1, events=(), iterations=0)


def _next_step(block: Block) -> int:
    """Index of the first step that is not known to be solved."""
    if block.after is not None:
        return block.after.k
    return int(block.k[block.good - 1]) if block.good else int(block.k[0]) - 1


def _energy_note(course: Course, last: Block) -> str:
    """Energy error of the last node for the progress bar; the energy where forces or time may change it."""
    before, after = trajectory(course, [last_node([block]) for block in (course.nodes[0], last)]).energy
    s = course.system.structure
    if s.forced or not s.autonomous or before == 0:
        return f"H={after:.6g}"
    return f"ΔH/|H|={(after - before) / abs(before):.1e}"


def trajectory(
    course: Course, nodes: Sequence[Block], noted: Sequence[Event] = (), interrupted: bool = False
) -> Trajectory:
    """The motion that these blocks of the run hold."""
    system, chosen, task, _, _, kernel, began = course
    k = np.concatenate([block.k[: block.good] for block in nodes])
    t = task.h * k
    t += task.t0
    if [block for block in nodes if block.t is not None]:
        t = np.concatenate([task.t0 + task.h * b.k[: b.good] if b.t is None else b.t for b in nodes])
    phases, phase = _phases(system, task, nodes)
    events = [*noted, *[event for block in nodes for event in block.events]]
    if len(events) > 1:
        events.sort(key=lambda event: event.time * np.sign(task.h))
    return Trajectory(
        system=system,
        rule=chosen.rule,
        t=t,
        q=np.concatenate([block.q for block in nodes]),
        p=np.concatenate([block.p for block in nodes]),
        h=task.h,
        k=k,
        u=task.u,
        c=task.c,
        functions=partial(step_functions, chosen.rule, system),
        phases=phases,
        phase=phase,
        origin=task.t0,
        events=tuple(events),
        stats=MappingProxyType(
            {
                "plan": chosen,
                "backend": "interpreted" if kernel is None else f"compiled: {kernel.about}",
                "steps": int(k[-1]),
                "iterations": sum([block.iterations for block in nodes]),
                "residual": max([block.residual for block in nodes]),
                "interrupted": interrupted,
                "seconds": perf_counter() - began,
            }
        ),
    )


def step_functions(rule: Rule, own: System, scene: System | None = None) -> tuple[ca.Function, ca.Function]:
    """Step function and action function of a system, or of a scene that moves in one of its phases."""
    from varint.stepping.step_function import action_function, step_function

    scene = scene or own
    return step_function(scene, rule), action_function(scene, rule)


def _phases(system: System, task: Task, nodes: Sequence[Block]) -> tuple[tuple[Phase, ...], np.ndarray | None]:
    """The phases that occurred, and the one of each node; nothing where all constraints held all the time."""
    if not system.structure.contacts and (task.phase is None or task.phase.scene(system) is system):
        return (), None
    each = [block.phase or task.phase for block in nodes]
    phases = tuple(dict.fromkeys(phase for phase in each if phase is not None))
    return phases, np.concatenate([np.full(b.good, phases.index(p)) for b, p in zip(nodes, each, strict=True)])


def thinned(motion: Trajectory, every: int) -> Trajectory:
    """Every so many nodes and the last, and those off the grid or of events, where the motion begins anew."""
    assert motion.origin is not None
    grid = np.abs(motion.t - (motion.origin + motion.h * motion.k)) <= rounding(motion) * abs(motion.h)
    abrupt = [event.time for event in motion.events if event.kind in ABRUPT]
    asked = (motion.k % every == 0) | np.isin(motion.t, abrupt)
    asked[-1] = True
    return motion[np.flatnonzero(asked | ~grid)]


def _cut(motion: Trajectory, kept: int, t: float) -> Trajectory:
    """The first `kept` nodes of the trajectory, and one more at time t."""
    end = motion.at([t])
    times, q, p, steps = (np.concatenate([getattr(motion, name)[:kept], getattr(end, name)]) for name in "tqpk")
    phase = None if motion.phase is None else np.concatenate([motion.phase[:kept], motion.phase[kept - 1 : kept]])
    before = tuple(event for event in motion.events if (t - event.time) * motion.h >= 0)
    return replace(motion, t=times, q=q, p=p, k=steps, phase=phase, events=before)

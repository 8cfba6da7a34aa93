"""Initial value problems: check the input, run the time loop, return a `Trajectory`."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from time import perf_counter
from types import MappingProxyType
from typing import Any

import casadi as ca
import numpy as np

from varint.description import identity
from varint.errors import ConvergenceError, InputError
from varint.progress import progress_bar
from varint.rules import Rule
from varint.stepping.checkpoint import Checkpoint
from varint.stepping.diagnosis import energy_jump, likely_cause
from varint.stepping.events import first_crossing
from varint.stepping.initial import initial_task
from varint.stepping.plan import Plan, plan
from varint.stepping.run import RESIDUAL_LIMIT, Block, Position, Task, beginning, run
from varint.stepping.step_function import action_function, step_function
from varint.system import System
from varint.trajectory import Trajectory

Remedy = Callable[[System, Rule, Task, Position], Block]


def simulate(
    system: System,
    rule: Rule | None = None,
    *,
    q0: Any,
    v0: Any = None,
    p0: Any = None,
    h: float | None = None,
    steps: int | None = None,
    duration: float | None = None,
    t0: float = 0.0,
    u: Any = None,
    params: Mapping[str, Any] | None = None,
    save_every: int = 1,
    until: ca.SX | None = None,
    progress: bool | None = None,
    checkpoint: Any = None,
    on_failure: str = "raise",
) -> Trajectory:
    """Motion from initial values, D2 L_d(q_{k−1}, q_k) + D1 L_d(q_k, q_{k+1}) = 0 (discrete Euler–Lagrange).

    Parameters
    ----------
    system : System
    rule : Rule, optional
        Default: an explicit composition for separable scenes with constant mass, else `gauss(2)`.
    q0 : array (n,)
        Start coordinates.
    v0, p0 : array (n,)
        Start velocities or momenta ∂L/∂v, one of the two (neither for a degenerate Lagrangian).
    h, steps, duration : float, int, float
        Step size, number of steps, total time: two of the three. A negative h runs backwards.
    t0 : float
        Start time.
    u : array (steps, k) or (steps, r, k) or (k,), optional
        Controls: one value a step, one at each of the rule's r nodes, or the same all the time.
    params : dict, optional
        Parameter values that differ from the defaults.
    save_every : int
        Keep every so many steps (the last step is always kept).
    until : SX, optional
        Stop where this expression of q, v, t and the parameters crosses zero; the last node is the crossing, located
        with the rule's own accuracy.
    progress : bool, optional
        Show a progress bar. Default: in a terminal, for runs longer than a second.
    checkpoint : path, optional
        Write the run to this file every second or so. The same call goes on from there after a crash, a kill or Ctrl-C,
        and ends with the same bytes as a run that was not stopped; after the end it returns the whole run at once.
        One run a file, one process a run.
    on_failure : str
        ``"raise"``, or ``"subdivide"``: redo a step that cannot be solved in 2, 4, … 1024 parts. They become nodes, and
        `Trajectory.events` has a `Division` for it. The step changes there, so a symplectic rule loses its long-time
        guarantees locally: for a rare close approach, not for a step that is too large everywhere.

    Returns
    -------
    Trajectory
        After Ctrl-C the nodes until then, with ``stats["interrupted"]`` true.

    Raises
    ------
    InputError
        If the input is not a well-posed problem; the message says what to change.
    ConvergenceError
        If a step cannot be solved: step, time, residual, likely cause and the trajectory up to there are attached.

    Examples
    --------
    >>> import casadi as ca
    >>> import varint as vi
    >>> q, v = vi.coordinates("theta")
    >>> pendulum = vi.System(q, v, v**2 / 2 + 9.81 * ca.cos(q))
    >>> motion = vi.simulate(pendulum, q0=1.0, v0=0.0, h=0.01, steps=1000)
    >>> motion.q.shape, bool(abs(motion.energy - motion.energy[0]).max() < 1e-6)
    ((1001, 1), True)
    """
    began = perf_counter()
    chosen = plan(system, rule)
    task = initial_task(
        system, chosen.rule,
        q0=q0, v0=v0, p0=p0, h=h, steps=steps, duration=duration, t0=t0, u=u, params=params, save_every=save_every,
    )  # fmt: skip
    remedy = _remedy(on_failure, task)
    file = (
        None if checkpoint is None else Checkpoint(Path(checkpoint), _identity(system, chosen, task, until, on_failure))
    )
    scene = system if task.phase is None else task.phase.scene(system)
    nodes = [(file and file.read()) or _start(scene, chosen, task)]
    done = nodes[0].after.k
    interrupted = False
    try:
        with progress_bar(task.steps, "step", progress, done) as move:
            for block in _blocks(scene, chosen.rule, task, nodes[0].after, remedy):
                recent = _trajectory(system, chosen, task, [_last_node(nodes), block], began)
                nodes.append(block)
                move(block.after.k - nodes[-2].after.k, partial(_energy_note, nodes[0], recent))
                stop = None if until is None else first_crossing(recent, until)
                if stop is not None:
                    motion = _trajectory(system, chosen, task, nodes, began)
                    return _cut(motion, len(motion) - len(recent) + stop[0] + 1, stop[1])
                if block.failed is not None:
                    motion = _trajectory(system, chosen, task, nodes, began)
                    raise failure(motion, block.after.k, block.failed, on_failure)
                if file and file.due():
                    file.write(nodes)
    except KeyboardInterrupt:
        interrupted = True
    if file and nodes[-1].after.k > done:
        file.write(nodes)
    motion = _trajectory(system, chosen, task, nodes, began, interrupted)
    if jump := energy_jump(motion):
        warnings.warn(f"{jump} scene can do: h = {task.h:g} is too large, try a smaller one", stacklevel=2)
    return motion


def _start(system: System, chosen: Plan, task: Task) -> Block:
    at = beginning(system, chosen.rule, task)
    return Block(np.zeros(1, dtype=int), np.array([task.t0]), task.q0[None], task.p0[None], 0.0, at)


def _blocks(system: System, rule: Rule, task: Task, at: Position, remedy: Remedy | None) -> Iterator[Block]:
    """The run with its remedy: a block that failed is followed by one that goes around the failure."""
    while True:
        block = None
        for block in run(system, rule, task, at):
            yield block if remedy is None else replace(block, failed=None)
        if remedy is None or block is None or block.failed is None:
            return
        around = remedy(system, rule, task, block.after)
        yield around
        if around.failed is not None:
            return
        at = around.after


def _remedy(on_failure: str, task: Task) -> Remedy | None:
    if on_failure == "raise":
        return None
    if on_failure != "subdivide":
        raise InputError(f"on_failure must be 'raise' or 'subdivide', got {on_failure!r}")
    if task.u.shape[1] > 1:
        raise InputError("on_failure='subdivide' needs controls that are constant on a step, (steps, k)")
    from varint.stepping.subdivide import subdivided

    return subdivided


def _identity(system: System, chosen: Plan, task: Task, until: ca.SX | None, on_failure: str) -> dict[str, str]:
    """What the bytes of this run depend on."""
    s = system
    stop = "" if until is None else ca.Function("until", [s.q, s.v, s.t, s.control, s.c], [until]).serialize()
    return identity(
        system, chosen.rule, q0=task.q0, p0=task.p0, t0=task.t0, h=task.h, steps=task.steps,
        save_every=task.save_every, u=task.u, params=task.c, until=stop, on_failure=on_failure, plan=chosen.method,
    )  # fmt: skip


def _last_node(nodes: list[Block]) -> Block:
    """The last saved node alone: the blocks of a long interval between two nodes have none."""
    block = next(b for b in reversed(nodes) if len(b.k))
    return replace(block, k=block.k[-1:], t=block.t[-1:], q=block.q[-1:], p=block.p[-1:], divided=())


def _energy_note(start: Block, recent: Trajectory) -> str:
    """Energy error of the last node for the progress bar; the energy where forces or time may change it."""
    s = recent.system.structure
    t, q, p = (np.concatenate([getattr(start, x)[:1], getattr(recent, x)[-1:]]) for x in "tqp")
    first, last = replace(recent, t=t, q=q, p=p, k=np.array([0, recent.k[-1]])).energy
    if s.forced or not s.autonomous or first == 0:
        return f"H={last:.6g}"
    return f"ΔH/|H|={(last - first) / abs(first):.1e}"


def _trajectory(
    system: System, chosen: Plan, task: Task, nodes: list[Block], began: float, interrupted: bool = False
) -> Trajectory:
    k, t, q, p = (np.concatenate([getattr(block, name) for block in nodes]) for name in "ktqp")
    divided = tuple(d for block in nodes for d in block.divided)
    phases = () if task.phase is None or task.phase.scene(system) is system else (task.phase,)
    return Trajectory(
        system=system,
        rule=chosen.rule,
        t=t,
        q=q,
        p=p,
        h=task.h,
        k=k,
        u=task.u,
        c=task.c,
        functions=lambda scene=system: (step_function(scene, chosen.rule), action_function(scene, chosen.rule)),
        phases=phases,
        phase=np.zeros(len(k), dtype=int) if phases else None,
        events=divided,
        stats=MappingProxyType(
            {
                "plan": str(chosen),
                "steps": int(nodes[-1].after.k),
                "residual": max(block.residual for block in nodes),
                "subdivided": len(divided),
                "interrupted": interrupted,
                "seconds": perf_counter() - began,
            }
        ),
    )


def _cut(motion: Trajectory, kept: int, t: float) -> Trajectory:
    """The first `kept` nodes of the trajectory, and one more node at time t."""
    end = motion.at([t])
    times, q, p, steps = (np.concatenate([getattr(motion, name)[:kept], getattr(end, name)]) for name in "tqpk")
    phase = None if motion.phase is None else np.concatenate([motion.phase[:kept], motion.phase[kept - 1 : kept]])
    return replace(motion, t=times, q=q, p=p, k=steps, phase=phase)


def failure(motion: Trajectory, step: int, residual: float, on_failure: str) -> ConvergenceError:
    """The error of a step that failed; between two saved nodes it belongs to the steps after the last of them."""
    t = float(motion.t[0] + motion.h * (step - motion.k[0]))
    if np.isfinite(residual):
        what = f"left a residual of {residual:.1e} (limit {RESIDUAL_LIMIT:g})"
    else:
        what = "gave values that are not finite"
    tried = " (in 1024 parts, too)" if on_failure == "subdivide" else ""
    hint = "" if tried else "; on_failure='subdivide' redoes such a step in smaller parts"
    cause = likely_cause(motion)
    return ConvergenceError(
        f"the step after t = {t:g} (step {step}) {what}{tried}. Likely: {cause}{hint}. "
        f"Error.trajectory has the {len(motion)} nodes before it",
        step=step, time=t, residual=residual, trajectory=motion, cause=cause,
    )  # fmt: skip

"""Initial value problems: check the input, run the time loop, return a `Trajectory`."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import partial
from time import perf_counter
from types import MappingProxyType, NoneType
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np

from varint.between import rounding
from varint.errors import InputError
from varint.manifold import Phase
from varint.progress import progress_bar
from varint.rules import Rule
from varint.stepping.accuracy import for_tolerance
from varint.stepping.backend import blocks_of, kernel_for
from varint.stepping.checkpoint import Checkpoint, checkpoint_of
from varint.stepping.diagnosis import energy_jump, failure
from varint.stepping.events import crossings, logged, watched
from varint.stepping.initial import initial_task
from varint.stepping.plan import Plan, plan
from varint.stepping.rescaled import rescaled_motion
from varint.stepping.run import Block, Task
from varint.stepping.step_function import action_function, step_function
from varint.system import System
from varint.trajectory import Event, Trajectory

ABRUPT = ("impact", "stop", "detachment")  # events after which the motion is another one

if TYPE_CHECKING:
    from varint.compiled.kernel import Kernel

LEVEL = 1e-3  # of the wanted error: what iterations may leave in a step


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
    until: ca.SX | tuple[ca.SX, int] | None = None,
    events: Mapping[str, Any] | None = None,
    time_scale: ca.SX | None = None,
    tol: float | None = None,
    progress: bool | None = None,
    backend: str = "auto",
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
    until : SX or (SX, int), optional
        Stop where this expression of q, v, t and the parameters crosses zero; the last node is the crossing, located
        with the rule's own accuracy. With a direction: +1 only where it rises, -1 only where it falls.
    events : dict of SX or (SX, int), optional
        Log where these expressions cross zero: `Trajectory.events` has a record with the time and the name of each.
        Every step is watched, whatever `save_every` keeps.
    time_scale : SX, optional
        σ(q) > 0 of variable steps that keep the structure: h is the step of the fictitious time τ, dt = σ(q) dτ, the
        nodes' ``t`` are physical times, and `duration` is physical too (the last step ends there). Give h and either
        steps or duration; see `close_encounters`.
    tol : float, optional
        Wanted error of q, relative to the largest |q|. With `duration` alone, rule (where none is given) and step are
        chosen for it by a pilot and checked over the whole run; ``stats["error_estimate"]`` says what they stand for.
        With h or steps, compiled iterations end where they no longer matter for tol, in place of round-off; the
        invariants are then kept to the same accuracy only.
    progress : bool, optional
        Show a progress bar. Default: in a terminal, for runs longer than a second.
    backend : {"auto", "compiled", "interpreted"}
        Whether the run's inner loop is compiled C. By default it is where the run is long enough to repay the compiler.
    checkpoint : path, optional
        Write the run to this file every second or so. The same call goes on from there after a crash, a kill or Ctrl-C,
        and ends with the same bytes as a run that was not stopped; after the end it returns the whole run at once.
        One run a file, one process a run.
    on_failure : {"raise", "subdivide"}
        ``"subdivide"`` redoes a step that cannot be solved in 2, 4, … 1024 parts (interpreted). They become nodes, and
        `Trajectory.events` tells of it. The step changes there, so a symplectic rule loses its long-time guarantees
        locally: for a rare close approach, not for a step that is too large everywhere.

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
    if time_scale is not None:
        if u is not None:
            raise InputError("time_scale takes no controls u: they change the energy that it is built on")
        return rescaled_motion(
            simulate, system, rule, time_scale, q0=q0, v0=v0, p0=p0, h=h, steps=steps, duration=duration, t0=t0,
            params=params, save_every=save_every, until=until, events=events,
            options={"progress": progress, "backend": backend, "tol": tol},
        )  # fmt: skip
    if tol is not None and h is None and steps is None:
        stopped = until is not None or events
        if duration is None or stopped or np.ndim(u) > 1 or system.structure.contacts:
            raise InputError(
                "tol without h chooses the steps of a whole run: give duration, constant controls, and neither until "
                "nor events nor contacts"
            )

        def whole(chosen: Rule, span: float, count: int, every: int, level: float | None) -> Trajectory:
            with warnings.catch_warnings():  # trials with steps too large are compared with others
                warnings.filterwarnings("ignore", message="the energy went", category=UserWarning)
                return simulate(
                    system, chosen, q0=q0, v0=v0, p0=p0, duration=span, steps=count, t0=t0, u=u, params=params,
                    save_every=every, tol=level, progress=False, backend=backend,
                )  # fmt: skip

        motion = for_tolerance(whole, system, rule, duration, tol)
        kept = np.unique(np.append(np.arange(0, len(motion), save_every), len(motion) - 1))
        return motion[kept]
    began = perf_counter()
    stops = None if until is None else watched("until", until)
    if not isinstance(events, (Mapping, NoneType)):
        raise InputError(f"events must be a dictionary of names and expressions, got {type(events).__name__}")
    watches = [watched(name, wanted) for name, wanted in (events or {}).items()]
    noted: list[Event] = []
    chosen = plan(system, rule)
    task = initial_task(
        system, chosen.rule,
        q0=q0, v0=v0, p0=p0, h=h, steps=steps, duration=duration, t0=t0, u=u, params=params, save_every=save_every,
    )  # fmt: skip
    if tol is not None:
        task = replace(task, level=LEVEL * tol)
    file = None
    if checkpoint is not None:
        words = dict(until=repr(until), events=repr(events), backend=backend, on_failure=on_failure)
        file = checkpoint_of(checkpoint, system, chosen.rule, task, **words)
    if watches or stops:
        task = replace(
            task, save_every=1
        )  # every node is looked at; those that were not asked for are dropped at the end
    nodes, blocks, kernel = _course(system, chosen, task, backend, on_failure, file)
    done, interrupted = int(nodes[0].k[-1]), False
    try:
        with progress_bar(task.steps, "step", progress, done) as move, np.errstate(all="ignore"):  # blocks are checked
            for block in blocks:
                last = _last_node(nodes)
                nodes.append(block)
                stop = []
                if watches or stops:
                    recent = _trajectory(system, chosen, task, [last, block], began, [])
                    noted += [event for watch in watches for event in logged(recent, watch)]
                    stop = crossings(recent, stops)[:1] if stops else []
                if stop or block.good < len(block.k):
                    motion = _trajectory(system, chosen, task, nodes, began, noted, kernel)
                    if stop:
                        cut = _cut(motion, len(motion) - len(recent) + stop[0][0] + 1, stop[0][1])
                        return _thinned(cut, task, int(save_every))
                    raise failure(motion, _failed_step(block), block.failed, on_failure)
                if block.good:
                    note = partial(_energy_note, system, chosen, task, nodes[0], block)
                    move(int(block.k[block.good - 1] - last.k[-1]), note)
                if file and file.due():
                    file.write(task.t0, task.h, nodes, noted)
    except KeyboardInterrupt:
        interrupted = True
    if file and len(nodes) > 1:
        file.write(task.t0, task.h, nodes, noted)
    motion = _trajectory(system, chosen, task, nodes, began, noted, kernel, interrupted)
    if jump := energy_jump(motion):
        warnings.warn(f"{jump} scene can do: h = {task.h:g} is too large, try a smaller one", stacklevel=2)
    return _thinned(motion, task, int(save_every))


def _course(
    system: System, chosen: Plan, task: Task, backend: str, on_failure: str, file: Checkpoint | None
) -> tuple[list[Block], Iterator[Block], Kernel | None]:
    """What there is of the run, the blocks that follow, and the compiled loop that makes them if one does."""
    if on_failure not in ("raise", "subdivide"):
        raise InputError(f"on_failure must be 'raise' or 'subdivide', got {on_failure!r}")
    if on_failure == "subdivide":
        if system.structure.contacts or task.u.shape[1] > 1 or backend == "compiled":
            raise InputError(
                "on_failure='subdivide' is for scenes without contacts, controls that are constant on a step "
                "(steps, k), and the interpreted backend"
            )
        backend = "interpreted"
    if system.structure.contacts:
        if backend not in ("auto", "interpreted"):
            raise InputError(f"runs with contacts are interpreted; backend={backend!r} is not for them")
        from varint.stepping.contact_run import contact_run

        contacts = contact_run(system, chosen.rule, task)
        return [next(contacts)], contacts, None
    scene = system if task.phase is None else task.phase.scene(system)
    kernel = kernel_for(scene, chosen.rule, task, backend)
    nodes = [(file and file.read()) or Block(np.zeros(1, dtype=int), task.q0[None], task.p0[None], 0.0, 1)]
    if on_failure == "subdivide":
        from varint.stepping.subdivide import around_failures

        return nodes, around_failures(scene, chosen.rule, task, nodes[0].after), None
    return nodes, blocks_of(scene, chosen.rule, task, kernel, nodes[0].after), kernel


def _last_node(nodes: list[Block]) -> Block:
    """The last saved node alone: the blocks of a long interval between two nodes have none."""
    block = next(b for b in reversed(nodes) if b.good)
    i = block.good - 1
    t = None if block.t is None else block.t[i:]
    return replace(block, k=block.k[i : i + 1], q=block.q[i:], p=block.p[i:], t=t, good=1, events=(), iterations=0)


def _failed_step(block: Block) -> int:
    """Index of the first step that is not known to be solved."""
    if block.after is not None:
        return block.after.k
    return int(block.k[block.good - 1]) if block.good else int(block.k[0]) - 1


def _energy_note(system: System, chosen: Plan, task: Task, first: Block, last: Block) -> str:
    """Energy error of the last node for the progress bar; the energy where forces or time may change it."""
    ends = _trajectory(system, chosen, task, [_last_node([block]) for block in (first, last)], 0.0, [])
    before, after = ends.energy
    s = system.structure
    if s.forced or not s.autonomous or before == 0:
        return f"H={after:.6g}"
    return f"ΔH/|H|={(after - before) / abs(before):.1e}"


def _trajectory(
    system: System,
    chosen: Plan,
    task: Task,
    nodes: list[Block],
    began: float,
    noted: list[Event],
    kernel: Kernel | None = None,
    interrupted: bool = False,
) -> Trajectory:
    k = np.concatenate([block.k[: block.good] for block in nodes])
    phases, phase = _phases(system, task, nodes)
    happened = [*noted, *(event for block in nodes for event in block.events)]
    return Trajectory(
        system=system,
        rule=chosen.rule,
        t=np.concatenate([task.t0 + task.h * b.k[: b.good] if b.t is None else b.t for b in nodes]),
        q=np.concatenate([block.q for block in nodes]),
        p=np.concatenate([block.p for block in nodes]),
        h=task.h,
        k=k,
        u=task.u,
        c=task.c,
        functions=lambda scene=system: (step_function(scene, chosen.rule), action_function(scene, chosen.rule)),
        phases=phases,
        phase=phase,
        origin=task.t0,
        events=tuple(sorted(happened, key=lambda event: event.time * np.sign(task.h))),
        stats=MappingProxyType(
            {
                "plan": chosen,
                "backend": "interpreted" if kernel is None else f"compiled: {kernel.about}",
                "steps": int(k[-1]),
                "iterations": sum(block.iterations for block in nodes),
                "residual": max(block.residual for block in nodes),
                "interrupted": interrupted,
                "seconds": perf_counter() - began,
            }
        ),
    )


def _phases(system: System, task: Task, nodes: list[Block]) -> tuple[tuple[Phase, ...], np.ndarray | None]:
    """The phases that occurred, and the one of each node; nothing where all constraints held all the time."""
    each = [block.phase or task.phase for block in nodes]
    if not system.structure.contacts and (each[0] is None or each[0].scene(system) is system):
        return (), None
    phases = tuple(dict.fromkeys(phase for phase in each if phase is not None))
    return phases, np.concatenate([np.full(b.good, phases.index(p)) for b, p in zip(nodes, each, strict=True)])


def _thinned(motion: Trajectory, task: Task, every: int) -> Trajectory:
    """The nodes that were asked for, and those off the grid, where contacts or parts of steps begin anew."""
    if every == task.save_every:
        return motion
    grid = np.abs(motion.t - (task.t0 + task.h * motion.k)) <= rounding(motion) * abs(task.h)
    asked = (motion.k % every == 0) | np.isin(motion.t, [event.time for event in motion.events if event.kind in ABRUPT])
    asked[-1] = True
    return motion[np.flatnonzero(asked | ~grid)]


def _cut(motion: Trajectory, kept: int, t: float) -> Trajectory:
    """The first `kept` nodes of the trajectory, and one more at time t."""
    end = motion.at([t])
    times, q, p, steps = (np.concatenate([getattr(motion, name)[:kept], getattr(end, name)]) for name in "tqpk")
    phase = None if motion.phase is None else np.concatenate([motion.phase[:kept], motion.phase[kept - 1 : kept]])
    before = tuple(event for event in motion.events if (t - event.time) * motion.h >= 0)
    return replace(motion, t=times, q=q, p=p, k=steps, phase=phase, events=before)

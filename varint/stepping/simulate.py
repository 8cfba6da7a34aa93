"""Initial value problems: check the input, run the time loop, return a `Trajectory`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from time import perf_counter
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np

from varint.errors import ConvergenceError, InputError
from varint.manifold import Phase
from varint.progress import progress_bar
from varint.rules import Rule
from varint.stepping.accuracy import for_tolerance
from varint.stepping.backend import blocks_of, kernel_for
from varint.stepping.events import crossings, logged, watched
from varint.stepping.initial import initial_task
from varint.stepping.plan import Plan, plan
from varint.stepping.rescaled import rescaled_motion
from varint.stepping.run import RESIDUAL_LIMIT, Block, Task
from varint.stepping.step_function import action_function, step_function
from varint.system import System
from varint.trajectory import Event, Trajectory

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

    Returns
    -------
    Trajectory

    Raises
    ------
    InputError
        If the input is not a well-posed problem; the message says what to change.
    ConvergenceError
        If a step cannot be solved: step, time, residual, and the trajectory up to there are attached.

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
            return simulate(
                system, chosen, q0=q0, v0=v0, p0=p0, duration=span, steps=count, t0=t0, u=u, params=params,
                save_every=every, tol=level, progress=False, backend=backend,
            )  # fmt: skip

        motion = for_tolerance(whole, system, rule, duration, tol)
        kept = np.unique(np.append(np.arange(0, len(motion), save_every), len(motion) - 1))
        return motion[kept]
    began = perf_counter()
    stops = None if until is None else watched("until", until)
    watches = [watched(name, wanted) for name, wanted in (events or {}).items()]
    noted: list[Event] = []
    chosen = plan(system, rule)
    task = initial_task(
        system, chosen.rule,
        q0=q0, v0=v0, p0=p0, h=h, steps=steps, duration=duration, t0=t0, u=u, params=params, save_every=save_every,
    )  # fmt: skip
    if tol is not None:
        task = replace(task, level=LEVEL * tol)
    if system.structure.contacts:
        from varint.stepping.contact_run import contact_run

        kernel, blocks = None, contact_run(system, chosen.rule, task)
        nodes = [next(blocks)]
    else:
        scene = system if task.phase is None else task.phase.scene(system)
        kernel = kernel_for(scene, chosen.rule, task, backend)
        blocks = blocks_of(scene, chosen.rule, task, kernel)
        nodes = [Block(np.zeros(1, dtype=int), task.q0[None], task.p0[None], 0.0, 1)]
    with progress_bar(task.steps, "step", progress) as count:
        for block in blocks:
            nodes.append(block)
            count(int(block.k[block.good - 1] - nodes[-2].k[-1]) if block.good else 0)
            stop = []
            if watches or stops:
                recent = _trajectory(system, chosen, task, nodes[-2:], began, [])[nodes[-2].good - 1 :]
                noted += [event for watch in watches for event in logged(recent, watch)]
                stop = crossings(recent, stops)[:1] if stops else []
            if stop or block.good < len(block.k):
                motion = _trajectory(system, chosen, task, nodes, began, noted, kernel)
                if stop:
                    return _cut(motion, len(motion) - len(recent) + stop[0][0] + 1, stop[0][1])
                raise _failure(motion, block, task)
    return _trajectory(system, chosen, task, nodes, began, noted, kernel)


def _trajectory(
    system: System,
    chosen: Plan,
    task: Task,
    nodes: list[Block],
    began: float,
    noted: list[Event],
    kernel: Kernel | None = None,
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
        events=tuple(sorted(happened, key=lambda event: event.time * np.sign(task.h))),
        stats=MappingProxyType(
            {
                "plan": chosen,
                "backend": "interpreted" if kernel is None else f"compiled: {kernel.about}",
                "steps": int(k[-1]),
                "iterations": sum(block.iterations for block in nodes),
                "residual": max(block.residual for block in nodes),
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


def _cut(motion: Trajectory, kept: int, t: float) -> Trajectory:
    """The first `kept` nodes of the trajectory, and one more at time t."""
    end = motion.at([t])
    times, q, p, steps = (np.concatenate([getattr(motion, name)[:kept], getattr(end, name)]) for name in "tqpk")
    phase = None if motion.phase is None else np.concatenate([motion.phase[:kept], motion.phase[kept - 1 : kept]])
    before = tuple(event for event in motion.events if (t - event.time) * motion.h >= 0)
    return replace(motion, t=times, q=q, p=p, k=steps, phase=phase, events=before)


def _failure(motion: Trajectory, block: Block, task: Task) -> ConvergenceError:
    k, t = int(motion.k[-1]), float(motion.t[-1])
    residual = block.failed
    if np.isfinite(residual):
        what = f"left a residual of {residual:.1e} (limit {RESIDUAL_LIMIT:g})"
        cure = "h is too large for this motion or the scene is close to singular: try a smaller h"
    else:
        what = "gave values that are not finite"
        cure = "a collision, a square root or logarithm of a negative number, or h too large: try a smaller h"
    return ConvergenceError(
        f"the step after t = {t:g} (step {k}) {what}; {cure}. Error.trajectory has the {len(motion)} nodes before it",
        step=k, time=t, residual=residual, trajectory=motion,
    )  # fmt: skip

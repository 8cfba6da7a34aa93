"""Initial value problems: check the input, run the time loop, return a `Trajectory`."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from time import perf_counter
from typing import Any

import casadi as ca
import numpy as np

from varint.errors import InputError, converted
from varint.grid import checked_steps
from varint.parameters import whole
from varint.rules import Rule
from varint.stepping.course import course_of, thinned, travelled
from varint.stepping.events import watched, watched_events
from varint.stepping.initial import LEVEL, initial_task
from varint.stepping.jump import energy_jump
from varint.stepping.plan import plan
from varint.system import System, require_system
from varint.trajectory import Trajectory


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
        ``"subdivide"`` redoes a step that cannot be solved in 2, 4, … 1024 parts, until they agree with half as many.
        They become nodes, and `Trajectory.events` tells of it; controls within the step are the polynomial through
        those at its nodes. The step changes there, so a symplectic rule loses its long-time guarantees locally: for a
        rare close approach, not for a step that is too large everywhere.

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
    require_system(system)
    if tol is not None and not (isinstance(tol, (float, int)) and 0 < tol < 1):
        raise InputError(f"tol must be a relative error between 0 and 1, got {tol!r}")
    if time_scale is not None:
        if u is not None:
            raise InputError("time_scale takes no controls u: they change the energy that it is built on")
        _require_whole("time_scale", checkpoint, on_failure)
        from varint.stepping.rescaled import rescaled_motion

        return rescaled_motion(
            system, rule, time_scale, q0=q0, v0=v0, p0=p0, h=h, steps=steps, duration=duration, t0=t0, params=params,
            save_every=save_every, until=until, events=events, progress=progress, backend=backend, tol=tol,
        )  # fmt: skip
    if tol is not None and h is None and steps is None:
        stopped = until is not None or bool(watched_events(events))
        table = converted(
            lambda: np.array(u, dtype=float).ndim > 1, lambda: f"u must be numbers, got {type(u).__name__}"
        )
        if duration is None or stopped or table or system.structure.contacts:
            raise InputError(
                "tol without h chooses the steps of a whole run: give duration, constant controls, and neither until "
                "nor events nor contacts"
            )

        _require_whole("tol without h", checkpoint, on_failure)
        save_every = whole("save_every", save_every)
        from varint.stepping.accuracy import for_tolerance

        motion = for_tolerance(
            system, rule, duration=duration, tol=tol, q0=q0, v0=v0, p0=p0, t0=t0, u=u, params=params, backend=backend
        )
        return motion if save_every == 1 else thinned(motion, save_every)
    began = perf_counter()
    stop = None if until is None else watched("until", until)
    watches = watched_events(events)
    chosen = plan(system, rule)
    task = initial_task(
        system, chosen.rule,
        q0=q0, v0=v0, p0=p0, h=h, steps=steps, duration=duration, t0=t0, u=u, params=params, save_every=save_every,
        level=0.0 if tol is None else LEVEL * tol,
    )  # fmt: skip
    checked_steps(task.t0, task.h, task.steps)
    file = None
    if checkpoint is not None:
        from varint.stepping.checkpoint import checkpoint_of

        words = dict(until=repr(until), events=repr(events), backend=backend, on_failure=on_failure)
        file = checkpoint_of(checkpoint, system, chosen.rule, task, **words)
    if stop or watches:
        task = task._replace(save_every=1)  # every node is looked at; those not asked for are dropped at the end
    course = course_of(system, chosen, task, began, backend=backend, on_failure=on_failure, file=file)
    motion = travelled(course, stop=stop, watches=watches, file=file, progress=progress, on_failure=on_failure)
    if jump := energy_jump(motion):
        warnings.warn(jump.alarm(motion.h), stacklevel=2)
    return motion if save_every == task.save_every else thinned(motion, int(save_every))


def _require_whole(what: str, checkpoint: Any, on_failure: str) -> None:
    """Refuse what these runs would otherwise silently leave undone."""
    if checkpoint is not None or on_failure != "raise":
        given = "checkpoint" if checkpoint is not None else "on_failure"
        raise InputError(f"{what} takes no {given}: leave it out, or give h and steps alone")

"""Initial value problems: check the input, run the time loop, return a `Trajectory`."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping
from functools import cache, partial
from time import perf_counter
from types import ModuleType
from typing import Any

import casadi as ca
import numpy as np

from varint.codegen.built import built_module
from varint.errors import ConvergenceError, InputError
from varint.integration.asked_times import only_at, until_last
from varint.integration.fixed_steps import over_switches_after, simulate_steps
from varint.integration.problem import LEVEL, RunOptions, Start, check_tolerance
from varint.results.trajectory import Trajectory
from varint.rules.rule import Rule
from varint.scene.inputs import times_of
from varint.scene.parameters import ParameterValues
from varint.scene.system import System, require_system

_FLOAT64 = np.float64


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
    params: ParameterValues | None = None,
    save_every: int = 1,
    at: Any = None,
    until: ca.SX | tuple[ca.SX, int] | None = None,
    events: Mapping[str, Any] | None = None,
    time_scale: ca.SX | str | None = None,
    tol: float | None = None,
    scale: Any = None,
    iteration_tol: float | None = None,
    progress: bool | None = None,
    backend: str = "auto",
    checkpoint: Any = None,
    on_failure: str = "raise",
) -> Trajectory:
    """Motion from initial values, D2 L_d(q_{k−1}, q_k) + D1 L_d(q_k, q_{k+1}) = 0 (discrete
    Euler–Lagrange).

    Parameters
    ----------
    system : System
    rule : Rule, optional
        Default: an explicit composition for separable scenes with constant mass, else `gauss(2)`;
        see `default_rule`. For a tolerance: the one that is likely to be cheapest.
    q0 : array (n,)
        Start coordinates.
    v0, p0 : array (n,)
        Start velocities or momenta ∂L/∂v, one of the two (neither for a degenerate Lagrangian).
    h, steps, duration : float, int, float
        Step size, number of steps, total time: two of the three, or the duration alone, where rule
        (if none is given) and steps are chosen for the accuracy `tol`. A negative h runs backwards.
        Steps end at impacts of contacts, and beside them where forces jump or kink.
    t0 : float
        Start time.
    u : array (steps, k) or (steps, r, k) or (k,), optional
        Controls: one value a step, one at each of the rule's r nodes, or the same all the time.
        Where steps are chosen, rows of a table follow one another over the duration, each over as
        many steps; `Trajectory.u` has the controls of these.
    params : dict, optional
        Parameter values that differ from the defaults, by name or symbol.
    save_every : int
        Keep every so many steps (the last step is always kept).
    at : array (k,), optional
        Times that become the nodes of the result, in place of the run's own: between two of its own
        the state is a shorter step of the same rule. Later and later ones; the run lasts until the
        last of them if nothing else is said. ``simulate(..., at=times)`` alone runs to the accuracy
        1e-9.
    until : SX or (SX, int), optional
        Stop where this expression of q, v, t and the parameters crosses zero; the last node is the
        crossing, located with the rule's own accuracy. With a direction: +1 only where it rises, -1
        only where it falls.
    events : dict of SX or (SX, int), optional
        Log where these expressions cross zero: `Trajectory.events` has a record with the time and
        the name of each. Every step is watched, whatever `save_every` keeps. Native and compiled
        runs are searched in C, some microseconds a crossing; those with contacts or controls that
        vary within steps, and interpreted ones, by NumPy, some tens of microseconds each and a
        millisecond a run.
    time_scale : SX or "auto", optional
        σ(q) > 0 of variable steps that keep the structure: h is the step of the fictitious time τ,
        dt = σ(q) dτ, the nodes' ``t`` are physical times, and `duration` is physical too (the last
        step ends there). Give h and either steps or duration; see `close_encounters`. ``"auto"`` is
        σ = 1/ω with the scene's own local rate ω(q), from ∂a/∂q: h is then the angle in radians by
        which the fastest small motions turn in a step, the same number for all scenes (0.5 to 1
        for `gauss(8)`). It takes scenes without constraints whose forces' change depends on
        q alone; where inertia varies, as in polar coordinates, the speed that the start's energy
        leaves is part of the rate. Scenes that depend on time may have σ(q, t).
    tol : float, optional
        Wanted error of every coordinate at every node, divided by its `scale`. With `duration`
        alone it is 1e-9. Rule (where none is given) and number of steps are found by runs that
        come together; where the scene's time scale varies much, as in close encounters, steps
        follow it as with ``time_scale="auto"``. Steps grow where a motion settles under forces
        that do not depend on time, and where stiff dampers have stopped what they stop at once;
        they are shorter where forces bend sharply with the velocity, as friction that is rounded,
        or runs of few equal steps are lost (`Trajectory.sizes`), unless more than its nodes is
        asked for and no dampers are stiff: events, an end, every so many nodes. Linear scenes with
        stiff dampers, where no more is asked for and nothing drives them, take steps that resolve
        these, and nodes many steps apart (`Trajectory.k`). Where forces or potentials jump or kink,
        steps end there, and dry friction holds what it stops. ``stats["error_estimate"]`` is what
        the runs' differences say, with a warning where that stays above tol, as round-off and chaos
        may have it.
    scale : float or array (n,), optional
        What errors of the coordinates are divided by. Default: the range of each coordinate during
        the motion (of a body's x, y, z together; of an angle at most a radian).
    iteration_tol : float, optional
        With h or steps: end compiled iterations where they no longer matter for a motion of this
        accuracy, in place of round-off. The invariants are then kept to the same accuracy only.
    progress : bool, optional
        Show a progress bar. Default: in a terminal, for runs longer than a second.
    backend : {"auto", "native", "compiled", "interpreted"}
        ``"native"``: the scene's operations are data for a loop that is there; ``"compiled"``: the
        scene is compiled first, for the same bytes in less time. By default a run begins native
        and shifts up where that repays the compiler; constraints on an L that is not quadratic in
        v, very large scenes, and contacts beside controls are interpreted or compiled. An
        ``"interpreted"`` run whose steps are so long that their solution hangs on the way to it
        (more than four iterations) is done natively from its start, for the same bytes.
    checkpoint : path, optional
        Write the run to this file. After the end the same call returns the whole run at once, with
        the same bytes as a run that was not stopped. With h or steps it is written every second or
        so, and after a crash, a kill or Ctrl-C the same call goes on from there. A run whose steps
        are chosen is written once it has been found, whatever they are; a call that ends before
        that is made anew. One run a file, one process a run.
    on_failure : {"raise", "subdivide"}
        ``"subdivide"`` redoes a step that cannot be solved in 2, 4, … 1024 parts, until they agree
        with half as many. They become nodes, and `Trajectory.events` tells of it; controls within
        the step are the polynomial through those at its nodes. Where steps are chosen, all of them
        are solved, and nothing changes. The step changes there, so a
        symplectic rule loses its long-time guarantees locally: for a rare close approach, not for a
        step that is too large everywhere.

    Returns
    -------
    Trajectory
        After Ctrl-C the nodes until then, with ``stats["interrupted"]`` true; where steps are still
        being chosen, there is nothing to return, and Python's KeyboardInterrupt goes on.

    Raises
    ------
    InputError
        If the input is not a well-posed problem; the message says what to change.
    ConvergenceError
        If a step cannot be solved: step, time, residual, likely cause and the trajectory up to
        there are attached.

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
    if type(system) is not System:
        require_system(system)
    motion = _repeated_call()(
        system,
        rule,
        q0,
        v0,
        p0,
        h,
        steps,
        duration,
        t0,
        u,
        params,
        save_every,
        at,
        until,
        events,
        time_scale,
        tol,
        scale,
        iteration_tol,
        progress,
        backend,
        checkpoint,
        on_failure,
    )
    if motion is not None:
        return motion
    began, tried, times = perf_counter(), None, None
    if at is not None:
        times = times_of(at)
        grid = until_last(times, t0, save_every, (h, steps, duration), time_scale is not None)
        h, steps, duration = grid
    plain = (
        scale is None  # one by one: in less time than as a chain
        and checkpoint is None
        and (progress is None or progress is False)
        and type(save_every) is int
        and on_failure == "raise"
    )
    moving = plain and until is None and events is None and u is None
    moving = moving and (p0 is None) != (v0 is None)
    scaled = moving and p0 is None and at is None and time_scale is not None
    if scaled and tol is None and steps is None:
        run = h, duration, t0, iteration_tol, save_every, backend
        motion = _physical_call()(system, rule, time_scale, q0, v0, params, run, began)
        if motion is not None:
            return motion
    stepped = h is not None or steps is not None
    if tol is None:
        clear = iteration_tol is None or (
            h is not None and type(iteration_tol) is float and 0 < iteration_tol < 1
        )
    else:
        clear = iteration_tol is None and not stepped and type(tol) is float and 0 < tol < 1
    if not clear:
        tol, iteration_tol = _tolerances(tol, iteration_tol, stepped)
    if type(h) is _FLOAT64 or type(duration) is _FLOAT64 or type(t0) is _FLOAT64:
        h, duration, t0 = map(_own, (h, duration, t0))  # as Python's own they go the short ways
    if not (events is None or type(events) is dict):
        from varint.integration.events.crossings import parse_watches

        parse_watches(events)  # refuses what is no mapping
    again: partial[Trajectory] | None = None
    if not (stepped or (u is None and checkpoint is None)):
        same: dict[str, Any] = {"q0": q0, "v0": v0, "p0": p0, "duration": duration, "t0": t0}
        how: dict[str, Any] = {"tol": tol, "scale": scale, "progress": progress, "at": at}
        how |= {"save_every": save_every, "backend": backend, "on_failure": on_failure}
        again = partial(simulate, rule=rule, **same, **how)
    if again and u is not None and time_scale is None:
        from varint.integration.steady_controls import with_steady_controls

        kept = partial(again, checkpoint=checkpoint)
        motion = with_steady_controls(system, u, params, (until, events), kept)
        if motion is not None:
            return motion
    if plain and time_scale is None and backend == "auto":
        if stepped:
            known, grid = (q0, v0, p0, t0, params, u), (h, steps, duration)
            few_steps_call, watched = _few_steps().few_steps_call, (until, events)
            level = 0.0 if iteration_tol is None else LEVEL * iteration_tol
            how_few = save_every, level, began, watched
            tried = few_steps_call(system, rule, known, grid, *how_few)
        elif moving and save_every == 1:
            begin, call = (q0, v0, t0, params), _short_call().short_call
            tried = call(system, rule, begin, p0, duration, tol, began, None, times)
        elif save_every == 1 and u is None and (p0 is None) != (v0 is None):
            begin = q0, v0, t0, params
            if until is not None:
                asked = duration, tol, began, (until, events)
                tried = _until_call().call_until(system, rule, begin, p0, *asked)
            else:
                tried = _short_call().short_call(
                    system, rule, begin, p0, duration, tol, began, events, times
                )
        elif save_every == 1 and until is None and not events and (p0 is None) != (v0 is None):
            begin = q0, v0, t0, params
            tried = _table_call().table_call(system, rule, begin, p0, duration, tol, u, began)
        if type(tried) is Trajectory:
            return tried if times is None else only_at(tried, times)
    start = Start(q0, v0, p0, t0, params, u)
    options = RunOptions(
        h,
        steps,
        duration,
        tol,
        scale,
        iteration_tol,
        save_every,
        until,
        events,
        progress,
        backend,
        checkpoint,
        on_failure,
    )
    if time_scale is not None:
        if u is not None:
            raise InputError(
                "time_scale takes no controls u: they change the energy that it is built on"
            )
        if given := _asked_of_steps(options):
            raise InputError(f"time_scale takes no {given}: leave one of them out")
        from varint.integration.time_transformation.transformed_run import simulate_transformed

        motion = simulate_transformed(system, rule, time_scale, start, options)
    elif h is None and steps is None:
        if again and checkpoint is not None:
            from varint.integration.kept import kept_motion

            make = partial(again, system, u=u, params=params, until=until, events=events)
            return kept_motion(make, system, rule, start, options, times, began)
        motion = _to_tolerance().simulate_to_tolerance(system, rule, start, options, tried, began)
    else:
        try:
            motion = simulate_steps(system, rule, start, options)
        except ConvergenceError as failure:
            motion = over_switches_after(failure, system, rule, start, options)
    return motion if times is None else only_at(motion, times)


@cache
def _repeated_call() -> Callable[..., Trajectory | None]:
    """(the arguments of `simulate`) → its motion, if it was asked for before; see c/repeated.h."""
    built = built_module()
    return _not_repeated if built is None else built.repeated  # type: ignore[no-any-return]


def _not_repeated(*_: Any) -> None:
    return None


@cache
def _few_steps() -> ModuleType:
    """Loaded when asked for, as are those below; to ask again takes a short run's time."""
    from varint.integration import few_steps

    return few_steps


@cache
def _short_call() -> ModuleType:
    from varint.integration import short_call

    return short_call


@cache
def _until_call() -> ModuleType:
    from varint.integration import until_call

    return until_call


@cache
def _table_call() -> ModuleType:
    from varint.integration import table_call

    return table_call


@cache
def _physical_call() -> Callable[..., Trajectory | None]:
    from varint.integration.time_transformation import physical_call

    return physical_call.physical_call


@cache
def _to_tolerance() -> ModuleType:
    from varint.integration import to_tolerance

    return to_tolerance


def _own(x: Any) -> Any:
    return float(x) if type(x) is _FLOAT64 else x


def _tolerances(
    tol: float | None, iteration_tol: float | None, stepped: bool
) -> tuple[float | None, float | None]:
    """tol and iteration_tol; tol beside h or steps is the old name of the latter."""
    for name, x in (("tol", tol), ("iteration_tol", iteration_tol)):
        if x is not None:
            check_tolerance(name, x)
    if not stepped and iteration_tol is not None:
        raise InputError(
            "iteration_tol goes with h or steps; where tol chooses the steps it chooses where "
            "iterations end, too"
        )
    if not stepped or tol is None:
        return tol, iteration_tol
    if iteration_tol is not None:
        raise InputError(
            "tol chooses the steps: leave h and steps out, or tol, and keep iteration_tol"
        )
    warnings.warn(
        f"tol with h or steps is called iteration_tol now: write iteration_tol={tol:g}; tol is the "
        "accuracy wanted of the motion, and chooses the steps",
        DeprecationWarning,
        stacklevel=3,
    )
    return None, tol


def _asked_of_steps(options: RunOptions) -> str:
    """What only a run with steps given beforehand can do, in the user's words; empty if nothing."""
    if options.checkpoint is not None:
        return "checkpoint"
    return "on_failure" if options.on_failure != "raise" else ""

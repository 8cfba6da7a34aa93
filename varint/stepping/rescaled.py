"""Structure-preserving variable steps: fixed steps in a fictitious time τ with dt = σ(q) dτ.

The Lagrangian ``L̂(q, q') = σ(q) (L(q, q'/σ) + E0)`` has the same paths on the energy level E0 and the same momenta
(Sundman; Hairer, Lubich & Wanner, Geometric Numerical Integration, VIII.2: the Poincaré transform σ (H − E0)). The
physical time is one more coordinate, with ``½ (t' − σ)² + σ0 t'`` added to L̂: its momentum t' − σ + σ0 is conserved
and starts as σ0, so t' = σ and the other equations do not notice. The result is an ordinary `System`: every rule and
stepper applies.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np

from varint.arrays import call
from varint.errors import ConvergenceError, InputError
from varint.legendre import velocity_function
from varint.rules import Rule
from varint.stepping.initial import initial_task, number
from varint.stepping.plan import default_rule
from varint.stepping.step_function import action_function, step_function
from varint.system import Parameters, System, coordinates
from varint.trajectory import Event, Trajectory, own_symbols

# names that no scene of a user's has; σ0 t' changes no motion, but round-off in t' − σ has a momentum to compare with
TIME, ENERGY, START = "physical time", "initial energy", "initial time scale"
FIRST_CHUNK = 64  # steps before the mean rate of the clock is known well enough to look further ahead
PATIENCE = 8  # times the steps that the pace of the start would take
MARGIN = 1.02  # more steps than that rate asks for: they are cheaper than another look
LOCATED = 4 * np.finfo(float).eps  # relative to |t|
MOST_ITERATIONS = 60
OFF_LEVEL = 0.1  # of the largest kinetic energy: the motion is another one
MOST_SCALES = 32  # rescaled scenes remembered for one system


@dataclass(frozen=True, eq=False)
class Rescaled:
    """A scene in fictitious time: coordinates (q, t), parameters (c, E0, σ0).

    Attributes
    ----------
    system : System
    translate : callable
        Expression of q, v, t, c of the original scene → the same in symbols of the rescaled one.
    energy : Function
        (q, p, t, c) → energy E0, velocities, and σ.
    """

    system: System
    translate: Callable[[ca.SX], ca.SX]
    energy: ca.Function


def close_encounters(distances: Any, power: float = 1.5) -> ca.SX:
    """A time scale for close encounters, ``σ = (Σ_k r_k⁻²)^(−power/2)``: with one distance σ = r^power.

    The closest pair sets the pace, smoothly. With the power 3/2 a fixed step in fictitious time is the same fraction of
    the local time of free fall in a 1/r potential everywhere, however close the encounter.

    Parameters
    ----------
    distances : SX (k,) or list of SX
        Distances that may become small, as expressions of q.
    power : float

    Returns
    -------
    SX
        For ``simulate(..., time_scale=...)``.

    Raises
    ------
    InputError
        If there is no distance, or the power is not positive.

    Examples
    --------
    >>> import casadi as ca
    >>> import varint as vi
    >>> model = vi.models.kepler(e=0.9)
    >>> scale = vi.close_encounters(ca.norm_2(model.system.q))
    >>> orbit = vi.simulate(model.system, vi.gauss(8), q0=model.q0, v0=model.v0, h=0.55, duration=20 * 3.14159,
    ...                     time_scale=scale)
    >>> q, v = model.exact(orbit.t)
    >>> bool(abs(orbit.q - q).max() < 1e-10)
    True
    """
    if not isinstance(distances, (ca.SX, list, tuple)):
        raise InputError(f"distances must be SX expressions of q, got {type(distances).__name__}")
    r = ca.vertcat(*distances) if isinstance(distances, (list, tuple)) else ca.vec(distances)
    if not r.numel() or not power > 0:
        raise InputError(f"close_encounters needs one distance or more and a positive power, got {r.shape} and {power}")
    return ca.sum1(ca.densify(r) ** -2.0) ** (-power / 2) if r.numel() > 1 else r**power


def rescaled(system: System, sigma: Any) -> Rescaled:
    """The scene with the time scale σ(q); scenes already seen are remembered."""
    sigma = _checked(system, sigma)
    known = system.__dict__.setdefault("_rescaled", {})
    key = ca.Function("sigma", [system.q, system.c], [sigma]).serialize()
    if key not in known:
        if len(known) >= MOST_SCALES:
            known.clear()
        known[key] = _built(system, sigma)
    return known[key]


def _checked(system: System, sigma: Any) -> ca.SX:
    s = system.structure
    reasons = {
        "the scene depends on time explicitly": not s.autonomous,
        "forces change the energy": s.forced,
        "contacts interrupt the motion": bool(s.contacts),
        "the Lagrangian is degenerate": s.degenerate,
    }
    for reason, holds in reasons.items():
        if holds:
            raise InputError(
                f"time_scale needs the energy of the start all along, but {reason}; leave time_scale out and choose a "
                "smaller h"
            )
    sigma = own_symbols(sigma, system, "time_scale")
    if sigma.numel() != 1:
        raise InputError(f"time_scale must be a scalar expression of q and the parameters, it has shape {sigma.shape}")
    strange = [x.name() for x in ca.symvar(ca.vertcat(system.v, system.t)) if ca.depends_on(sigma, x)]
    if strange:
        raise InputError(f"time_scale may depend on q and the parameters alone, not on {strange}")
    return sigma


def _built(system: System, sigma: ca.SX) -> Rescaled:
    params = Parameters(**system.defaults, **{ENERGY: 0.0, START: 1.0})
    q, v = coordinates(*system.names, TIME)
    n = system.q.numel()
    symbols = [system.q, system.c]
    constants = (ca.vec(getattr(params, name)) for name in system.defaults)
    own = [q[:n], ca.vertcat(ca.SX(0, 1), *constants)]
    (scale,) = ca.substitute([sigma], symbols, own)
    before, after = [*symbols, system.v, system.t], [*own, v[:n] / scale, q[n]]

    def translate(expression: ca.SX) -> ca.SX:
        return ca.substitute([expression], before, after)[0]

    clock = (v[n] - scale) ** 2 / 2 + getattr(params, START) * v[n]
    lagrangian = scale * (translate(system.lagrangian) + getattr(params, ENERGY)) + clock
    rows = translate(system.nonholonomic)
    rows = ca.horzcat(rows, ca.SX(rows.shape[0], 1))
    new = System(q, v, lagrangian, constraint=translate(system.constraint), nonholonomic=rows, params=params)
    energy = ca.Function("start_energy", [system.q, system.v, system.t, system.c], [system.energy, sigma])
    return Rescaled(new, translate, energy)


def rescaled_motion(
    run: Callable[..., Trajectory], system: System, rule: Rule | None, sigma: Any, *, q0: Any, v0: Any, p0: Any,
    h: float | None, steps: int | None, duration: float | None, t0: float, params: Any, save_every: int, until: Any,
    events: Any, options: dict[str, Any],
) -> Trajectory:  # fmt: skip
    """`simulate` with a time scale: h is the step of τ, dt = σ(q) dτ; nodes at physical times."""
    scene = rescaled(system, sigma)
    if h is None or (steps is None) == (duration is None):
        raise InputError("with time_scale give h, the step of the fictitious time, and either steps or duration")
    total = None if duration is None else number("duration", duration)
    if total is not None and not total * number("h", h) > 0:
        raise InputError(f"h={h} and duration={duration} must have the same sign and not be zero")
    task = initial_task(
        system, rule or default_rule(scene.system), q0=q0, v0=v0, p0=p0, h=h, steps=1 if steps is None else steps,
        duration=None, t0=t0, u=None, params=params, save_every=save_every,
    )  # fmt: skip
    t = np.array([task.t0])
    velocity = (
        call(velocity_function(system), task.q0, task.p0, t, task.c)[0] if v0 is None else np.array(v0, float).ravel()
    )
    (energy,), (start_scale,) = call(scene.energy, task.q0, velocity, t, task.c)
    if not (np.isfinite(start_scale) and start_scale > 0):
        raise InputError(f"time_scale must be positive, but it is {start_scale:g} at the start")
    values = dict(params or {}) | {ENERGY: energy, START: start_scale}
    clock = scene.system.q[-1]

    def watched(wanted: Any, what: str) -> Any:
        expression, *direction = wanted if isinstance(wanted, tuple) else (wanted,)
        inside = scene.translate(own_symbols(expression, system, what))
        inside = ca.substitute(inside, clock, clock + task.t0) if task.t0 else inside
        return (inside, *direction) if direction else inside

    stop = None if until is None else watched(until, "until")
    watches = {name: watched(wanted, name) for name, wanted in (events or {}).items()}

    def advance(inner: Trajectory | None, count: int) -> Trajectory:
        state = (
            (np.append(task.q0, 0.0), np.append(task.p0, start_scale)) if inner is None else (inner.q[-1], inner.p[-1])
        )
        at = 0.0 if inner is None else float(inner.t[-1])
        try:
            more = run(
                scene.system, rule, q0=state[0], p0=state[1], h=task.h, steps=count, t0=at, params=values,
                save_every=save_every, until=stop, events=watches, **options,
            )  # fmt: skip
        except ConvergenceError as error:
            found = _joined(inner, error.trajectory)
            motion = _physical(system, task.t0, found)
            raise ConvergenceError(
                f"in fictitious time (dt = σ dτ): {error}; it is physical time t = {motion.t[-1]:g}",
                step=int(found.k[-1]), time=float(motion.t[-1]), residual=error.residual, trajectory=motion,
            ) from None  # fmt: skip
        return _joined(inner, more)

    if total is None:
        inner = advance(None, task.steps)
    else:
        inner = _for_duration(scene, advance, total, task.h, start_scale, save_every, stop is not None)
    _require_level(scene, inner)
    return replace(_physical(system, task.t0, inner), events=_happened(system, task.t0, inner))


def _happened(system: System, t0: float, inner: Trajectory) -> tuple[Event, ...]:
    """The events up to the last node, at physical times."""
    before = [event for event in inner.events if (inner.t[-1] - event.time) * inner.h >= 0]
    if not before:
        return ()
    at = _physical(system, t0, inner.at([event.time for event in before]))
    return tuple(
        replace(event, time=float(t), energy_before=float(e), energy_after=float(e))
        for event, t, e in zip(before, at.t, at.energy, strict=True)
    )


def _for_duration(
    scene: Rescaled, advance, total: float, h: float, scale: float, every: int, may_stop: bool
) -> Trajectory:
    """Steps until the physical time `total`, with one shorter step at the end."""
    expected = total / (h * scale)
    inner: Trajectory | None = None
    ahead: float = min(FIRST_CHUNK, math.ceil(MARGIN * expected))
    while True:
        asked = max(1, math.ceil(ahead / every)) * every
        before = 0 if inner is None else int(inner.k[-1])
        inner = advance(inner, asked)
        if inner.q[-1, -1] / inner.t[-1] <= 0:
            return inner
        if abs(inner.q[-1, -1]) >= abs(total) or (may_stop and inner.k[-1] < before + asked):
            break
        done = int(inner.k[-1])
        if done > PATIENCE * (expected + FIRST_CHUNK):  # does the clock stand still where σ vanishes?
            _require_level(scene, inner)
        ahead = min(MARGIN * (total - inner.q[-1, -1]) / (inner.q[-1, -1] / done) + 1, 4 * done)
    if abs(inner.q[-1, -1]) < abs(total):
        return inner
    kept = int(np.searchsorted(np.abs(inner.q[:, -1]), abs(total) * (1 - LOCATED)))  # nodes before the end
    last = inner[kept - 1 : kept]
    end = _reached(last, inner[kept : kept + 1], np.array([total]))
    return _appended(inner[:kept], end)


def _require_level(scene: Rescaled, inner: Trajectory) -> None:
    """Time must go on, and the motion stay on the energy level that σ (H − E0) = 0 means as long as σ is not near 0."""
    n = inner.q.shape[1] - 1
    passed = np.diff(inner.q[:, n])
    pace = passed / np.diff(inner.t)
    slowest = int(np.argmin(pace))
    if not pace[slowest] > 0:
        raise InputError(
            f"time_scale must stay positive, but after t = {inner.q[slowest, n]:g} it is not: time does not go on"
        )
    kinetic = np.abs((inner.p[:-1, :n] * np.diff(inner.q[:, :n], axis=0)).sum(axis=1) / passed).max()
    c, start = inner.c[:-2].copy(), inner.c[-2]
    for i in (slowest, slowest + 1):
        energy = call(scene.energy, inner.q[i, :n].copy(), inner.v[i, :n] / inner.v[i, n], np.zeros(1), c)[0][0]
        if not abs(energy - start) <= OFF_LEVEL * kinetic:
            raise InputError(
                f"the energy is {energy:g} at t = {inner.q[i, n]:g} and was {start:g} at the start: time_scale comes "
                "too close to zero there, or h is too large; choose another time_scale or a smaller h"
            )


def _joined(inner: Trajectory | None, more: Trajectory) -> Trajectory:
    if inner is None:
        return more
    joined = _appended(inner, replace(more, k=more.k + inner.k[-1])[1:])
    stats = dict(more.stats) | {
        name: pick((inner.stats[name], more.stats[name]))
        for name, pick in (("steps", sum), ("seconds", sum), ("residual", max))
        if name in inner.stats and name in more.stats
    }
    return replace(joined, stats=stats, events=inner.events + more.events)


def _appended(first: Trajectory, second: Trajectory) -> Trajectory:
    fields: tuple = ("t", "q", "p", "k") + (() if first.phase is None else ("phase",))
    joined: dict[str, Any] = {n: np.concatenate([getattr(first, n), getattr(second, n)]) for n in fields}
    return replace(first, **joined)


def _reached(left: Trajectory, right: Trajectory, times: np.ndarray) -> Trajectory:
    """Nodes of the rescaled motion where its clock shows `times`, each between a node of `left` and one of `right`.

    τ(t) by Hermite's cubic, then Newton's method on the clock with the rule's own sub-steps, dt/dτ = σ.
    """
    a, b = left.t, right.t
    ta, tb, sa, sb = left.q[:, -1], right.q[:, -1], left.v[:, -1], right.v[:, -1]
    x = (times - ta) / (tb - ta)
    rise = b - a
    tau = a + x**2 * (3 - 2 * x) * rise + (tb - ta) * (x * (1 - x) ** 2 / sa - x**2 * (1 - x) / sb)
    low, high = a.copy(), b.copy()
    for _ in range(MOST_ITERATIONS):
        found = left.advanced(tau)
        off = times - found.q[:, -1]
        step = off / found.v[:, -1]
        good = np.abs(off) <= LOCATED * np.maximum(np.abs(times), np.abs(tb - ta))
        good |= np.abs(step) <= LOCATED * np.maximum(np.abs(tau), np.abs(rise))
        if good.all():
            break
        short = step * rise > 0
        low, high = np.where(short, tau, low), np.where(short, high, tau)
        tau = np.where(good, tau, tau + step)
        tau = np.where((tau - low) * (high - tau) < 0, (low + high) / 2, tau)
    return found


def at_times(motion: Trajectory, times: np.ndarray) -> Trajectory:
    """The physical motion at physical times, from its motion in fictitious time."""
    inner = motion.fictitious
    assert inner is not None
    clock = inner.q[:, -1]
    direction = 1.0 if inner.h > 0 else -1.0
    wanted = times - motion.t[0] + clock[0]
    node = np.searchsorted(direction * clock, direction * wanted, side="right") - 1
    node = np.clip(node, 0, max(len(inner) - 2, 0))
    found = _reached(inner[node], inner[np.minimum(node + 1, len(inner) - 1)], wanted)
    return replace(_physical(motion.system, motion.t[0] - clock[0], found), t=times, events=())


def _physical(system: System, t0: float, inner: Trajectory) -> Trajectory:
    """The motion in physical time; the motion in fictitious time stays with it."""
    n, rule = system.q.numel(), inner.rule
    return replace(
        inner,
        system=system,
        t=t0 + inner.q[:, n],
        q=inner.q[:, :n],
        p=inner.p[:, :n],
        c=inner.c[:-2],
        functions=lambda scene=system: (step_function(scene, rule), action_function(scene, rule)),
        events=(),
        fictitious=inner,
    )

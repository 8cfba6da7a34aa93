"""Derivatives of when an event comes, and of the state in which it finds the motion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from varint.errors import InputError
from varint.integration.trajectories import ABRUPT
from varint.numerics.arrays import call
from varint.results.records import Event, State
from varint.results.trajectory import Trajectory
from varint.scene.expressions import in_own_symbols
from varint.scene.system import System
from varint.sensitivities.carrier import Carrier
from varint.sensitivities.carry import carried_on, carried_through
from varint.sensitivities.course import legs
from varint.sensitivities.impacts import crossing_slopes, to_event
from varint.sensitivities.parts import Slopes, part_slopes
from varint.sensitivities.pieces import OFF_GRID
from varint.sensitivities.rescaled import in_rescaled_symbols, inner_of
from varint.sensitivities.start import slopes_of, state_function
from varint.sensitivities.steps_at_once import Directions, Sweeper
from varint.sensitivities.tangents import asked_directions, begun, wanted_of
from varint.sensitivities.within import (
    clock_of,
    controls_at,
    moved,
    part_of_step,
    parts_of,
    speeds,
)

APART = 1e-6  # of a step: times of the same event, found twice
NOT_ZERO = 1e-6  # of its change in a step and with the state: so large it is another expression


@dataclass(frozen=True, eq=False)
class EventSensitivity:
    """Derivatives of an event, a column for each number that was varied.

    Attributes
    ----------
    time : ndarray (m,)
        Of when it comes.
    before, after : ndarray (o, m)
        Of the outputs then, as the motion comes there and as it goes on: they differ at impacts.
    """

    time: np.ndarray
    before: np.ndarray
    after: np.ndarray


def event_sensitivity(
    motion: Trajectory,
    event: Event | None = None,
    wrt: Sequence[Any] = ("q0", "v0"),
    *,
    expression: Any = None,
    outputs: Any = None,
    backend: str = "auto",
) -> EventSensitivity:
    """Exact derivatives of the time of an event and of the state there, ∂t*/∂θ and ∂(q, v)*/∂θ.

    With e(x, t) = 0 at the event, δt* = −(e_x δx + e_t δt)/ė; a blow x⁺ = R(x, t) then makes δx⁺ =
    R_x δx* + R_t δt*. It is the event of the discrete motion, located in a part of a step.

    Parameters
    ----------
    motion : Trajectory
        From `simulate`.
    event : Event, optional
        One of ``motion.events``. Default: the end of a run with ``until=``.
    wrt : sequence
        As in `sensitivity`.
    expression : SX, optional
        What crosses zero there: what was given as ``until`` or in ``events``. Impacts and
        detachments do without.
    outputs : SX (o,), optional
        Expression of q, v, t and parameters. Default: q and v.
    backend : {"auto", "compiled", "native", "interpreted"}
        As in `simulate`.

    Returns
    -------
    EventSensitivity

    Raises
    ------
    InputError
        If the event is none of the run, or the expression is missing or not zero there.
    ConvergenceError
        If the motion grazes: the event's rate ė is zero, and it has no derivative.

    Notes
    -----
    Leine & Nijmeijer, Dynamics and Bifurcations of Non-Smooth Mechanical Systems, 2004, §7.2
    (saltation matrix).

    Examples
    --------
    >>> import varint as vi
    >>> q, v = vi.coordinates("y")
    >>> ball = vi.System(q, v, v**2 / 2 - q, contact=q, restitution=0.5)
    >>> motion = vi.simulate(ball, q0=0.5, v0=0.0, h=0.1, steps=12)
    >>> hit = vi.event_sensitivity(motion, motion.events[0], ["q0"])  # t = √(2 q0), v = −√(2 q0)
    >>> [round(float(x), 9) for x in (hit.time[0], hit.before[1, 0], hit.after[1, 0])]
    [1.0, -1.0, 0.5]
    """
    asked, wanted = asked_directions(motion, wrt), wanted_of(motion.system, outputs)
    if event is not None and event not in motion.events:
        raise InputError(f"{event!r} is none of the events of this run")
    inner, carried = inner_of(motion), begun(motion, asked, backend)
    if motion.fictitious is not None:
        wanted = in_rescaled_symbols(motion, wanted)
        event = None if event is None else inner.events[motion.events.index(event)]
    found = _of_impact(carried, _impact_at(inner, event), wanted)
    if found is None:
        crossing = _crossing(motion, expression)
        found = _of_crossing(carried, _instant(inner, event), crossing, wanted)
    return found


def _impact_at(motion: Trajectory, event: Event | None) -> Event | None:
    """The impact or detachment that the event is, or that makes the jump at which it happens."""
    if event is not None and event.kind in ABRUPT:
        return event
    if event is not None and event.p_before == event.p_after:
        return None
    time = motion.t[-1] if event is None else event.time
    blows = [x for x in motion.events if x.kind in ABRUPT and x.time == time]
    return blows[0] if blows else None


def _instant(motion: Trajectory, event: Event | None) -> State:
    return motion[-1] if event is None else event.before


def _crossing(motion: Trajectory, expression: Any) -> ca.SX:
    """The expression in the symbols of the scene whose steps are taken."""
    if isinstance(expression, tuple):
        expression = expression[0]
    if expression is None:
        raise InputError(
            "say what crosses zero at this event: expression=, as it was given in until or events"
        )
    own = in_own_symbols(expression, motion.system, "expression")
    if own.numel() != 1:
        raise InputError(f"expression must be one number, it has shape {own.shape}")
    return own if motion.fictitious is None else in_rescaled_symbols(motion, own)


Begun = tuple[Carrier, np.ndarray, Directions]


def _of_impact(carried: Begun, event: Event | None, wanted: ca.SX) -> EventSensitivity | None:
    if event is None:
        return None
    carrier, z, directions = carried
    motion = carrier.motion
    for leg in legs(carrier.course):
        if any(_same(motion, x, event) for x in leg.events):
            break
        z = carried_through(carrier, leg, z, directions)
    else:
        raise InputError(f"the event at t = {event.time:g} is none of this part of the run")
    assert motion.active_set is not None
    first, last = leg.events[0], leg.events[-1]
    behind = motion.active_sets[motion.active_set[leg.piece.last]].scene(motion.system)
    time = float(leg.piece.t[0] + leg.piece.h[0])
    found = []
    for scene, p, slopes in zip(
        (leg.scene, behind), (first.p_before, last.p_after), part_of_step(carrier, leg), strict=True
    ):
        change = moved(carrier, slopes, z, directions, leg.piece.first)
        state = State(time, np.array(first.q), np.empty(0), np.array(p))
        found.append(_outputs(carrier, scene, state, wanted, change, z))
    return EventSensitivity(change[carrier.places[0]], *found)


def _same(motion: Trajectory, one: Event, other: Event) -> bool:
    close = abs(one.time - other.time) <= APART * abs(motion.h)
    return close and (one.kind, one.contact) == (other.kind, other.contact)


def _of_crossing(carried: Begun, at: State, crossing: ca.SX, wanted: ca.SX) -> EventSensitivity:
    carrier, z, directions = carried
    motion, forward = carrier.motion, 1.0 if carrier.motion.h > 0 else -1.0
    for leg in legs(carrier.course):
        times = np.append(leg.piece.t, leg.piece.t[-1] + leg.piece.h[-1])
        if forward * (times[-1] - at.t) >= -OFF_GRID * abs(motion.h):
            break
        z = carried_through(carrier, leg, z, directions)
    place = int(np.searchsorted(forward * times, forward * at.t)) - 1
    place = min(max(place, 0), len(leg.piece.t) - 1)
    every, _ = carried_on(carrier, leg, z, directions)
    z = np.vstack([every[place], z[len(every[place]) :]])
    x, v = leg.piece.x[place : place + 1], leg.piece.v[place : place + 1]
    end = np.hstack([at.q, at.p])[None]
    begin, step = times[place : place + 1], leg.piece.first + place
    parts = parts_of(carrier, np.array([step]), (x, end), (v, at.v[None]), begin, at.t - begin)
    by = Sweeper(leg.scene, motion.rule, None)
    slopes = part_slopes(by, parts, motion.c, motion.system.structure.contacts)
    function = crossing_slopes(leg.scene, crossing)
    _require_zero(carrier, leg.scene, crossing, function, slopes, at)
    state = at.q, at.p, at.t
    ended = to_event(slopes, function, state, motion.c, *controls_at(carrier, parts), speeds(parts))
    change = moved(carrier, ended, z, directions, step)
    found = _outputs(carrier, leg.scene, at, wanted, change, z)
    clock = clock_of(leg.scene)
    return EventSensitivity(change[carrier.places[0] if clock < 0 else clock], found, found)


def _require_zero(
    carrier: Carrier,
    scene: System,
    crossing: ca.SX,
    function: ca.Function,
    slopes: Slopes,
    at: State,
) -> None:
    """Refuse an expression that does not cross zero there: it is another one."""
    motion = carrier.motion
    given = at.q, at.p, np.array([at.t]), motion.c
    value = call(state_function(scene, crossing), *given)[0][0]
    of_x, of_t, *_ = call(function, *given, np.zeros(scene.control.numel()))
    slope, rates = np.abs(np.append(of_x, of_t)), slopes.of_size[0, : len(of_x) + 1]
    a_step = slope @ np.abs(motion.h * rates) + slope[:-1] @ np.abs(np.append(at.q, at.p))
    if not abs(value) <= NOT_ZERO * a_step:
        raise InputError(
            f"expression is {value:.3g} at the event, t = {at.t:g}, where it should cross zero: it "
            "is another one than was watched"
        )


def _outputs(
    carrier: Carrier, scene: System, at: State, wanted: ca.SX, change: np.ndarray, z: np.ndarray
) -> np.ndarray:
    """Changes of the outputs at an instant."""
    t, many, size = np.array([at.t]), len(carrier.motion.c), wanted.numel()
    flat = call(slopes_of(scene, wanted), at.q, at.p, t, carrier.motion.c)
    of_x, of_c, of_t = (x.reshape(-1, size).T for x in flat)
    of_params = z[carrier.places[1] :][:many]
    return of_x @ change[:-1] + of_c @ of_params + of_t @ change[-1:]

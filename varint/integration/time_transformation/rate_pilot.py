"""How the local rate of a scene varies along its motion: a rough look ahead by explicit steps."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from varint.codegen.look_ahead import Look, look_ahead, look_of
from varint.integration.time_transformation.equations_ahead import ahead_from, equations_ahead
from varint.integration.time_transformation.flight_rate import TWICE_KINETIC, flight_rate
from varint.integration.time_transformation.local_rate import SLOWEST_RATE, local_rate
from varint.numerics.arrays import call, over_columns
from varint.results.trajectory import Trajectory
from varint.scene.memory import lately, per_system
from varint.scene.system import System

STEPS = 80
ANGLE = 0.4  # of the local rate in a step: a Runge–Kutta method of order 4 is right to 1e-3
ASTRAY = 0.05  # of the largest p·v: an energy error where the look ahead ends
REMEMBERED = 16
LOOKS = 400  # nodes of a run at which ω is looked at
BITS = 24  # of what was seen: the way that it is seen by shows in none of them
GROWTH = 1.5  # of steps at most, where the rate vanishes
# the rate in flight over the other one: at most 1.5 in a bound orbit about a centre, and a flyby
# that is not twice as fast as the escape from there is well seen by the other one
AFAR = 2.0


class RatePilot(NamedTuple):
    """Mean of ω over time, and its largest value, as far as was looked: so many time units; its
    value at the start; whether ω is the rate in flight.
    """

    mean: float
    largest: float
    duration: float
    first: float
    flight: bool


def rate_pilot(
    system: System,
    q: np.ndarray,
    v: np.ndarray,
    t0: float,
    c: np.ndarray,
    total: float | None,
    backwards: bool = False,
    flight: bool = False,
) -> RatePilot | None:
    """A look at ω, or at the rate in flight, along the first steps of the motion, within the
    duration; None where nothing pulls at the start, or all goes astray at once. The last ones are
    remembered.
    """
    known, (q, v) = _seen(system), ahead_from(system, q, v, t0)
    key = (q.tobytes(), v.tobytes(), c.tobytes(), total, backwards, flight)
    looked_at = q, v, c, total, backwards, flight
    return lately(known, key, lambda: _looked_at(system, *looked_at), REMEMBERED)


@per_system
def _seen(system: System) -> dict[tuple, RatePilot | None]:
    """Pilots of the last starts: a run chooses its steps and is then made from the same one."""
    return {}


def _looked_at(
    system: System,
    q: np.ndarray,
    v: np.ndarray,
    c: np.ndarray,
    total: float | None,
    backwards: bool,
    flight: bool,
) -> RatePilot | None:
    """In the core, where the scene has a form as data."""
    end, look = math.inf if total is None else abs(total), look_by(system, flight)
    if look is None:
        seen = _without_core(system, q, v, c, end, backwards, flight)
    else:
        seen = _by_core(look, np.concatenate([q, v]), c, end, backwards)
    if seen is None:
        return None
    mean, largest, duration, first = map(_roughly, seen)
    return RatePilot(mean, largest, duration, first, flight)


def _roughly(x: float) -> float:
    mantissa, exponent = math.frexp(x)
    return math.ldexp(round(mantissa * 2**BITS), exponent - BITS)


def _by_core(
    look: Look, start: np.ndarray, c: np.ndarray, end: float, backwards: bool
) -> tuple[float, float, float, float] | None:
    how: dict[str, Any] = {"steps": STEPS, "angle": ANGLE, "astray": ASTRAY}
    return look_ahead(look, start, c, backwards=backwards, total=end, **how)


def _without_core(
    system: System,
    q: np.ndarray,
    v: np.ndarray,
    c: np.ndarray,
    end: float,
    backwards: bool,
    flight: bool,
) -> tuple[float, float, float, float] | None:
    sign = np.array([-1.0 if backwards else 1.0])
    start = call(_rate_function(system, flight), np.concatenate([q, v]), c)[0]
    if not (np.isfinite(start).all() and start[0] > 0):
        return None
    with np.errstate(all="ignore"):
        passed, rates, energy, size = call(
            _look_ahead(system, flight), q, v, ANGLE / start, c, sign
        )
        astray = np.abs(energy - energy[0]) > ASTRAY * np.maximum.accumulate(np.abs(size))
    rates = np.concatenate([start, rates])
    times = np.concatenate([[0.0], np.cumsum(passed)])
    good = np.isfinite(times) & np.isfinite(rates) & ~np.append(astray, False)
    good &= np.concatenate([[True], times[:-1] < end])
    count = int(np.argmin(good)) if not good.all() else len(good)
    if count < 2:
        return None
    times, rates = times[:count], rates[:count]
    turned = ((rates[1:] + rates[:-1]) / 2 * np.diff(times)).sum()
    return turned / times[-1], rates.max(), times[-1], rates[0]


def rate_varies(system: System, motion: Trajectory, factor: float, flight: bool) -> bool:
    """Whether the largest ω at nodes of a run is so many times the mean one."""
    some = np.unique(np.linspace(0, len(motion) - 1, LOOKS).astype(int))
    ahead = ahead_from(system, motion.q[some], motion.v[some], motion.t[some])
    at = np.concatenate(ahead, axis=1)
    rates = over_columns(_rate_function(system, flight), at, motion.c)[0]
    rates = rates[np.isfinite(rates)]
    return bool(rates.size and rates.max() >= factor * rates.mean())


def glance(
    system: System,
    q: np.ndarray,
    v: np.ndarray,
    t0: float,
    c: np.ndarray,
    total: float,
    flight: bool,
) -> tuple[float, float, float, float] | None:
    """What `rate_pilot` sees, with all digits, in less time."""
    look = look_by(system, flight)
    if look is not None:
        start = np.concatenate(ahead_from(system, q, v, t0))
        return _by_core(look, start, c, abs(total), total < 0)
    seen = rate_pilot(system, q, v, t0, c, total, total < 0, flight)
    return None if seen is None else seen[:4]


def comes_from_afar(system: System, q: np.ndarray, v: np.ndarray, t0: float, c: np.ndarray) -> bool:
    """Whether the way from coordinates and velocities may lead so fast to where the rate is
    another one that ω tells too little: in magnetic fields that vary, which have none, always.
    """
    if local_rate(system).reason:
        return True
    start = np.concatenate(ahead_from(system, q, v, t0))
    calm, flight = call(_both_rates(system), start, c)[0].tolist()
    return flight > AFAR * calm


@per_system
def _both_rates(system: System) -> ca.Function:
    """(q, v), c → ω and the rate in flight."""
    q, v, _, _ = equations_ahead(system)
    both = [rate_of_kind(system, flight) for flight in (False, True)]
    return ca.Function("rates", [ca.vertcat(q, v), system.c], [ca.vertcat(*both)], {"cse": True})


@per_system
def look_by(system: System, flight: bool) -> Look | None:
    """The pilot's operations as data."""
    inputs, (after, *each) = _step(system, flight)
    q, v, _, _ = equations_ahead(system)
    rate = ca.vertcat(q, v), rate_of_kind(system, flight)
    return look_of(q.numel(), rate, (inputs, [after, ca.vertcat(*each)]), system.c)


@per_system
def _rate_function(system: System, flight: bool) -> ca.Function:
    """(q, v), c → ω."""
    q, v, _, _ = equations_ahead(system)
    at = ca.vertcat(q, v)
    return ca.Function("rate", [at, system.c], [rate_of_kind(system, flight)], {"cse": True})


def rate_of_kind(system: System, flight: bool) -> ca.SX:
    """ω as an expression of q and c, or the rate in flight, of v, too."""
    square = flight_rate(system).square if flight else local_rate(system).square
    assert square is not None
    if flight:
        moving = ca.dot(system.v, system.mass_matrix @ system.v)
        square = ca.substitute(square, TWICE_KINETIC, moving)
    return ca.sqrt(ca.substitute(square, SLOWEST_RATE, 0.0))


@per_system
def _look_ahead(system: System, flight: bool) -> ca.Function:
    """(q, v, dt, c, sign) → steps dt, the rates ω after each, energy and p·v before each."""
    n, c = equations_ahead(system).q.numel(), system.c
    (before, sign), found = _step(system, flight)
    step = ca.Function("step", [before, c, sign], found, {"cse": True})
    y, c, sign = ca.MX.sym("y", 2 * n + 1), ca.MX.sym("c", c.numel()), ca.MX.sym("sign")
    walk = step.mapaccum(STEPS)
    _, *found = walk(y, ca.repmat(c, 1, STEPS), ca.repmat(sign, 1, STEPS))
    start = [ca.MX.sym(name, size) for name, size in (("q", n), ("v", n), ("dt", 1))]
    ahead = ca.Function("ahead", [y, c, sign], found)
    return ca.Function("look_ahead", [*start, c, sign], ahead(ca.vertcat(*start), c, sign))


def _step(system: System, flight: bool) -> tuple[list[ca.SX], list[ca.SX]]:
    """((q, v, dt), sign) → ((q, v, dt) after it, dt, ω there, energy and p·v before)."""
    s = system
    (q, v, slopes, energy), c = equations_ahead(system), system.c
    dt, sign = ca.SX.sym("dt"), ca.SX.sym("sign")
    slope = ca.Function("slope", [q, v, c], list(slopes))
    rate = ca.Function("rate", [q, v, c], [rate_of_kind(s, flight)])
    h = sign * dt
    ways = [slope(q, v, c)]  # the classical Runge–Kutta method
    for part in (0.5, 0.5, 1.0):
        dq, dv = ways[-1]
        ways.append(slope(q + part * h * dq, v + part * h * dv, c))
    new_q, new_v = (
        x + h / 6 * (a + 2 * b + 2 * d + e)
        for x, (a, b, d, e) in zip((q, v), zip(*ways, strict=True), strict=True)
    )
    omega = rate(new_q, new_v, c)
    after = ca.vertcat(new_q, new_v, ca.fmin(ANGLE / omega, GROWTH * dt))
    return [ca.vertcat(q, v, dt), sign], [after, dt, omega, energy, ca.dot(s.momentum, s.v)]

"""What a rough look ahead says of the steps of a motion: whether they should follow its rate, and
if not, with how many equal ones to begin.

The start alone does not tell of an encounter: charges that come from afar hardly feel each other
there, and runs with steps for that are lost, one after the other, until they are short enough.
"""

from __future__ import annotations

from typing import NamedTuple

import casadi as ca
import numpy as np

from varint.codegen.rows import RowFunction, row_function_or_none
from varint.codegen.two_runs import NO_RATES, UNASKED, Rates, rates_of
from varint.discrete.legendre import velocity_function
from varint.integration.time_transformation.flight_rate import flight_rate
from varint.integration.time_transformation.local_rate import local_rate
from varint.integration.time_transformation.potential_terms import potential_terms
from varint.integration.time_transformation.rate_pilot import (
    ANGLE,
    ASTRAY,
    REMEMBERED,
    STEPS,
    RatePilot,
    comes_from_afar,
    glance,
    look_by,
    rate_of_kind,
    rate_pilot,
)
from varint.integration.work_bound import keeps_energy
from varint.numerics.operations import operations_of
from varint.scene.memory import lately, per_scene, per_system
from varint.scene.system import System

# largest rate over the mean one: equal steps would be as many times as many, less what a step of
# the rescaled scene costs more
WORTH = 8.0
# the same of a flight whose start tells of nothing, and of a charge in a field, whose rate has many
# operations: where the look ends before the motion does, after which the rate only falls, and where
# it has seen all of it. Equal steps far from the encounter take two iterations each, where steps
# that follow it take eight: both take the same time there, one half of it at half or twice of these
IN_FLIGHT, IN_FIELD = (5.0, 12.0), (8.0, 32.0)
# the same where a magnetic field vanishes on the way: its relative change has no bound there, the
# look ahead goes no farther, and nothing is fast
VANISHES = 1e4
# of the largest rate in flight, for the first equal steps: it is larger than the own one
FLYING = 0.5
# times the rate at the start: a sum over terms of the potential, which in a lattice is far above
# the frequency of any small motion, and tells by its change alone
FASTER = 2.0
STEEP = frozenset(("inv", "exp", "log", "pow", "constpow", "tan"))  # operations beside division
BEYOND = 2.0  # times the duration: a look that leapt so far did not see the motion
# coordinates beyond which a rate takes longer to find than many motions take: it is looked for
# where equal steps go astray, and where it is a sum of simple terms
MANY = 24


class Ahead(NamedTuple):
    """A pilot that sees a rate which varies so much that equal steps would be too many, if there is
    one; else the frequency of a motion whose first equal steps suit this one, 0 where nothing tells
    of it.
    """

    pilot: RatePilot | None
    frequency: float


NOTHING = Ahead(None, 0.0)


def seen_along(
    system: System, start: np.ndarray, t0: float, c: np.ndarray, total: float, which: int
) -> RatePilot | None:
    """A look ahead at one of `kinds_of`, which varies along a run that went astray; None where it
    is not to be followed.
    """
    n, flight = len(start) // 2, kinds_of(system)[which]
    found = rate_pilot(system, start[:n], start[n:], t0, c, total, total < 0, flight)
    return None if found is None or _vanishes(system, found.mean, found.largest) else found


def _vanishes(system: System, mean: float, largest: float) -> bool:
    """Whether a rate is so uneven for a magnetic field vanishes on the way."""
    return largest >= VANISHES * mean and bool(local_rate(system).reason)


def seen_ahead(system: System, start: np.ndarray, t0: float, c: np.ndarray, total: float) -> Ahead:
    """What is seen of a motion from coordinates and velocities. The last ones are remembered."""
    known, key = _seen(system), (start.tobytes(), t0, c.tobytes(), total)
    return lately(known, key, lambda: _looked_at(system, start, t0, c, total), REMEMBERED)


@per_system
def _seen(system: System) -> dict[tuple, Ahead]:
    """Of the last starts."""
    return {}


def _looked_at(system: System, start: np.ndarray, t0: float, c: np.ndarray, total: float) -> Ahead:
    n, frequency, grows = len(start) // 2, 0.0, False
    begin = start[:n], start[n:], t0, c, total
    for flight in kinds_of(system):
        if flight and not comes_from_afar(system, start[:n], start[n:], t0, c):
            continue
        seen = glance(system, *begin, flight)
        if seen is None:
            continue
        mean, largest, duration, first = seen
        if _vanishes(system, mean, largest):
            continue
        if frequency or not flight:
            least = WORTH
        else:
            which = IN_FIELD if local_rate(system).reason else IN_FLIGHT
            least = which[duration >= abs(total)]
        if largest >= least * mean:
            return Ahead(rate_pilot(system, *begin, total < 0, flight), 0.0)
        if not frequency and duration <= BEYOND * abs(total):
            frequency = (FLYING if flight else 1.0) * largest
            grows = flight or largest > FASTER * first
    # over forces more runs than two tell how many steps to begin with
    return Ahead(None, frequency if grows and keeps_energy(system) else 0.0)


@per_scene
def rates_to_follow(system: System) -> list[Rates]:
    """One: what is known of those of `kinds_of` as data."""
    return [UNASKED]


def ask_for_rates(system: System) -> Rates:
    """Those of `kinds_of`, or none of them where they are not data or do not vary."""
    looks = [look_by(system, flight) for flight in kinds_of(system)]
    rows, known = _rate_rows(system), [look for look in looks if look is not None]
    if rows is None or not looks or len(known) < len(looks):
        return NO_RATES
    return rates_of(rows, known, STEPS, ANGLE, ASTRAY, WORTH)


def _rate_rows(system: System) -> RowFunction | None:
    """(q, p) → the rates of `kinds_of` and velocities at many nodes, where they are data."""
    velocity = velocity_function(system)
    if not velocity.is_a("SXFunction"):
        return None
    s, p = system, ca.SX.sym("p", system.structure.n)
    v = velocity(s.q, p, ca.SX.zeros(1), s.c)
    rates = [ca.substitute(rate_of_kind(s, flight), s.v, v) for flight in kinds_of(s)]
    return row_function_or_none("rates", [s.q, p], s.c, [ca.densify(x) for x in (*rates, v)])


def has_many(system: System) -> bool:
    """Whether the scene has so many coordinates that no motion is looked at ahead."""
    return system.structure.n > MANY


@per_scene
def kinds_of(system: System) -> tuple[bool, ...]:
    """Which rates the scene has that vary: its own (False), that in flight (True)."""
    if has_many(system) and potential_terms(system) is None:
        return ()
    both = local_rate(system), flight_rate(system)
    found = tuple(bool(i) for i, rate in enumerate(both) if not rate.reason)
    return found if keeps_energy(system) or any(_has_poles(system, x) for x in found) else ()


def _has_poles(system: System, flight: bool) -> bool:
    """Whether a rate may become large without a large motion: it divides by what coordinates make,
    or takes exponentials of it. Over forces short motions of other scenes are over in less time
    than a look ahead takes.
    """
    s = system
    inputs = [s.q, s.v, s.t, s.c]
    nodes = operations_of(ca.Function("rate", inputs, [rate_of_kind(s, flight)])).nodes
    moving: list[bool] = []
    for name, *taken in nodes:
        if name in ("const", "input"):
            moving.append(name == "input" and taken[0] < 2)
            continue
        moving.append(any(moving[j] for j in taken))
        if (name == "div" and moving[taken[1]]) or (name in STEEP and moving[-1]):
            return True
    return False

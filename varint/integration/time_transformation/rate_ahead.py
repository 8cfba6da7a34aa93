"""What a rough look ahead says of the steps of a motion: whether they should follow its rate, and
if not, with how many equal ones to begin.

The start alone does not tell of an encounter: charges that come from afar hardly feel each other
there, and runs with steps for that are lost, one after the other, until they are short enough.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from varint.integration.time_transformation.flight_rate import flight_rate
from varint.integration.time_transformation.local_rate import local_rate
from varint.integration.time_transformation.rate_pilot import (
    REMEMBERED,
    RatePilot,
    comes_from_afar,
    glance,
    rate_pilot,
)
from varint.scene.memory import per_scene, per_system
from varint.scene.system import System

# largest rate over the mean one: equal steps would be as many times as many, less what a step of
# the rescaled scene costs more
WORTH = 8.0
# the same of a flight whose start tells of nothing, where few steps are
# needed but for the encounter; of a charge in a field, whose rate has many operations
IN_FLIGHT, IN_FIELD = 5.0, 8.0
# of the largest rate in flight, for the first equal steps: it is larger than the own one
FLYING = 0.5
BEYOND = 2.0  # times the duration: a look that leapt so far did not see the motion


class Ahead(NamedTuple):
    """A pilot that sees a rate which varies so much that equal steps would be too many, if there is
    one; else the frequency of a motion whose first equal steps suit this one, 0 where nothing tells
    of it.
    """

    pilot: RatePilot | None
    frequency: float


NOTHING = Ahead(None, 0.0)


def seen_ahead(system: System, start: np.ndarray, c: np.ndarray, total: float) -> Ahead:
    """What is seen of a motion from coordinates and velocities. The last ones are remembered."""
    known, key = _seen(system), (start.tobytes(), c.tobytes(), total)
    try:
        return known[key]
    except KeyError:
        found = _looked_at(system, start, c, total)
    if len(known) >= REMEMBERED:
        known.clear()
    known[key] = found
    return found


@per_system
def _seen(system: System) -> dict[tuple, Ahead]:
    """Of the last starts."""
    return {}


def _looked_at(system: System, start: np.ndarray, c: np.ndarray, total: float) -> Ahead:
    n, frequency = len(start) // 2, 0.0
    for flight in kinds_of(system):
        if flight and not comes_from_afar(system, start, c):
            continue
        seen = glance(system, start, c, total, flight)
        if seen is None:
            continue
        mean, largest, duration = seen
        if frequency or not flight:
            least = WORTH
        else:
            least = IN_FIELD if local_rate(system).reason else IN_FLIGHT
        if largest >= least * mean:
            return Ahead(rate_pilot(system, start[:n], start[n:], c, total, total < 0, flight), 0.0)
        if not frequency and duration <= BEYOND * abs(total):
            frequency = (FLYING if flight else 1.0) * largest
    return Ahead(None, frequency)


@per_scene
def kinds_of(system: System) -> tuple[bool, ...]:
    """Which rates the scene has that vary: its own (False), that in flight (True)."""
    both = local_rate(system), flight_rate(system)
    return tuple(bool(i) for i, rate in enumerate(both) if not rate.reason)

"""What is watched for along runs for a wanted accuracy, by the call that proves them."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from varint.codegen.few_steps import UNTOLD
from varint.codegen.kernel import Kernel
from varint.codegen.rows import RowFunction, row_function_or_none
from varint.codegen.two_runs import Asked, search_asked
from varint.discrete.legendre import velocity_function
from varint.integration.events.short_search import events_along, key_of, search_for
from varint.integration.plain_start import Room, Watched, opening_in, velocities_in
from varint.integration.run import FIRST
from varint.results.records import Event
from varint.scene.memory import per_scene
from varint.scene.system import System

MOST = 2**40  # steps of a run that is whole already when it is searched


def watched_in(
    system: System, kernel: Kernel, mapped: bool, room: Room, c: np.ndarray, watched: Watched
) -> Asked | None:
    """What is looked for along runs from the start that is there; None where it is to be looked for
    elsewhere. Runs that are `mapped` look for no velocities.
    """
    until, events, by_momentum = watched
    what = search_for(system, kernel, key_of(until, events), until, events)
    velocities = velocity_rows(system) if mapped else None
    if what is None or (mapped and velocities is None):
        return None
    typical = opening_in(room, system).typical if kernel.opening else UNTOLD
    if kernel.opening and not mapped:
        speed = opening_in(room, system).told[2 * room.n :]
    else:
        speed = velocities_in(room, system, c) if by_momentum else room.v
    return search_asked(what, speed, velocities, MOST if until is None else FIRST, typical)


def end_of(watched: Watched, zeros: np.ndarray) -> float | None:
    """When the run ends at what was watched for."""
    stops = watched.until is not None and len(zeros) and zeros[0, 1] == 0
    return zeros.item((0, 2)) if stops else None


def events_of(
    system: System, watched: Watched, zeros: np.ndarray, c: np.ndarray, h: float, end: float | None
) -> tuple[Event, ...]:
    """The records of what was found beside the end."""
    events: Any = watched.events or ()
    names = tuple(events) if watched.until is None else ("until", *events)
    return events_along(system, names, zeros if end is None else zeros[1:], c, h, end)


@per_scene
def velocity_rows(system: System) -> RowFunction | None:
    """(q, p, t) → v as data; None where it has no such form."""
    s, velocity = system, velocity_function(system)
    if not velocity.is_a("SXFunction"):
        return None
    p = ca.SX.sym("p", s.structure.n)
    return row_function_or_none("velocity", [s.q, p, s.t], s.c, [velocity(s.q, p, s.t, s.c)])

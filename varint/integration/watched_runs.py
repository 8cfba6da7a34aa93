"""What is watched for along runs for a wanted accuracy, by the call that proves them."""

from __future__ import annotations

import casadi as ca
import numpy as np

from varint.codegen.beside import Beside, searched_beside
from varint.codegen.few_steps import UNTOLD
from varint.codegen.kernel import Kernel
from varint.codegen.rows import RowFunction, row_function_or_none
from varint.discrete.legendre import velocity_function
from varint.integration.events.short_search import key_of, search_for
from varint.integration.plain_start import Room, Watched, opening_in, velocities_in
from varint.integration.run import FIRST
from varint.scene.memory import per_scene
from varint.scene.system import System

MOST = 2**40  # steps of a run that is whole already when it is searched


def watched_in(
    system: System,
    kernel: Kernel,
    mapped: bool,
    room: Room,
    c: np.ndarray,
    watched: Watched,
    opening: bytes,
) -> Beside | None:
    """What is looked for along runs from the start that is there; None where it is to be looked for
    elsewhere. Runs that are `mapped` look for no velocities.
    """
    until, events, by_momentum, _ = watched
    what = search_for(system, kernel, key_of(until, events), until, events)
    names = tuple(events or ()) if until is None else ("until", *(events or ()))
    asked = None if by_momentum else (mapped, names)
    if room.watched is not None and room.watched[0] is what and room.watched[1] == asked:
        return room.watched[2]
    velocities = velocity_rows(system) if mapped else None
    if what is None or (mapped and velocities is None):
        return None
    told = opening_in(room, system) if kernel.opening else None
    if told is not None and not mapped:
        speed = told.told[2 * room.n :]
    else:
        speed = velocities_in(room, system, c) if by_momentum else room.v
    longest, typical = MOST if until is None else FIRST, told.typical if told else UNTOLD
    how = speed, velocities, longest, typical, until is not None, names
    beside = searched_beside(opening, what, *how)
    room.watched = None if asked is None else (what, asked, beside)
    return beside


@per_scene
def velocity_rows(system: System) -> RowFunction | None:
    """(q, p, t) → v as data; None where it has no such form."""
    s, velocity = system, velocity_function(system)
    if not velocity.is_a("SXFunction"):
        return None
    p = ca.SX.sym("p", s.structure.n)
    return row_function_or_none("velocity", [s.q, p, s.t], s.c, [velocity(s.q, p, s.t, s.c)])

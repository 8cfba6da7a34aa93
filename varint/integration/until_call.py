"""Runs for a wanted accuracy that end where an expression crosses zero, as most are asked for: a
start, a duration, an accuracy.

Each run that proves the error is searched for its end by the core, as it is made. What that cannot
do is left to `to_tolerance`.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from varint.codegen.two_runs import NO_RATES
from varint.integration.no_farther import ends_within, pieces
from varint.integration.plain_start import Room, Watched, begin_in, room_of, velocities_in
from varint.integration.short_call import by_the_core, is_plainly_asked, seen_in
from varint.integration.short_scenes import Known, fastest_of, known_of
from varint.integration.tolerance import DEFAULT_TOL
from varint.integration.trajectories import with_stats
from varint.numerics.limits import check_steps
from varint.results.trajectory import Trajectory
from varint.rules.rule import Rule
from varint.scene.parameters import ParameterValues
from varint.scene.system import System


def call_until(
    system: System,
    rule: Rule | None,
    start: tuple[Any, Any, Any, ParameterValues | None],
    p0: Any,
    duration: Any,
    tol: float | None,
    began: float,
    watched: tuple[Any, Any],
) -> Trajectory | None:
    """The motion from a start (q0, v0, t0, params), or from momenta in place of v0, until an
    expression crosses zero, with events on the way (until, events); None where another way is to
    be taken.
    """
    t0, tol = start[2], DEFAULT_TOL if tol is None else tol
    if not is_plainly_asked(rule, t0, duration, tol):
        return None
    known = known_of(system, rule)
    if known is None or not (p0 is None or known.by_momentum):
        return None
    pool = known.rooms
    room = pool.pop() if pool else room_of(system, True)
    try:
        c = begin_in(room, system, start, p0)
        if c is None:
            return None
        t0, duration, begin = float(t0), float(duration), room.start
        if p0 is not None and known.varies:
            begin = np.concatenate((room.q, velocities_in(room, system, c)))
        runs, divided = 0, _pieces_in(room, known, t0, duration)
        looked = Watched(*watched, p0 is not None, len(divided) == 1)
        for piece in divided:
            pilot, turned, _ = seen_in(room, system, known, begin, t0, c, piece)
            if pilot is not None:
                return None
            how = system, known, room, c, t0, piece, tol, turned, began
            found = by_the_core(*how, [NO_RATES], looked)
            if type(found) is not Trajectory:
                return None
            if piece == duration and not runs:
                return found
            runs += found.stats["runs"]
            if piece == duration or ends_within(found, t0, piece):
                return with_stats(found, runs=runs)
        return None
    finally:
        pool.append(room)


def _pieces_in(room: Room, known: Known, t0: float, duration: float) -> tuple[float, ...]:
    """Of a duration, shorter ones first; those for the start that is there are remembered."""
    divided, there = room.divided, room.known
    if divided is None or divided[0] is not there or divided[1] != duration:
        check_steps(t0, duration, 1)
        assert room.look is not None
        room.look()
        fastest = fastest_of(known.n, known.last, room.local) or 0.0
        divided = there, duration, (*pieces(fastest, duration), duration)
        room.divided = None if there is None else divided
    return divided[2]

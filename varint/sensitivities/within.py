"""Nodes and events that lie within the steps of a run: how they depend on the node before them."""

from __future__ import annotations

import numpy as np

from varint.integration.time_transformation.transformed_scene import TIME
from varint.rules.polynomials import lagrange_slopes, lagrange_values
from varint.scene.system import System
from varint.sensitivities.carrier import Carrier, Rows
from varint.sensitivities.course import Leg, grid_times
from varint.sensitivities.event_nodes import INSTANT
from varint.sensitivities.grazing import grazing
from varint.sensitivities.impacts import blow, event_slopes, to_event
from varint.sensitivities.parts import Parts, Slopes, part_slopes, to_time, with_size
from varint.sensitivities.steps_at_once import Directions, Sweeper

COMING = ("impact", "stop")


def readings(carrier: Carrier, leg: Leg, rows: Rows, inside: np.ndarray) -> Slopes:
    """How nodes that lie `inside` steps depend on the node before them, their times given."""
    motion, piece, wanted = carrier.motion, leg.piece, carrier.course.rows
    at, place = np.arange(len(wanted))[rows.which][inside], rows.place[inside]
    n2 = piece.x.shape[1]
    begin = piece.t[place]
    parts = parts_of(
        carrier,
        piece.first + place,
        (piece.x[place], np.hstack([wanted.q[at], wanted.p[at]])[:, :n2]),
        (piece.v[place], wanted.v[at]),
        begin,
        rows.behind[inside],
    )
    contacts = motion.system.structure.contacts
    by = Sweeper(leg.scene, motion.rule, None)
    return _given(leg, part_slopes(by, parts, motion.c, contacts))


def _given(leg: Leg, slopes: Slopes) -> Slopes:
    """Parts that end at given times, on the clock of a rescaled scene or on that of the steps."""
    clock = clock_of(leg.scene)
    if clock < 0:
        return to_time(slopes, np.zeros_like(slopes.of_z[:, 0]))
    return with_size(slopes, -slopes.of_z[:, clock] / slopes.of_size[:, clock, None])


def clock_of(scene: System) -> int:
    """Place of the physical time among the coordinates of a rescaled scene, −1 in others."""
    return scene.names.index(TIME) if TIME in scene.names else -1


def parts_of(
    carrier: Carrier,
    step: np.ndarray,
    x: tuple[np.ndarray, np.ndarray],
    v: tuple[np.ndarray, np.ndarray],
    t: np.ndarray,
    h: np.ndarray,
) -> Parts:
    """Parts of steps between states (q, p) and velocities at both ends."""
    motion = carrier.motion
    k = step + int(motion.k[0])
    whole = np.full(len(k), motion.h) if motion.sizes is None else motion.sizes[k]
    passed = (t - grid_times(motion, k)) / whole
    u = motion.u[np.minimum(k, len(motion.u) - 1)]
    return Parts(step, *x, *v, t, h, u, passed, whole)


def part_of_step(carrier: Carrier, leg: Leg) -> tuple[Slopes, Slopes]:
    """How the end of a part of a step depends on its beginning: as the motion comes there, and as
    it goes on.

    Raises
    ------
    ConvergenceError
        If an event there has no derivative.
    """
    motion, piece = carrier.motion, leg.piece
    step, n, clock = piece.first, piece.v.shape[1], carrier.places[0]
    end = float(piece.t[0] + piece.h[0])
    if takes_no_time(carrier, leg):
        if leg.events and leg.events[0].kind in COMING:
            raise grazing(step, end)
        same = np.eye(carrier.size)[None, : clock + 1]
        none = np.zeros((1, clock + 1)), np.zeros((1, clock + 1, motion.u[0].size)), np.zeros(1)
        both = Slopes(clock, same, *none)
        return both, both
    parts, slopes = free_part(carrier, leg)
    if not leg.events:
        before = to_time(slopes, carrier.at_step(step + 1)) if leg.on_grid else _given(leg, slopes)
        return before, before
    assert leg.held is not None
    crossing = event_slopes(motion.system, leg.held, leg.events[0])
    state = piece.x[1, :n], piece.x[1, n:], end
    before = to_event(
        slopes, crossing, state, motion.c, *controls_at(carrier, parts), speeds(parts)
    )
    after = before
    for i, event in enumerate(leg.events):
        if event.kind not in COMING:
            continue
        _require_in_turn(leg, i, step)
        after = _through(after, blow(motion.system, leg.held, event, end, motion.c))
    return before, after


def takes_no_time(carrier: Carrier, leg: Leg) -> bool:
    """Whether a part of a step begins where it ends."""
    return bool(abs(leg.piece.h[0]) <= INSTANT * abs(carrier.motion.h))


def free_part(carrier: Carrier, leg: Leg) -> tuple[Parts, Slopes]:
    """A part of a step, and its derivatives with any duration."""
    motion, piece = carrier.motion, leg.piece
    x, v = piece.x, piece.v
    ends = (x[:1], x[1:]), (v[:1], v[1:])
    parts = parts_of(carrier, np.array([piece.first]), *ends, piece.t, piece.h)
    contacts = motion.system.structure.contacts
    return parts, part_slopes(carrier.by(leg.scene), parts, motion.c, contacts)


def _require_in_turn(leg: Leg, i: int, step: int) -> None:
    """Blows after the first are handed on by contacts that are closed already."""
    assert leg.held is not None
    known = {*leg.held.holding, *(event.contact for event in leg.events[:i])}
    if i and leg.events[i].contact not in known:
        raise grazing(step, leg.events[i].time, "contacts close together there, in either order")


def speeds(parts: Parts) -> np.ndarray:
    """The speeds in play in a part of a step, (n,)."""
    return np.maximum(np.abs(parts.v[0]), np.abs(parts.v_after[0]))


def controls_at(
    carrier: Carrier, parts: Parts
) -> tuple[tuple[np.ndarray, np.ndarray, np.ndarray], float]:
    """Controls at the end of a part, their rate, what they depend on; steps passed until then."""
    u = parts.u[0]
    r, k = u.shape
    passed = parts.passed[0] + parts.h[0] / parts.whole[0]
    values, rates = np.ones((1, 1)), np.zeros((1, 1))
    if r > 1:
        nodes, at = np.array(carrier.motion.rule.nodes), np.array([passed])
        values, rates = lagrange_values(nodes, at), lagrange_slopes(nodes, at)
    table = np.kron(values, np.eye(k))
    return ((values @ u)[0], (rates @ u)[0] / parts.whole[0], table), float(parts.step[0] + passed)


def _through(slopes: Slopes, rows: np.ndarray) -> Slopes:
    """Followed by a map of (x, t) whose derivative with respect to z has these rows."""
    count = slopes.clock + 1
    of_z, of_u = slopes.of_z.copy(), slopes.of_u.copy()
    of_z[0, :count] = rows[:, :count] @ slopes.of_z[0, :count]
    of_z[0, :count, count:] += rows[:, count:]
    of_u[0, :count] = rows[:, :count] @ slopes.of_u[0, :count]
    return slopes._replace(of_z=of_z, of_u=of_u)


def moved(
    carrier: Carrier, part: Slopes, z: np.ndarray, directions: Directions, step: int
) -> np.ndarray:
    """The change of (x, t) at the end of a part of a step, (2n + 1, m)."""
    count = carrier.places[0] + 1
    change = part.of_z[0, :count] @ z
    add_controls(change, part.of_u[0, :count], directions, step)
    return change


def add_controls(change: np.ndarray, of_u: np.ndarray, directions: Directions, step: int) -> None:
    """Add what the controls of a step change to their columns."""
    if directions.controls >= 0:
        at = directions.controls + step * of_u.shape[1]
        change[:, at : at + of_u.shape[1]] += of_u

"""Second derivatives of runs through contacts, along an adjoint: those of whole steps, and those
of parts of steps, events and blows between them.

A part of a step ends at (x', t') = (Φ(x, t, c, u, d), t + d) where e(x', t', c, u) = 0, which gives
its duration d. With the derivatives w of a number by (x', t') and ν = −(w_x Φ_d + w_t)/ė, which
makes w·(x', t') + ν e stationary in d, its second derivatives are

    Tᵀ ∂²(ω·Φ) T + ν T'ᵀ ∂²e T',    ω = w_x + ν e_x,

of the tangents T of (x, c, u, t, d) and T' of (x', t', c, u). A blow adds T'ᵀ ∂²(μ·p⁺) T'.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from varint.numerics.arrays import call
from varint.numerics.limits import check_memory
from varint.results.trajectory import Trajectory
from varint.sensitivities.carrier import Carrier, Rows, rows_of
from varint.sensitivities.carry import Adjoint, carried_back, carried_on, changes_at_rows
from varint.sensitivities.course import Leg, legs
from varint.sensitivities.impacts import (
    blow,
    blow_hessian,
    blow_of,
    event_hessian,
    event_slopes,
)
from varint.sensitivities.second_order import curvature, part_hessian, twice
from varint.sensitivities.steps_at_once import Directions
from varint.sensitivities.tangents import Asked, begun
from varint.sensitivities.within import (
    COMING,
    controls_at,
    free_part,
    moved,
    part_of_step,
    takes_no_time,
)


class Passed(NamedTuple):
    """A leg with the nodes wanted in it, the tangents of (x, t) at its nodes (S + 1, 2n + 1, m) and
    of z at its first (Z, m).
    """

    leg: Leg
    rows: Rows
    every: np.ndarray
    z: np.ndarray


@dataclass(frozen=True, eq=False)
class Ahead:
    """The tangents of a run, carried to its end; `directions` are what acts on every step."""

    carrier: Carrier
    directions: Directions
    passed: list[Passed]

    def changes(self) -> np.ndarray:
        """Changes of (q, p) and t at the nodes wanted, (N + 1, 2n + 1, m)."""
        places = [x.rows.which for x in self.passed]
        m = self.passed[0].z.shape[1]
        found = np.empty((max(x.stop for x in places), self.carrier.places[1], m))
        for where, (leg, rows, every, z) in zip(places, self.passed, strict=True):
            found[where] = changes_at_rows(self.carrier, leg, rows, every, z, self.directions)
        return found


def carried_ahead(motion: Trajectory, asked: Asked, backend: str) -> Ahead:
    """The tangents of a run that is varied in these ways.

    Raises
    ------
    ConvergenceError
        If a step has no regular derivative, or the motion grazes a contact.
    """
    carrier, z, directions = begun(motion, asked, backend)
    check_memory("the derivatives of this run", motion.q.size * 3 * z.shape[1], "take fewer steps")
    passed: list[Passed] = []
    for leg in legs(carrier.course):
        every, later = carried_on(carrier, leg, z, directions)
        passed.append(Passed(leg, rows_of(carrier, leg, not passed), every, z))
        z = later
    return Ahead(carrier, directions, passed)


def contact_curvature(ahead: Ahead, seeds: np.ndarray) -> tuple[np.ndarray, Adjoint]:
    """The second derivatives (m, m) of a number, but for what start and nodes curve, and the
    adjoint at the first node, from its derivatives by (q, p, t) of every node, (N + 1, 2n + 1).

    Controls are held over their steps.
    """
    carrier, directions = ahead.carrier, ahead.directions
    m = ahead.passed[0].z.shape[1]
    found = np.zeros((m, m))
    at = Adjoint(np.zeros(carrier.size), np.zeros(carrier.motion.u.shape))
    for one in reversed(ahead.passed):
        mine = seeds[one.rows.which]
        of_leg = _of_part if one.leg.part else _of_steps
        found += of_leg(carrier, one, mine, at, directions)
        at = carried_back(carrier, one.leg, mine, one.rows, at)
    return found, at


def _at_nodes(carrier: Carrier, one: Passed, seeds: np.ndarray, at: Adjoint) -> np.ndarray:
    """Derivatives by (x, t) of every node of a leg, the adjoint at its last one added."""
    found = np.zeros(one.every.shape[:2])
    np.add.at(found, one.rows.place, seeds)
    found[-1] += at.z[: carrier.places[1]]
    return found


def _of_steps(
    carrier: Carrier, one: Passed, seeds: np.ndarray, at: Adjoint, directions: Directions
) -> np.ndarray:
    clock, piece = carrier.places[0], one.leg.piece
    placed = np.ascontiguousarray(_at_nodes(carrier, one, seeds, at)[:, :clock])
    by, tangent = carrier.by(one.leg.scene), one.every[:, :clock]
    return curvature(by, piece, carrier.motion.c, placed, tangent, directions)[0]


def _of_part(
    carrier: Carrier, one: Passed, seeds: np.ndarray, at: Adjoint, directions: Directions
) -> np.ndarray:
    """Of a part of a step, from its end to its beginning."""
    leg, z, motion, m = one.leg, one.z, carrier.motion, one.z.shape[1]
    if takes_no_time(carrier, leg):
        return np.zeros((m, m))
    piece, (clock, first, _) = leg.piece, carrier.places
    before, _ = part_of_step(carrier, leg)
    end = moved(carrier, before, z, directions, piece.first)
    found, w = _of_blows(carrier, one, end, _at_nodes(carrier, one, seeds, at)[-1])
    c, n = motion.c, piece.v.shape[1]
    parts, free = free_part(carrier, leg)
    of_c, of_u = z[first : first + len(c)], _of_controls(carrier, one, directions)
    if leg.events:
        assert leg.held is not None
        state = (
            piece.x[1, :n],
            piece.x[1, n:],
            piece.t + piece.h,
            c,
            controls_at(carrier, parts)[0][0],
        )
        crossing = event_slopes(motion.system, leg.held, leg.events[0])
        along = np.concatenate(call(crossing, *state)[:2])
        rate = free.of_size[0, : clock + 1]
        nu = -(w @ rate) / (along @ rate)
        curved = call(event_hessian(motion.system, leg.held, leg.events[0]), *state)[0]
        found += nu * twice(curved[None], np.concatenate([end, of_c, of_u])[None])
        w = w + nu * along
    by = carrier.by(leg.scene)
    nodes = len(by.rule.nodes)
    ends = *piece.x, *piece.v, piece.t, piece.h, np.tile(piece.u[0, 0], nodes), c
    curved = call(part_hessian(by.system, by.rule), *ends, np.ascontiguousarray(w[:clock]))[0]
    when, lasts = z[clock : clock + 1], end[clock:] - z[clock : clock + 1]
    tangent = np.concatenate([z[:clock], of_c, np.tile(of_u, (nodes, 1)), when, lasts])
    return found + twice(curved[None], tangent[None])


def _of_controls(carrier: Carrier, one: Passed, directions: Directions) -> np.ndarray:
    """How the controls of the step depend on the inputs, (k, m)."""
    width = one.leg.piece.u.shape[2]
    found = np.zeros((width, one.z.shape[1]))
    if directions.controls >= 0:
        first = directions.controls + one.leg.piece.first * width
        found[:, first : first + width] = np.eye(width)
    return found


def _of_blows(
    carrier: Carrier, one: Passed, end: np.ndarray, w: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Of the blows at the end of a part, and the derivatives by (x, t) before them, from the
    tangent of (x, t) there and the derivatives behind.
    """
    leg, motion, (clock, first, h) = one.leg, carrier.motion, carrier.places
    found, time = np.zeros((end.shape[1],) * 2), float(leg.piece.t[0] + leg.piece.h[0])
    system, n = motion.system, leg.piece.v.shape[1]
    struck = []
    for event in leg.events:
        if event.kind not in COMING:
            continue
        assert leg.held is not None and event.contact is not None
        matrix = blow(system, leg.held, event, time, motion.c)
        struck.append((event, matrix, end))
        end = matrix[:, :first] @ end + matrix[:, first:] @ one.z[first:]
    for event, matrix, tangent in reversed(struck):
        assert leg.held is not None
        b = blow_of(system, leg.held, event, time, motion.c)
        of_e = one.z[h + 2 + event.contact][None] * b.bounces
        function = blow_hessian(system, *b[:4])
        curved = call(function, *b.given, np.ascontiguousarray(w[n:clock]))[0]
        found += twice(curved[None], np.concatenate([tangent, one.z[first:h], of_e])[None])
        w = matrix[:, :first].T @ w
    return found, w

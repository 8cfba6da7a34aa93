"""What a run is carried along by: z = (x, t, c, h, t0, e), of its state, the time of its node, and
what stays the same: parameters, the grid's step and start, coefficients of restitution.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np

from varint.results.dense_output import node_tolerance
from varint.results.trajectory import Trajectory
from varint.scene.system import System
from varint.sensitivities.course import Course, Leg
from varint.sensitivities.loops import sweeper
from varint.sensitivities.pieces import OFF_GRID
from varint.sensitivities.steps_at_once import Sweeper


@dataclass(frozen=True, eq=False)
class Carrier:
    """How changes are carried along a course; `density` is the running loss, the function (q, v, t,
    u, c) → ℓ, serialised.
    """

    course: Course
    backend: str
    density: str | None = None
    sweepers: dict[int, Sweeper] = field(default_factory=dict)

    @property
    def motion(self) -> Trajectory:
        return self.course.motion

    @cached_property
    def row_times(self) -> tuple[np.ndarray, float]:
        """Times of the nodes wanted, rising, and how close to a node of the course they are it."""
        motion = self.motion
        near = node_tolerance(motion) if motion.system.structure.contacts else OFF_GRID
        return np.sign(motion.h) * self.course.rows.t, near * abs(motion.h)

    @property
    def places(self) -> tuple[int, int, int]:
        """Where t, c and h stand in z; t0 stands behind h."""
        n2 = 2 * self.motion.q.shape[1]
        return n2, n2 + 1, n2 + 1 + len(self.motion.c)

    @property
    def size(self) -> int:
        """Of z."""
        return self.places[2] + 2 + self.motion.system.structure.contacts

    def by(self, scene: System) -> Sweeper:
        """How the steps of a scene are differentiated."""
        if id(scene) not in self.sweepers:
            steps = int(self.motion.k[-1] - self.motion.k[0])
            made = sweeper(scene, self.motion.rule, steps, self.backend, self.density)
            self.sweepers[id(scene)] = made
        return self.sweepers[id(scene)]

    def at_step(self, k: int | np.ndarray) -> np.ndarray:
        """How the time of a whole step depends on z."""
        k = np.atleast_1d(k)
        row = np.zeros((len(k), self.size))
        row[:, self.places[2]], row[:, self.places[2] + 1] = k, 1.0
        return row


class Rows(NamedTuple):
    """Those nodes wanted that lie in a leg: where they stand, at which of its nodes, and how long
    behind it.
    """

    which: slice
    place: np.ndarray
    behind: np.ndarray

    def since(self, first: int) -> Rows:
        """Those that are not before the node `first`."""
        begin = min(max(self.which.start, first), self.which.stop)
        without = begin - self.which.start
        if not without:
            return self
        return Rows(slice(begin, self.which.stop), self.place[without:], self.behind[without:])


def rows_of(carrier: Carrier, leg: Leg, first: bool) -> Rows:
    """The nodes wanted behind the first node of a leg, or from that of the first leg on."""
    k, piece = carrier.motion.k, leg.piece
    whole = k[piece.last] - k[piece.node] == len(piece.t) and not leg.part
    if carrier.course.rows is carrier.motion and whole and not leg.held:  # those that were kept
        which = slice(piece.node + (not first), piece.last + 1)
        return Rows(which, piece.kept[int(not first) :], np.zeros(which.stop - which.start))
    forward = 1.0 if carrier.motion.h > 0 else -1.0
    t, tolerance = carrier.row_times
    times = forward * np.append(leg.piece.t, leg.piece.t[-1] + leg.piece.h[-1])
    ends = times[[0, -1]] + tolerance
    a, b = np.searchsorted(t, ends, side="right").tolist()
    which = slice(0 if first else a, b)
    place = np.searchsorted(times, t[which] + tolerance, side="right") - 1
    behind = t[which] - times[place]
    return Rows(which, place, np.where(np.abs(behind) <= tolerance, 0.0, forward * behind))

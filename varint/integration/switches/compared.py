"""What runs of a motion from switch to switch tell of its error, by how far they are apart."""

from __future__ import annotations

import math

import numpy as np

from varint.integration.round_off import growth_of
from varint.integration.run_distance import distance_between_nodes, with_early
from varint.integration.switches.course import Course, Piece
from varint.integration.switches.joined import joined, nodes_apart
from varint.integration.two_runs import FLOOR
from varint.results.trajectory import Trajectory

FAR = 0.1  # of the scales: a piece that leads so far in one step has none to be compared with
CLOCKS = 4.0  # round-off of a time, in units of it


def untold(piece: Piece, scales: np.ndarray) -> bool:
    """Whether a piece leads far in a single step, which is the same in runs of longer steps."""
    states = piece.states
    return len(states) == 2 and bool((np.abs(states[1, 0] - states[0, 0]) > FAR * scales).any())


def least_resolved(motion: Trajectory, pieces: int, scales: np.ndarray) -> float:
    """What no comparison resolves: round-off, and that of the times of so many switches."""
    fastest, largest = np.abs(motion.v).max(axis=0), np.abs(motion.q).max(axis=0)
    late = CLOCKS * np.finfo(float).eps * np.abs(motion.t).max() * math.sqrt(pieces)
    return float((np.maximum(late * fastest, FLOOR * np.maximum(largest, scales)) / scales).max())


def apart_from(
    course: Course, one: list[Piece], other: list[Piece], motion: Trajectory, scales: np.ndarray
) -> tuple[float, float]:
    """How far two runs are apart by the scales, and by how much more than regular errors that has
    grown, where they pass the same branches.
    """
    found = nodes_apart(one, other)
    if found is None:
        apart = distance_between_nodes(motion, joined(course, one, None), scales)
        return apart if math.isfinite(apart) else math.inf, 1.0
    late = abs(one[-1].t[-1] - other[-1].t[-1]) * np.abs(other[-1].states[-1, 2]) / scales
    seen, early = with_early(np.abs(found) / scales)
    apart = max(seen, float(late.max()))
    return (apart, growth_of(seen, early)) if math.isfinite(apart) else (math.inf, 1.0)

"""Ways round the origin: how often a path goes round, and first paths that do."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from varint.errors import InputError
from varint.results.trajectory import Trajectory

WAVY = 0.3  # radians, or of the distance: a way round the origin keeps its number of turns
ALIGNED = 1e-9  # sine of an angle: directions this close leave their plane open


class Round(NamedTuple):
    """Turns of a place, `coordinates` of q, round the origin."""

    coordinates: tuple[int, ...]
    turns: int


def round_path(
    start: np.ndarray, end: np.ndarray, turns: int, s: np.ndarray, waves: np.ndarray
) -> np.ndarray:
    """A way round the origin, (len(s), 2 or 3), its distance and direction wavy: a spiral whose
    distance is multiplied by exp(wave) and whose angle is shifted by another wave.
    """
    ahead, side = _plane(start, end)
    first, last = np.linalg.norm(start), np.linalg.norm(end)
    whole = np.arctan2(end @ side, end @ ahead) % (2 * np.pi) + 2 * np.pi * turns
    angle = s * whole + WAVY * waves[:, 0]
    distance = first ** (1 - s) * last**s * np.exp(WAVY * waves[:, 1])
    return distance[:, None] * (np.outer(np.cos(angle), ahead) + np.outer(np.sin(angle), side))


def with_winding(path: Trajectory, rounds: Sequence[Round]) -> Trajectory:
    """The path with ``stats["winding"]``: by the names of each place, its turns."""
    if not rounds:
        return path
    names = path.system.names
    winding = {
        tuple(names[i] for i in one.coordinates): _turns(path.q[:, list(one.coordinates)])
        for one in rounds
    }
    wound = replace(path, stats=MappingProxyType({**path.stats, "winding": winding}))
    wound.__dict__["action"] = path.action  # of the path itself, see `trajectory_of`
    return wound


def _turns(places: np.ndarray) -> int:
    """Whole turns beyond the angle from the first to the last place, which is 0 to 2π."""
    ahead, side = _plane(places[0], places[-1])
    angle = np.unwrap(np.arctan2(places @ side, places @ ahead))
    return int(np.floor((angle[-1] - angle[0]) / (2 * np.pi) + ALIGNED))


def _plane(start: np.ndarray, end: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Directions of length one to the start and at right angles to it: of two coordinates
    counterclockwise, of three towards the end.
    """
    first, last = np.linalg.norm(start), np.linalg.norm(end)
    if not first * last > 0:
        raise InputError("a path winds round the origin, so neither of its ends may lie there")
    ahead = start / first
    if len(start) == 2:  # counterclockwise, from the first coordinate named to the second
        return ahead, np.array([-ahead[1], ahead[0]])
    side = end - (end @ ahead) * ahead
    if np.linalg.norm(side) <= ALIGNED * last:  # any plane through a line will do
        side = np.eye(len(start))[np.argmin(np.abs(ahead))]
        side = side - (side @ ahead) * ahead
    return ahead, side / np.linalg.norm(side)

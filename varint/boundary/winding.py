"""Ways round the origin: how often a path goes round, and first paths that do."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import NamedTuple

import casadi as ca
import numpy as np

from varint.errors import InputError
from varint.integration.error_scale import bodies
from varint.results.records import own_action, with_own_action
from varint.results.trajectory import Trajectory
from varint.scene.memory import per_system
from varint.scene.system import System

WAVY = 0.3  # radians, or of the distance: a way round the origin keeps its number of turns
ALIGNED = 1e-9  # sine of an angle: directions this close leave their plane open
SURE = 2.5  # radians between two nodes: where more are turned a way may as well go back
BESIDE = 0.1  # of the nearer end's distance: a line that passes a singular place so near is bent
ALONG = 33  # nodes of a line that is bent
PLACES = 4  # at which it is looked whether the scene is singular where bodies meet


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


def bent_aside(system: System, ends: np.ndarray) -> np.ndarray:
    """The line between two ends, bent where it leads through a place at which the scene is
    singular, or close by, to a spiral on the side on which it passes.
    """
    nodes, s = ends, np.linspace(0, 1, ALONG)
    for _, rows in singular_places(system):
        start, end = places = ends @ rows.T
        line = np.linspace(start, end, ALONG)
        nearer, way = np.linalg.norm(places, axis=1).min(), end - start
        if not nearer > 0 or not way.any():
            continue
        foot = np.clip(-(start @ way) / (way @ way), 0, 1)
        if np.linalg.norm(start + foot * way) > BESIDE * nearer:
            continue
        ahead, side = _plane(start, end)
        turns = 0 if np.arctan2(end @ side, end @ ahead) >= 0 else -1
        aside = round_path(start, end, turns, s, np.zeros((ALONG, len(start)))) - line
        nodes = np.linspace(ends[0], ends[1], ALONG) if nodes is ends else nodes
        nodes = nodes + aside @ np.linalg.pinv(rows).T
    return nodes


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
    return with_own_action(wound, own_action(path))


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


def with_ways_compared(path: Trajectory, guess: np.ndarray) -> Trajectory:
    """The path with ``stats["winding"]`` and ``stats["winding_of_guess"]``: how often it and its
    first path (nodes, n) go round each place where the scene is singular, the origin or another
    body; none where the nodes leave it open.
    """
    found = _turns_of_both(path.system, path.q, guess)
    if not found:
        return path
    own, wanted = ({names: both[i] for names, both in found.items()} for i in range(2))
    stats = {**path.stats, "winding": own, "winding_of_guess": wanted}
    told = replace(path, stats=MappingProxyType(stats))
    return with_own_action(told, own_action(path))


def goes_as(system: System, nodes: np.ndarray, guess: np.ndarray) -> bool:
    """Whether a path goes round as its first path does, as far as the nodes (…, n) of both tell."""
    return all(own == wanted for own, wanted in _turns_of_both(system, nodes, guess).values())


def _turns_of_both(
    system: System, nodes: np.ndarray, guess: np.ndarray
) -> dict[tuple[str, ...], tuple[int, int]]:
    """Turns of a path and of its guess round the places at which the scene is singular."""
    found = {}
    for names, rows in singular_places(system):
        ways = [places @ rows.T for places in (nodes, guess)]
        if all(_is_sure(places) for places in ways):
            found[names] = (_turns(ways[0]), _turns(ways[1]))
    return found


def other_way(path: Trajectory) -> str | None:
    """What to say of a path that does not go the way of its guess."""
    stats = path.stats
    for names, turns in stats.get("winding", {}).items():
        wanted = stats["winding_of_guess"][names]
        if turns != wanted:
            where = "the origin" if not any("-" in name for name in names) else "another body"
            return (
                f"the path goes another way round {where} than its guess: ({', '.join(names)}) "
                f"makes {turns} whole turns, the guess {wanted} (−1: the other way round, less "
                "than once). None was found that goes as the guess does; draw it nearer to a "
                "motion, or look with paths(winding=)"
            )
    return None


@per_system
def singular_places(system: System) -> list[tuple[tuple[str, ...], np.ndarray]]:
    """Places of bodies, two or three coordinates each, or from one body to another, that the scene
    is singular at when they are zero: their names, and the rows (k, n) that they are of q.
    """
    names, unit = system.names, np.eye(system.structure.n)
    each = [tuple(index) for index in bodies(names)]
    if not each and len(names) in (2, 3):
        each = [tuple(range(len(names)))]
    candidates = [(tuple(names[i] for i in index), unit[list(index)]) for index in each]
    for one, two in itertools.combinations([x for x in each if len(x) in (2, 3)], 2):
        if len(one) == len(two):
            apart = tuple(f"{names[j]}-{names[i]}" for i, j in zip(one, two, strict=True))
            candidates.append((apart, unit[list(two)] - unit[list(one)]))
    value = ca.Function("value", [system.q, system.v, system.t, system.c], [system.lagrangian])
    rng, found = np.random.default_rng(0), []
    for told, rows in candidates:
        if len(rows) in (2, 3) and _is_singular(system, value, rows, rng):
            found.append((told, rows))
    return found


def _is_singular(
    system: System, value: ca.Function, rows: np.ndarray, rng: np.random.Generator
) -> bool:
    """Whether the Lagrangian is no number where these places are zero, and is one elsewhere."""
    for _ in range(PLACES):
        q = rng.normal(size=system.structure.n)
        met, v = q.copy(), np.zeros_like(q)
        for row in rows:
            first, other = int(np.argmin(row)), int(np.argmax(row))
            met[other] = met[first] if row[first] < 0 else 0.0
        beside, there = (float(value(x, v, 0.0, system.default_vector)) for x in (q, met))
        if not np.isfinite(beside) or np.isfinite(there):
            return False
    return True


def _is_sure(places: np.ndarray) -> bool:
    """Whether the nodes leave no doubt how often they go round."""
    if not np.linalg.norm(places, axis=1).all():
        return False
    ahead, side = _plane(places[0], places[-1])
    angle = np.unwrap(np.arctan2(places @ side, places @ ahead))
    return bool(np.abs(np.diff(angle)).max(initial=0.0) < SURE)

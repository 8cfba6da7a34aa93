"""Nodes that were left out, taken once more from the last step to the first with few states in
memory: a binomial schedule of checkpoints.

Griewank & Walther, Algorithm 799: revolve, 2000: with s states stored, the first one included, and
no step taken more than r times besides, C(s + r, s) pieces are taken back, and no schedule does
more.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from varint.errors import InputError
from varint.integration.backend import blocks_of
from varint.results.trajectory import Trajectory
from varint.scene.system import System
from varint.sensitivities.pieces import (
    Piece,
    cannot_go_on,
    cuts,
    piece_again,
    piece_between,
    problem_again,
    scene_of,
    times_of,
)

FEWEST = 5  # states with which a run can be taken once more
STORED = 2**26  # bytes of the nodes of a piece that are no shortage of memory


class Room(NamedTuple):
    """What stands in memory at a time: checkpoints, and the nodes of a piece."""

    checkpoints: int
    steps: int


def room_for(steps: int, states: int | None, numbers: int) -> Room:
    """Half of the states for checkpoints, half for a piece of steps. By default 2√N of N steps,
    but for a piece as many as fit into `STORED`, with so many numbers each.

    Raises
    ------
    InputError
        If the states are too few.
    """
    some = max(2 * math.isqrt(steps), FEWEST) if states is None else states
    if not isinstance(some, (int, np.integer)) or some < FEWEST:
        raise InputError(f"states must be a whole number from {FEWEST} on, got {states!r}")
    checkpoints = int(some) // 2  # the rest: nodes of a piece, and a state on its way to one
    room = Room(checkpoints, int(some) - checkpoints - 2)
    if states is not None:
        return room
    return room._replace(steps=max(room.steps, min(steps, STORED // (8 * numbers))))


def numbers_of(motion: Trajectory) -> int:
    """What stands in memory for a step of a piece: node, velocity and the seed of its adjoint, time
    and size, controls.
    """
    return 5 * motion.q.shape[1] + 3 + len(motion.rule.nodes) * motion.u.shape[2]


def pieces_backwards(
    motion: Trajectory, first: int, last: int, states: int | None = None
) -> Iterator[Piece]:
    """The steps from the kept node `first` to the kept node `last`, the last piece first."""
    begin, scene = int(motion.k[first]), scene_of(motion)
    room = room_for(int(motion.k[last]) - begin, states, numbers_of(motion))
    for a, b in reversed(list(cuts(motion, first, last, room.steps))):
        if b == a + 1 and motion.k[b] - motion.k[a] > room.steps:
            yield from _by_checkpoints(motion, scene, a, begin, room)
        else:
            yield piece_between(motion, scene, a, b, int(motion.k[a]) - begin)


def _by_checkpoints(
    motion: Trajectory, scene: System, a: int, begin: int, room: Room
) -> Iterator[Piece]:
    """The steps between two kept nodes, piece by piece, the last one first."""
    k0, k1 = motion.k[[a, a + 1]].tolist()
    count = -(-(k1 - k0) // room.steps)
    ends = np.minimum(k0 + room.steps * np.arange(count + 1), k1).tolist()
    stored = {0: motion[a : a + 2]}
    for act, at, to in schedule(count, room.checkpoints):
        if act == "store":
            stored[to] = _advanced(stored[at], scene, ends[to])
        elif act == "drop":
            del stored[at]
        else:
            source = stored[at] if at == to else _advanced(stored[at], scene, ends[to])
            piece = piece_again(source, scene, 0, ends[to + 1], ends[to] - begin)
            del source
            yield piece._replace(node=a, last=a + 1)
            del piece


def schedule(count: int, checkpoints: int) -> Iterator[tuple[str, int, int]]:
    """How `count` pieces are taken backwards from the state at the first with so many states more
    in memory.

    ("store", i, j): run from the stored state i to j and keep that; ("take", i, j): run from the
    stored state i to j, and take piece j back; ("drop", i, i).
    """
    stored, end = [0], count
    while end:
        at, left = stored[-1], checkpoints - (len(stored) - 1)
        if end - at == 1 or not left:
            end -= 1
            yield "take", at, end
            if end == at and at:
                stored.pop()
                yield "drop", at, at
            continue
        sweeps, span = 1, end - at
        while math.comb(left + 1 + sweeps, sweeps) < span:
            sweeps += 1
        few = math.comb(left + sweeps - 1, left)  # that one sweep less takes behind the next state
        ahead = min(math.comb(left + sweeps, left + 1), span - few)
        stored.append(at + ahead)
        yield "store", at, at + ahead


def _advanced(motion: Trajectory, scene: System, k: int) -> Trajectory:
    """A run of two nodes, the first of them taken on to step k."""
    if k == motion.k[0]:
        return motion
    problem, kernel = problem_again(motion, scene, 0, int(motion.k[0]), k)
    steps = problem.steps - problem.first
    found = None
    for block in blocks_of(scene, motion.rule, problem._replace(save_every=steps), kernel):
        if block.good:
            found = block.q[block.good - 1], block.p[block.good - 1], int(block.k[block.good - 1])
        if block.good < len(block.k):
            break
    if found is None or found[2] != k:
        raise cannot_go_on(problem, int(motion.k[0]) if found is None else found[2])
    q, p = motion.q.copy(), motion.p.copy()
    q[0], p[0] = found[:2]
    at = np.array([k, motion.k[1]])
    return replace(motion, t=times_of(motion, 0, at), q=q, p=p, k=at)

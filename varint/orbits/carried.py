"""Displacements carried along a run, stretch by stretch: each by the exact tangent map of the run's
own steps, and made new before it grows out of its numbers.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator
from typing import NamedTuple

import numpy as np

from varint.errors import ConvergenceError, InputError
from varint.integration.backend import kernel_for
from varint.integration.problem import InitialValueProblem
from varint.numerics.progress import progress_bar
from varint.orbits.tangent_lift import tangent_lift
from varint.results.require import require_trajectory
from varint.results.trajectory import Trajectory
from varint.scene.system import System
from varint.sensitivities.loops import sweeper
from varint.sensitivities.pieces import Piece, all_nodes, pieces, scene_of
from varint.sensitivities.steps_at_once import Directions
from varint.sensitivities.sweeps import forwards

LONGEST_STRETCH = 8192  # steps
MOST_NUMBERS = 4_000_000  # of the displacements of a stretch


class Pace(NamedTuple):
    """How stretches become longer: steps of the first, how many times the one before at most, and
    what part of the fastest growth a step is remembered after each, for what was fast may be again.
    """

    first: int
    longer: int
    remembered: float


LIFTED, SWEPT = Pace(16, 4, 0.5), Pace(1, 2, 0.9)


class Stretch(NamedTuple):
    """Some steps of a run.

    Attributes
    ----------
    k : ndarray of int (S + 1,)
        Steps before each node.
    t : ndarray (S + 1,)
    end : ndarray (2n,)
        (q, p) at the last node.
    tangents : ndarray (S + 1, 2n, m)
        Displacements (δq, δp).
    """

    k: np.ndarray
    t: np.ndarray
    end: np.ndarray
    tangents: np.ndarray


# the stretch → its displacements to go on with, and the logarithm of how much they grew
Renewal = Callable[[Stretch], tuple[np.ndarray, float]]


def scene_to_vary(motion: Trajectory) -> System:
    """The scene whose motion can have displacements carried along.

    Raises
    ------
    InputError
        If the run has no tangent map of this kind.
    """
    require_trajectory(motion)
    scene = scene_of(motion)
    if scene.structure.nonholonomic:
        raise InputError(
            "the scene has non-holonomic constraints: its flow is not Hamiltonian and not "
            "covered here; sensitivity(motion) has its derivatives"
        )
    return scene


def stretches(
    motion: Trajectory, tangents: np.ndarray, renew: Renewal, allowed: float, progress: bool | None
) -> Iterator[Stretch]:
    """The run from its first kept node to its last; displacements (2n, m) begin at the first one
    and are renewed after every stretch, which is as long as their growth allows.

    A single displacement without constraints is carried by the loop that takes the steps
    themselves, in the scene's `tangent_lift`; others by the derivatives of the steps.
    """
    scene = scene_to_vary(motion)
    lifted = tangents.shape[1] == 1 and not scene.structure.constraints and motion.sizes is None
    longest = int(np.clip(MOST_NUMBERS // tangents.size, 1, LONGEST_STRETCH))
    pace = LIFTED if lifted else SWEPT
    length, total = pace.first, int(motion.k[-1] - motion.k[0])
    source = (_by_lift if lifted else _by_sweeps)(motion, scene, tangents, length)
    with progress_bar(total, "step", progress) as move:
        done, rate, one = 0, 0.0, next(source)
        while True:
            tangents, grown = renew(one)
            steps = len(one.k) - 1
            rate = max(grown / steps, pace.remembered * rate, allowed / longest)
            length = int(max(min(allowed / rate, pace.longer * length), 1))
            done += steps
            move(steps, lambda: "")
            yield one
            if done == total:
                return
            one = source.send((tangents, length))


# stretches, each after the displacements and the most steps of the next one are told
Source = Generator[Stretch, tuple[np.ndarray, int], None]


def _by_sweeps(motion: Trajectory, scene: System, tangents: np.ndarray, length: int) -> Source:
    """By the derivatives of the steps."""
    steps = int(motion.k[-1] - motion.k[0])
    by = sweeper(scene, motion.rule, steps, "auto")
    for piece in pieces(motion):
        a, count = 0, len(piece.t)
        while a < count:
            b = min(a + length, count)
            part = _part(piece, a, b)
            directions = Directions(np.zeros((len(motion.c) + 2, tangents.shape[1])))
            found = forwards(by, part, motion.c, directions, np.ascontiguousarray(tangents))
            k = int(motion.k[0]) + piece.first + np.arange(a, b + 1)
            t = np.append(part.t, part.t[-1] + part.h[-1])
            tangents, length = yield Stretch(k, t, part.x[-1], found)
            a = b


def _part(piece: Piece, a: int, b: int) -> Piece:
    """Steps a … b − 1 of a piece."""
    return piece._replace(
        first=piece.first + a,
        x=piece.x[a : b + 1],
        v=piece.v[a : b + 1],
        t=piece.t[a:b],
        h=piece.h[a:b],
        u=piece.u[a:b],
    )


def _by_lift(motion: Trajectory, scene: System, tangents: np.ndarray, length: int) -> Source:
    """By the steps of the tangent lift; q and p are the run's own again at every kept node."""
    beside, rule, n = tangent_lift(scene), motion.rule, motion.q.shape[1]
    ends = motion.k.astype(int)
    origin = float(motion.t[0] - ends[0] * motion.h) if motion.origin is None else motion.origin

    def problem(x: np.ndarray, displacement: np.ndarray, k0: int, k1: int) -> InitialValueProblem:
        q = np.concatenate([x[:n], displacement[:n]])
        p = np.concatenate([displacement[n:], x[n:]])
        return InitialValueProblem(
            q, p, origin, motion.h, k1, 1, motion.u, motion.c, len(rule.nodes), first=k0
        )

    x, k = np.concatenate([motion.q[0], motion.p[0]]), int(ends[0])
    whole = problem(x, tangents[:, 0], 0, int(ends[-1]))
    kernel = kernel_for(beside, rule, whole, "auto")
    while k < ends[-1]:
        kept = int(np.searchsorted(ends, k + length, side="right")) - 1
        to = int(ends[kept]) if ends[kept] > k else min(k + length, int(ends[kept + 1]))
        found = None
        while found is None:
            try:
                found = all_nodes(beside, rule, problem(x, tangents[:, 0], k, to), kernel)
            except ConvergenceError:  # a displacement that grew out of what is solved beside it
                if to == k + 1:
                    raise
                to = (k + to) // 2
        steps = np.arange(k, to + 1)
        own = np.hstack([found[:, :n], found[:, 3 * n :]])
        carried = found[:, n : 3 * n, None]
        here = np.searchsorted(ends, to)
        x = np.concatenate([motion.q[here], motion.p[here]]) if ends[here] == to else own[-1]
        tangents, length = yield Stretch(steps, origin + motion.h * steps, x, carried)
        k = to

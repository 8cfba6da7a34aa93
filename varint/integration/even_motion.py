"""Motions of equal steps with a node at each, of which nothing is made but what runs have found."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from varint.integration.many_steps import in_gear, steps_again
from varint.integration.plan import Plan
from varint.integration.trajectories import stats_of
from varint.results.trajectory import Trajectory
from varint.scene.system import System

if TYPE_CHECKING:
    from varint.codegen.kernel import Kernel

_new, _set = object.__new__, object.__setattr__


def even_motion_of(
    system: System,
    chosen: Plan,
    kernel: Kernel,
    nodes: np.ndarray,
    grid: tuple[float, float, int, np.ndarray],
    work: Sequence[float],
    more: dict[str, Any],
) -> Trajectory:
    """`plain_motion_of` one with a node at each of its equal steps: (q, p) and perhaps v,
    (h, t0, steps, c). What follows from these is made when it is asked for.
    """
    h, t0, steps, c = grid
    known = {
        "system": system,
        "rule": chosen.rule,
        "q": nodes[0],
        "p": nodes[1],
        "h": h,
        "c": c,
        "origin": t0,
        "_make": partial(_made, chosen, kernel, (h, t0, steps), work, more),
    }
    if len(nodes) > 2:
        known["v"] = nodes[2]
    motion = _new(Trajectory)
    _set(motion, "__dict__", known)
    return motion


def _made(
    chosen: Plan,
    kernel: Kernel,
    grid: tuple[float, float, int],
    work: Sequence[float],
    more: dict[str, Any],
    name: str,
) -> Any:
    """The field of this name."""
    h, t0, steps = grid
    if name == "stats":
        return stats_of(chosen, kernel, steps, (int(work[0]), work[1]), more)
    if name == "functions":
        return steps_again(chosen.rule, in_gear)
    if name == "u":
        return np.empty((steps, 1, 0))
    if name == "fictitious":
        return None
    k = np.arange(steps + 1, dtype=np.int64)
    return k if name == "k" else h * k + t0

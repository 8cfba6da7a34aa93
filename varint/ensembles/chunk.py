"""Some members' motions: what workers hand back, and what stores keep."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from varint.ensembles.members import Members
from varint.scene.system import System


class Said(NamedTuple):
    """A warning of a member's run, and what was estimated of its error."""

    member: int
    estimate: float
    category: type[Warning]
    text: str


@dataclass(frozen=True, eq=False)
class Chunk:
    """Some members' motions.

    Attributes
    ----------
    first : int
        Number of the first member.
    q, p : array (members, N + 1, n)
        Rows from a member's `good` on are no data.
    good : array of int (members,)
        Number of nodes that are solved.
    step : array of int (members,)
        Steps done.
    residual : array (members,)
        Worst residual of the solved steps.
    failed : array (members,)
        Residual of the step that failed (infinite where its values were not finite); −1 where none
        did.
    estimate : array (members,)
        Estimated errors of members whose steps were chosen; NaN elsewhere.
    said : tuple of Said
        Warnings of the members' runs; stores do not keep them.
    """

    first: int
    q: np.ndarray
    p: np.ndarray
    good: np.ndarray
    step: np.ndarray
    residual: np.ndarray
    failed: np.ndarray
    estimate: np.ndarray
    said: tuple[Said, ...] = ()

    def __len__(self) -> int:
        return len(self.q)


ARRAYS = ("q", "p", "good", "step", "residual", "failed", "estimate")  # that stores keep
NEW = ("estimate",)  # which stores of earlier versions lack


def empty_chunk(system: System, members: Members) -> Chunk:
    """A chunk of these members before any of them moves."""
    count = len(members)
    shape = (count, len(members.k), system.structure.n)
    good, step = np.zeros(count, dtype=int), np.zeros(count, dtype=int)
    q, p, residual, failed = np.zeros(shape), np.zeros(shape), np.zeros(count), np.full(count, -1.0)
    return Chunk(members.first, q, p, good, step, residual, failed, np.full(count, np.nan))


def from_arrays(first: int, arrays: dict[str, np.ndarray]) -> Chunk:
    """A chunk from what a store holds of it; what earlier versions did not write is not known."""
    unknown = np.full(len(arrays["q"]), np.nan)
    q, p, good, step, residual, failed, estimate = (arrays.get(name, unknown) for name in ARRAYS)
    return Chunk(first, q, p, good, step, residual, failed, estimate)

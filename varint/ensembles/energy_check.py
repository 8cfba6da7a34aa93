"""Members whose energy went astray: a step far too large, which nothing else tells."""

from __future__ import annotations

import warnings

import numpy as np

from varint.ensembles.batch import Chunk
from varint.ensembles.members import Members, is_plain
from varint.integration.energy_check import SAMPLES, energies, keeps_energy, nodes_astray
from varint.scene.system import System

SUSPICIOUS = 0.01  # of the change that raises the alarm: such members are looked at more closely


def members_astray(
    system: System, members: Members, chunk: Chunk
) -> list[tuple[int, float, float]]:
    """(number, energy at the start, energy where it strayed) of the members for which `simulate`
    would warn.
    """
    last = chunk.q.shape[1] - 1
    done = np.flatnonzero(chunk.failed < 0)
    if not (is_plain(system) and keeps_energy(system)) or not len(done):
        return []
    t = members.t0 + members.h * members.k

    def seen(which: np.ndarray, i: np.ndarray) -> list[np.ndarray]:
        q, p = (np.ascontiguousarray(x[which][:, i]) for x in (chunk.q, chunk.p))
        return energies(system, q, p, t[i], members.c[chunk.first + which], members.h)

    energy, *sizes = seen(done, np.array([0, last // 2, last]))
    done = done[nodes_astray(energy, sizes[0], sizes[1], SUSPICIOUS).any(axis=1)]
    if not len(done):
        return []
    energy, *sizes = seen(done, np.arange(SAMPLES) * last // (SAMPLES - 1))
    wrong = nodes_astray(energy, sizes[0], sizes[1])
    at = np.argmax(wrong, axis=1)
    return [
        (chunk.first + int(done[j]), energy[j, 0], energy[j, at[j]])
        for j in np.flatnonzero(wrong.any(axis=1))
    ]


def warn_of(found: list[tuple[int, float, float]], h: float) -> None:
    """One warning for all members that strayed."""
    if found:
        i, before, after = found[0]
        others = f"{len(found)} members" if len(found) > 1 else "one member"
        warnings.warn(
            f"the energy of {others} changed as nothing in the scene can do (member {i}: from "
            f"{before:.6g} to {after:.6g}): h = {h:g} is too large for them, try a smaller one"
            + (
                ""
                if np.isfinite(after)
                else ", or L is not defined where they went (√ or log of a negative number)"
            )
            + "; members "
            f"{[i for i, *_ in found[:20]]}{' …' if len(found) > 20 else ''}",
            stacklevel=3,
        )

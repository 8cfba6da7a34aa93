"""Members whose energy went astray: a step far too large, which nothing else tells."""

from __future__ import annotations

import warnings

import numpy as np

from varint.discrete.legendre import velocity_function
from varint.ensembles.batch import control_tables
from varint.ensembles.chunk import Chunk
from varint.ensembles.members import Members, is_plain
from varint.integration.energy_check import HUGE, energies, nodes_astray, nodes_looked_at
from varint.integration.work_bound import keeps_energy, powers_at, summed_work
from varint.numerics.arrays import over_columns
from varint.rules.rule import Rule
from varint.scene.system import System

SUSPICIOUS = 0.01  # of the change that raises the alarm: such members are looked at more closely
ROUGH = 33  # nodes of a member that tell roughly what forces do
MOST_ROWS = 1_000_000  # nodes whose powers are worked out at once


def members_astray(
    system: System, rule: Rule, members: Members, chunk: Chunk
) -> list[tuple[int, float, float]]:
    """(number, energy at the start, energy where it strayed) of the members for which `simulate`
    would warn.
    """
    last = chunk.q.shape[1] - 1
    done = np.flatnonzero(chunk.failed < 0)
    if not is_plain(system) or not len(done):
        return []
    t, conserved = members.t0 + members.h * members.k, keeps_energy(system)

    def seen(which: np.ndarray, i: np.ndarray) -> list[np.ndarray]:
        q, p = (np.ascontiguousarray(x[which][:, i]) for x in (chunk.q, chunk.p))
        return energies(system, q, p, t[i], members.c[chunk.first + which], members.h)

    part = SUSPICIOUS if conserved else 1.0  # what forces do is looked at beyond it alone
    energy, moving, kicked = seen(done, np.array([0, last // 2, last]))
    done = done[nodes_astray(energy, moving, kicked, part).any(axis=1)]
    if not len(done):
        return []
    given: np.ndarray | float = 0.0
    i = nodes_looked_at(last)
    if not conserved and (np.diff(members.k) > 1).any():
        given = _explosion(*seen(done, i))  # what forces did between the nodes is not known
    elif not conserved:  # few nodes tell of most members that forces explain their energy
        rough = np.unique(np.linspace(0, last, ROUGH).astype(int))
        energy, moving, kicked = seen(done, rough)
        given = _given(system, rule, members, chunk, done, rough)
        given = np.minimum(given, _explosion(energy, moving, kicked))
        done = done[nodes_astray(energy, moving, kicked, given=given).any(axis=1)]
        if not len(done):
            return []
        given = _given(system, rule, members, chunk, done, np.arange(last + 1))[:, i]
    energy, moving, kicked = seen(done, i)
    wrong = nodes_astray(energy, moving, kicked, given=given)
    at = np.argmax(wrong, axis=1)
    return [
        (chunk.first + int(done[j]), energy[j, 0], energy[j, at[j]])
        for j in np.flatnonzero(wrong.any(axis=1))
    ]


def _explosion(energy: np.ndarray, moving: np.ndarray, kicked: np.ndarray) -> np.ndarray:
    """A change of energy that no force makes, from the sizes in the first half of the nodes."""
    half = [x[:, : (x.shape[1] + 1) // 2] for x in (energy, moving, kicked)]
    return HUGE * np.nanmax(np.abs(half), axis=(0, 2))[:, None]


def _given(
    system: System, rule: Rule, members: Members, chunk: Chunk, which: np.ndarray, nodes: np.ndarray
) -> np.ndarray:
    """What forces and explicit time can have given to each of these members until each of these
    nodes, from the powers at them.
    """
    k, n = members.k[nodes], system.structure.n
    t, u = members.t0 + members.h * k, control_tables(system, rule, members).mean(axis=2)
    result, most = np.empty((len(which), len(t))), max(MOST_ROWS // len(t), 1)
    for a in range(0, len(which), most):
        some = which[a : a + most]
        q, p = (x[some][:, nodes].reshape(-1, n) for x in (chunk.q, chunk.p))
        times, c = np.tile(t, len(some)), np.repeat(members.c[chunk.first + some], len(t), axis=0)
        v = over_columns(velocity_function(system), q, p, times[:, None], c)[0]
        power = np.zeros(len(q))
        for shift in (0, -1) if u.size else (0,):  # controls jump at a node
            own = u[chunk.first + some] if len(u) > 1 else np.repeat(u, len(some), axis=0)
            now = own[:, np.clip(k + shift, 0, u.shape[1] - 1)].reshape(len(q), -1)
            power = np.maximum(power, np.abs(powers_at(system, q, v, now, times, c)))
        result[a : a + most] = summed_work(power.reshape(len(some), -1), t)
    return result


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

"""Uneven segments of a period: short ones, with short steps, where the motion is fast."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from varint.errors import ConvergenceError
from varint.orbits.phase import units_of
from varint.orbits.shooting import Iterate, Shooting, hasty_runs

COARSEST = 8  # segments of a period at least, all of them halves of halves of these
EACH = 16  # steps of a segment: with fewer the linear algebra costs more than the steps
DEEPEST = 30  # halvings of the coarsest: a collision
MOST = 96  # segments: the equations of an orbit are one dense matrix
ROUND_OFF = 1e-10  # errors that no longer shrink are this small at most
SHRINKS = 8.0  # by halving, errors that are not round-off
WORTH = 0.5  # of the equal steps: fewer uneven ones are taken

State = Callable[[float], np.ndarray | None]  # (part of the period) → a state known there


class Mesh(NamedTuple):
    """Segments of a period, of `EACH` steps.

    Attributes
    ----------
    parts : ndarray (M,)
        Durations, in periods.
    x : ndarray (M, 2n)
        States (q, p) at their beginnings.
    nodes : ndarray (N, 2n)
        States at all steps.
    """

    parts: np.ndarray
    x: np.ndarray
    nodes: np.ndarray


def uneven(shooting: Shooting, at: Iterate, known: State, tol: float) -> Mesh | None:
    """Segments whose steps leave errors below `tol`, of the sizes that coordinates and momenta
    have had until then; None where there would be too many, or hardly fewer steps than equal ones.

    A segment is halved until its end hardly changes when its steps are halved, and the next one
    begins there, or where `known` says.
    """
    n = at.x.shape[1] // 2
    largest = np.abs(at.x[0])
    begin, x = 0.0, at.x[0]
    parts: list[float] = []
    states: list[np.ndarray] = []
    nodes: list[np.ndarray] = []
    todo = [(1.0 / COARSEST, np.inf)] * COARSEST
    while todo:
        if len(parts) + len(todo) > MOST:
            return None
        part, before = todo.pop()
        given = known(begin)
        x = x if given is None else given
        tried = _ends(shooting, at, x, begin, part)
        error = np.inf
        if tried is not None:
            seen, ends = tried
            wide = np.maximum(largest, np.abs(seen).max(axis=0))
            scale = units_of(np.vstack([np.zeros(2 * n), wide])).scale
            error = float((np.abs(ends[1] - ends[0]) / scale).max())
        if error <= tol or (error < ROUND_OFF and error > before / SHRINKS):
            largest = wide
            parts.append(part)
            states.append(x)
            nodes.append(seen)
            begin, x = begin + part, ends[1]
            continue
        if part < 2.0**-DEEPEST:
            return None
        todo += [(part / 2, error)] * 2
    shortest = min(parts)
    if len(parts) > WORTH / shortest:
        return None
    return Mesh(np.array(parts), np.array(states), np.concatenate(nodes))


def _ends(
    shooting: Shooting, at: Iterate, x: np.ndarray, begin: float, part: float
) -> tuple[np.ndarray, list[np.ndarray]] | None:
    """Nodes of a segment, and its end by its steps and by half as long ones."""
    alone = replace(
        shooting,
        segments=1,
        each=EACH,
        parts=None,
        t0=shooting.t0 + at.period * begin,
        shift=np.zeros_like(shooting.shift),
    )
    there = Iterate(x[None], at.period * part, at.c)
    try:
        pieces = [hasty_runs(one, there)[0].x for one in (alone, replace(alone, each=2 * EACH))]
    except ConvergenceError:
        return None
    if not all(np.isfinite(piece).all() for piece in pieces):
        return None
    return pieces[0], [piece[-1] for piece in pieces]


def meshed(shooting: Shooting, mesh: Mesh) -> Shooting:
    """The same period in the segments of a mesh."""
    return replace(shooting, segments=len(mesh.parts), each=EACH, parts=mesh.parts)

"""Switches by time alone: when they are, found before the run, so that steps end there."""

from __future__ import annotations

from typing import NamedTuple

import casadi as ca
import numpy as np

from varint.integration.switches.frozen import frozen_scene
from varint.numerics.arrays import over_columns
from varint.scene.memory import per_system
from varint.scene.system import System

LOOKS, MOST_LOOKS = 2**10, 2**18  # times at which they are looked at
SAME = 3  # numbers of looks, each twice the one before, that find the same
AT_ONCE = 16 * np.finfo(float).eps  # relative: switches that are this near are one


class Timed(NamedTuple):
    """Places of the switches by time alone, and (t, c) → the numbers behind them."""

    places: tuple[int, ...]
    values: ca.Function


class Timetable(NamedTuple):
    """Times of switches (k,) in the order of the run, the numbers behind them before, between
    and after them, (k + 1, places), and the controls there, (k + 1, controls).
    """

    times: np.ndarray
    values: np.ndarray
    controls: np.ndarray


@per_system
def timed(system: System) -> Timed:
    """The switches of a scene by time alone."""
    frozen = frozen_scene(system)
    assert frozen is not None
    places: list[int] = []
    values: list[ca.SX] = []
    for j in range(frozen.s.numel()):
        sigma = frozen.sigma[j]
        if places:
            known = ca.vertcat(*(frozen.s[i] for i in places))
            sigma = ca.substitute(sigma, known, ca.vertcat(*values))
        if not ca.depends_on(sigma, ca.vertcat(system.q, system.v, frozen.s, frozen.controls)):
            places.append(j)
            values.append(ca.floor(sigma) if frozen.counts[j] else ca.sign(sigma))
    found = ca.densify(ca.vertcat(ca.SX(0, 1), *values))
    return Timed(tuple(places), ca.Function("timed", [system.t, system.c], [found], {"cse": True}))


def timetable(
    system: System, c: np.ndarray, t0: float, total: float, controls: np.ndarray
) -> Timetable:
    """When the switches by time alone are during a run, and when controls, (rows, controls), each
    of which acts as long as the others, change.
    """
    places, function = timed(system)
    rows, found = len(controls), np.empty(0)

    def values(t: np.ndarray) -> np.ndarray:
        return over_columns(function, t[:, None], c)[0]

    if places:
        looks, agree, found = LOOKS, 1, _changes(values, t0, total, LOOKS)
        while agree < SAME and looks < MOST_LOOKS:
            looks *= 2
            more = _changes(values, t0, total, looks)
            agree = agree + 1 if len(more) == len(found) else 1
            found = more
    if rows > 1:
        ends = t0 + total / rows * np.arange(1, rows)
        found = _apart(np.append(ends, found), t0, total)
    edges = np.concatenate([[t0], found, [t0 + total]])
    middle = (edges[1:] + edges[:-1]) / 2
    between = values(middle) if places else np.empty((len(middle), 0))
    row = np.clip(np.floor((middle - t0) / total * rows).astype(int), 0, rows - 1)
    known = np.hstack([between, controls[row]])
    new = (known[1:] != known[:-1]).any(axis=1)
    kept = np.append(True, new)
    return Timetable(found[new], between[kept], controls[row][kept])


def _changes(values, t0: float, total: float, looks: int) -> np.ndarray:
    """Times at which the values change, as far as so many looks show, by bisection."""
    t = t0 + total * np.linspace(0.0, 1.0, looks + 1)
    at = values(t)
    change = np.flatnonzero((at[1:] != at[:-1]).any(axis=1))
    left, right, before, after = t[change], t[change + 1], at[change], at[change + 1]
    found = []
    while len(left):
        a, b = left.copy(), right.copy()
        for _ in range(64):
            middle = (a + b) / 2
            same = (values(middle) == before).all(axis=1)
            a, b = np.where(same, middle, a), np.where(same, b, middle)
        found.append(b)
        there = values(b)
        more = (there != after).any(axis=1)
        left, right, before, after = b[more], right[more], there[more], after[more]
    return _apart(np.concatenate([np.empty(0), *found]), t0, total)


def _apart(times: np.ndarray, t0: float, total: float) -> np.ndarray:
    """Times within the run in its order, of those that round-off does not part the first."""
    every = times[np.argsort((times - t0) * np.sign(total), kind="stable")]
    close = AT_ONCE * max(abs(t0), abs(t0 + total))
    every = every[(np.abs(every - t0) > close) & (np.abs(every - t0 - total) > close)]
    apart = np.abs(np.diff(every, prepend=np.inf)) > close
    return every[apart]

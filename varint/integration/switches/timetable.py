"""Switches by time alone: when they are, found before the run, so that steps end there."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import casadi as ca
import numpy as np

from varint.integration.switches.frozen import frozen_scene
from varint.numerics.arrays import over_columns
from varint.scene.memory import lately, per_system
from varint.scene.system import System

LOOKS, MOST_LOOKS = 2**10, 2**18  # times at which they are looked at
SAME = 3  # numbers of looks, each twice the one before, that find the same
PARTS = 16  # into which what holds a change is cut, again and again
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
    asked = c.tobytes(), t0, total, controls.shape, controls.tobytes()
    # all runs of a search, and the next call, ask for the same
    return lately(_known(system), asked, lambda: _found(system, c, t0, total, controls), 1)


@per_system
def _known(system: System) -> dict[object, Timetable]:
    """The timetable that was asked for last."""
    return {}


def _found(
    system: System, c: np.ndarray, t0: float, total: float, controls: np.ndarray
) -> Timetable:
    places, function = timed(system)
    rows, found = len(controls), np.empty(0)

    def values(t: np.ndarray) -> np.ndarray:
        return over_columns(function, t[:, None], c)[0]

    if places:
        changes = _changes(values, t0, total)
        found = _apart(_located(values, changes), t0, total)
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


class _Changes(NamedTuple):
    """Times between which values change, and these there."""

    left: np.ndarray
    right: np.ndarray
    before: np.ndarray
    after: np.ndarray


Values = Callable[[np.ndarray], np.ndarray]


def _changes(values: Values, t0: float, total: float) -> _Changes:
    """Between which looks values change; so many that half and a quarter of them find as many."""
    looks = LOOKS << (SAME - 1)
    while True:
        t = t0 + total * np.linspace(0.0, 1.0, looks + 1)
        at = values(t)
        counts = {int(_changed(at[:: 1 << i]).sum()) for i in range(SAME)}
        if len(counts) == 1 or looks >= MOST_LOOKS:
            break
        looks *= 2
    change = np.flatnonzero(_changed(at))
    return _Changes(t[change], t[change + 1], at[change], at[change + 1])


def _changed(at: np.ndarray) -> np.ndarray:
    return (at[1:] != at[:-1]).any(axis=1)


def _located(values: Values, changes: _Changes) -> np.ndarray:
    """When values change first between each two times, to the last digit; and again, where behind
    that they are not yet what they are to become.
    """
    found = []
    left, right, before, after = changes
    cuts = np.arange(1, PARTS) / PARTS
    while len(left):
        a, b, there = left.copy(), right.copy(), after.copy()
        while True:
            within = a[:, None] + (b - a)[:, None] * cuts
            if not ((within != a[:, None]) & (within != b[:, None])).any():
                break
            at = values(within.reshape(-1)).reshape(*within.shape, -1)
            last = np.argmin((at == before[:, None]).all(axis=2), axis=1)
            each = np.arange(len(a))
            changed = (at[each, last] != before).any(axis=1)
            low = np.where(changed, last - 1, PARTS - 2)
            a = np.where(low >= 0, within[each, low], a)
            b = np.where(changed, within[each, last], b)
            there = np.where(changed[:, None], at[each, last], there)
        found.append(b)
        more = (there != after).any(axis=1)
        left, right, before, after = b[more], right[more], there[more], after[more]
    return np.concatenate([np.empty(0), *found])


def _apart(times: np.ndarray, t0: float, total: float) -> np.ndarray:
    """Times within the run in its order, of those that round-off does not part the first."""
    every = times[np.argsort((times - t0) * np.sign(total), kind="stable")]
    close = AT_ONCE * max(abs(t0), abs(t0 + total))
    every = every[(np.abs(every - t0) > close) & (np.abs(every - t0 - total) > close)]
    apart = np.abs(np.diff(every, prepend=np.inf)) > close
    return every[apart]

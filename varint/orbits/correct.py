"""Newton's method for an orbit: the closed chain of segments, bordered by what is conserved."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from varint.errors import ConvergenceError
from varint.orbits.chain import Links, condensed
from varint.orbits.phase import Units, on_manifold
from varint.orbits.shooting import (
    Iterate,
    Linear,
    Run,
    Shooting,
    gaps,
    is_finite,
    linearise,
    runs,
)
from varint.sensitivities.pieces import Piece

# of the largest singular value: directions that no equation tells apart; where a step along them
# does not help, more of them are left alone, for an integral that nobody named makes a null vector
# at the solution alone, and steps of its round-off
RANKS = (1e-11, 1e-8, 1e-6)
MOST_ITERATIONS = 40
HALVINGS = 10
FINE = 1e-13  # in units: corrections that are round-off
LOOSE = 1e-7  # of the change a correction makes: gaps no longer shrink, but are round-off by then
CLOSED = 1e-9  # in units: gaps that round-off may leave, with the growth of a segment
SETTLED = 5e-14  # in units: gaps this small close no further where corrections have stalled
LEFT = 1e-3  # in units: gaps that no correction closes, but shorter steps; larger are no orbit's
STALLED = 0.25  # of the correction before: Newton's converge quadratically until they are round-off
FAR = 10.0  # in units: no correction is longer


class Row(NamedTuple):
    """One more equation: coefficients of the corrections, and what is missing.

    Attributes
    ----------
    by_x : ndarray (M, d)
    by_period, by_parameter : float
        In units of the period and of the parameter.
    missing : float
    """

    by_x: np.ndarray
    by_period: float
    by_parameter: float
    missing: float


Rows = Callable[[Iterate, Linear | None], list[Row]]


@dataclass(frozen=True, eq=False)
class Wanted:
    """What is to be solved.

    Attributes
    ----------
    shooting : Shooting
    units : Units
    period, parameter : float
        Units of both.
    index : int or None
        Of the parameter that is free.
    rows : callable
        (iterate, linear or None) → what holds besides: energy, period, arclength. Without the
        linearisation only `missing` counts.
    drive : int
        The power of the free parameter that the period of a driven scene goes with, 0 if with none.
    """

    shooting: Shooting
    units: Units
    period: float
    parameter: float
    index: int | None
    rows: Rows
    drive: int = 0


class Corrected(NamedTuple):
    """An orbit that closes, with its segments, and their maps, there."""

    at: Iterate
    pieces: list[Piece]
    linear: Linear
    residual: float
    iterations: int


class Patience(NamedTuple):
    """How long Newton's method is tried.

    Attributes
    ----------
    iterations : int
        Corrections at most.
    trials : int
        Lengths of one that are tried, each half the one before.
    slowest : float
        Of the correction before: one that is longer, and no round-off, is the last.
    run : callable
        How segments are run.
    """

    iterations: int
    trials: int
    slowest: float
    run: Run


SEARCH = Patience(MOST_ITERATIONS, HALVINGS, np.inf, runs)


def bordered(wanted: Wanted, at: Iterate, linear: Linear) -> Links:
    """Σ: Φ_i ξ_i − ξ_{i+1} + ∂x/∂T δT + ∂x/∂c δc + Σ_j α_j ∇J_j = −gap, phases · ξ = 0, and the
    rows; besides ξ the unknowns are δT, δc, in their units, and α.

    ∇J are left null vectors of Φ − 1, so their multipliers α vanish at a solution; with the phases
    of the flow and of the symmetries, which are right null vectors, the matrix is regular (Muñoz
    Almaraz et al., Physica D 181 (2003) 1).
    """
    m, d = linear.by_period.shape
    k, free = len(linear.gradients), wanted.shooting.autonomous
    by_parameter = linear.by_parameter
    if wanted.drive and wanted.index is not None:
        by_parameter = by_parameter + linear.by_period * (
            wanted.drive * at.period / at.c[wanted.index]
        )
    rows = wanted.rows(at, linear)
    rows += [Row(phase, 0.0, 0.0, 0.0) for phase in np.moveaxis(linear.phases, 1, 0)]
    aside = np.zeros((m, d, 2 + k))
    aside[:, :, 0] = linear.by_period * wanted.period * free
    aside[:, :, 1] = by_parameter * wanted.parameter
    aside[-1, :, 2:] = linear.gradients.T
    corner = np.zeros((len(rows), 2 + k))
    for border, row in zip(corner, rows, strict=True):
        border[:2] = row.by_period, row.by_parameter
    return Links(
        linear.maps,
        np.broadcast_to(-np.eye(d), (m, d, d)),
        aside,
        -linear.gaps,
        np.array([row.by_x for row in rows]).reshape(len(rows), m, d),
        corner,
        np.array([row.missing for row in rows]),
    )


def corrections(equations: Links) -> list[np.ndarray]:
    """Least solutions, those of the ranks that differ: directions along families of orbits that
    nothing tells apart stay.
    """
    chain = condensed(equations)
    values = chain.parts[1]
    ranks = sorted({int((values > cut * values[0]).sum()) for cut in RANKS}, reverse=True)
    return [chain.least(k) for k in ranks]


def moved(wanted: Wanted, at: Iterate, linear: Linear, change: np.ndarray) -> Iterate:
    """The iterate after a correction, on the manifold of the constraints."""
    m, d = linear.by_period.shape
    step, shooting = change[: m * d].reshape(m, d), wanted.shooting
    x = np.array([a + f.into @ s for a, f, s in zip(at.x, linear.frames, step, strict=True)])
    period, c = at.period + change[m * d] * wanted.period * shooting.autonomous, at.c.copy()
    if wanted.index is not None:
        c[wanted.index] += change[m * d + 1] * wanted.parameter
        period = driven_period(period, at.c, c, wanted.index, wanted.drive)
    times = shooting.t0 + period * shooting.beginnings
    if np.isfinite(x).all():
        x = np.array([on_manifold(shooting.system, y, t, c) for y, t in zip(x, times, strict=True)])
    return Iterate(x, period, c)


def driven_period(
    period: float, old: np.ndarray, new: np.ndarray, index: int | None, drive: int
) -> float:
    """The period of a driven scene after its parameter has changed."""
    if not drive or index is None:
        return period
    ratio = float(new[index] / old[index])
    return period * ratio**drive if ratio > 0 else np.nan


def correct(wanted: Wanted, at: Iterate, patience: Patience = SEARCH) -> Corrected:
    """Damped Newton steps until corrections are round-off.

    Raises
    ------
    ConvergenceError
        If the gaps do not close.
    """
    shooting, units, most = wanted.shooting, wanted.units, patience.iterations
    pieces = patience.run(shooting, at)
    merit, before = _merit(wanted, at, gaps(shooting, at, pieces, units)), np.inf
    last = np.inf
    for count in range(most + 1):
        linear = linearise(shooting, at, pieces, units, wanted.index)
        if merit == 0.0:
            return Corrected(at, pieces, linear, merit, count)
        steps = corrections(bordered(wanted, at, linear))
        length = float(np.abs(steps[0]).max())
        over = count == most or (merit <= SETTLED and length > STALLED * before)
        fine = length <= FINE
        if (fine and merit <= SETTLED) or (over and merit <= CLOSED and length <= LOOSE):
            return Corrected(at, pieces, linear, merit, count)
        shortest = float(np.abs(steps[-1]).max())
        if not np.isfinite(length) or count == most or shortest > patience.slowest * last:
            break
        before, last = length, max(shortest, CLOSED)
        trials = [x * min(1.0, FAR / max(float(np.abs(x).max()), FINE)) for x in steps]
        best = min((_tried(wanted, at, linear, x, patience) for x in trials), key=lambda x: x[0])
        if fine and best[0] > STALLED * merit and merit <= LEFT:
            return Corrected(at, pieces, linear, merit, count)
        rounded = merit <= SETTLED and shortest <= LOOSE  # then shorter steps say nothing
        for k in range(1, patience.trials):
            if best[0] < merit or rounded:
                break
            best = _tried(wanted, at, linear, trials[0] / 2**k, patience)
        if best[0] < merit:
            merit, at, pieces = best
        else:
            if merit <= CLOSED and shortest <= LOOSE:
                return Corrected(at, pieces, linear, merit, count)
            break
    raise ConvergenceError(
        f"no periodic orbit was found near the guess: after {count} Newton steps the ends are "
        f"{merit:.1e} apart, in units of the motion's ranges",
        step=count,
        time=at.period,
        residual=merit,
        cause="the guess is too far from an orbit, or there is none with what is held",
    )


def _tried(
    wanted: Wanted, at: Iterate, linear: Linear, change: np.ndarray, patience: Patience
) -> tuple[float, Iterate, list[Piece]]:
    """How far apart the ends are after a correction, infinite where it cannot be run."""
    trial = moved(wanted, at, linear, change)
    if not is_finite(trial) or trial.period <= 0:
        return np.inf, at, []
    try:
        pieces = patience.run(wanted.shooting, trial)
    except ConvergenceError:
        return np.inf, at, []
    left = gaps(wanted.shooting, trial, pieces, wanted.units)
    return _merit(wanted, trial, left), trial, pieces


def _merit(wanted: Wanted, at: Iterate, left: np.ndarray) -> float:
    missing = [row.missing for row in wanted.rows(at, None)]
    size = float(np.abs(np.append(left.ravel(), missing)).max())
    return size if np.isfinite(size) else np.inf


def energy_row(
    energy: float, wanted_by: Shooting, unit: float, index: int | None, by: float
) -> Rows:
    """Rows of a held energy, measured in `unit`; `by` is the unit of the free parameter."""

    def rows(at: Iterate, linear: Linear | None) -> list[Row]:
        there = wanted_by.integrals
        missing = (energy - there.at(at.x[0], at.c)[0]) / unit
        if linear is None:
            return [Row(np.empty(0), 0.0, 0.0, missing)]
        by_x = np.zeros_like(linear.by_period)
        by_x[0] = there.gradients(at.x[0], at.c)[0] @ linear.frames[0].into / unit
        by_c = 0.0 if index is None else there.by_parameters(at.x[0], at.c)[0, index]
        return [Row(by_x, 0.0, by_c * by / unit, missing)]

    return rows


def period_row(period: float, unit: float) -> Rows:
    """Rows of a held period."""

    def rows(at: Iterate, linear: Linear | None) -> list[Row]:
        shape = (0,) if linear is None else linear.by_period.shape
        return [Row(np.zeros(shape), 1.0, 0.0, (period - at.period) / unit)]

    return rows


def no_row(at: Iterate, linear: Linear | None) -> list[Row]:
    """Nothing is held: the orbit nearest to the guess."""
    return []

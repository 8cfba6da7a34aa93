"""Profile likelihood: how well the data are fitted when one unknown is given and the others are
free.

χ²_p(x) = min over all with θ_i = x; the interval is where χ²_p − χ² ≤ z² (Venzon & Moolgavkar,
Applied Statistics 37 (1988) 87). It follows bent valleys where the linearised interval does not.
"""

from __future__ import annotations

from dataclasses import dataclass
from statistics import NormalDist
from typing import TYPE_CHECKING

import numpy as np

from varint.errors import ConvergenceError, SolverError
from varint.estimation.search import Minimum, bounds, fitted, sizes

if TYPE_CHECKING:
    from matplotlib.figure import Figure

CLOSE = 2e-5  # of the level of √Δχ²: the ends of intervals
SOLVES = 25  # to find one end
FARTHER = 2.5  # times as far at most as the last point: curves bend
HELD = 0.01  # of its size: the first step of an unknown that a bound holds
WIDEST = 100.0  # times the linearised interval: no end is looked for beyond
EDGE = 0.01  # of a bracket: the next point is no nearer to its ends
HALVINGS = 6  # of a step of the walk where the fit beyond does not converge
SHOWN = (0.2, 0.4, 0.6, 0.8)  # of an interval's half: where the curve is filled in
BETTER = 1e-6  # of χ²: by so much less is another minimum


@dataclass(frozen=True, eq=False, repr=False)
class Profile:
    """The profile likelihood of one unknown.

    Attributes
    ----------
    name : str
    level : float
        Of the interval.
    interval : tuple of float
        (lower, upper); infinite where the data do not end it, the bound where one does.
    linear : tuple of float
        The interval of the linearised problem.
    estimate : float
    values : ndarray (K,)
        Of the unknown, in order.
    chi_squared : ndarray (K,)
        χ²_p − χ² there.
    estimates : ndarray (K, k)
        Of all unknowns with names there.
    """

    name: str
    level: float
    interval: tuple[float, float]
    linear: tuple[float, float]
    estimate: float
    values: np.ndarray
    chi_squared: np.ndarray
    estimates: np.ndarray

    def __repr__(self) -> str:
        low, high = self.interval
        return (
            f"Profile({self.name}={self.estimate:.6g}, {100 * self.level:g} %: {low:.6g} … "
            f"{high:.6g})"
        )

    def plot(self) -> Figure:
        """Figure of χ²_p − χ² with the interval, beside the parabola of the linearised problem."""
        from varint.drawing.fit_figures import profile_figure

        return profile_figure(
            self.name,
            self.level,
            self.values,
            self.chi_squared,
            self.estimate,
            self.interval,
            self.linear,
        )


Known = dict[float, tuple[float, np.ndarray]]  # value → √Δχ², the other unknowns there


def profile(minimum: Minimum, i: int, sigma: float, level: float) -> Profile:
    """The profile of the unknown i, whose linearised spread is sigma."""
    p, z = minimum.shoot.problem, minimum.solved.z
    sigma = sigma or HELD * float(sizes(p, z)[i])
    centre, wide = float(z[i]), NormalDist().inv_cdf((1 + level) / 2)
    known: Known = {centre: (0.0, z)}
    low, high = (float(x[i]) for x in bounds(p))
    ends = (
        _end(minimum, i, known, -1, wide, sigma, low),
        _end(minimum, i, known, 1, wide, sigma, high),
    )
    for end in ends:
        reach = end if np.isfinite(end) else max(known, key=lambda x: abs(x - centre))
        for part in SHOWN:
            _fit_at(minimum, i, known, centre + part * (reach - centre))
    values = np.array(sorted(known))
    return Profile(
        p.names[i],
        level,
        ends,
        (centre - wide * sigma, centre + wide * sigma),
        centre,
        values,
        np.array([known[x][0] ** 2 for x in values]),
        np.array([known[x][1][: p.many] for x in values]),
    )


def _fit_at(minimum: Minimum, i: int, known: Known, x: float) -> float | None:
    """√Δχ² with the unknown i at x, from the nearest fit that is known; None where there is none.

    Raises
    ------
    SolverError
        If it is smaller than at the estimate.
    """
    near = min(known, key=lambda y: abs(y - x))
    if near == x:
        return known[x][0]
    lower, upper = (y.copy() for y in bounds(minimum.shoot.problem))
    lower[i] = upper[i] = x
    try:
        found = fitted(minimum.shoot, _ahead(known, near, x, i), lower, upper, minimum.huber)
    except ConvergenceError:
        return None
    if not found.solved.converged:
        return None
    more = found.chi_squared - minimum.chi_squared
    if more < -BETTER * max(minimum.chi_squared, 1.0):
        name = minimum.shoot.problem.names[i]
        raise SolverError(
            f"the data are fitted better with {name} = {x:.6g} (χ² {found.chi_squared:.6g}, not "
            f"{minimum.chi_squared:.6g}): the fit ended in another minimum; start it there",
            status="not the minimum",
        )
    known[x] = float(np.sqrt(max(more, 0.0))), found.solved.z
    return known[x][0]


def _ahead(known: Known, near: float, x: float, i: int) -> np.ndarray:
    """The unknowns at x, by the line through the two nearest fits."""
    z = known[near][1]
    others = [y for y in known if y != near]
    if others:
        second = min(others, key=lambda y: abs(y - x))
        z = z + (x - near) / (near - second) * (z - known[second][1])
    z = z.copy()
    z[i] = x
    return z


def _end(
    minimum: Minimum, i: int, known: Known, side: int, wide: float, sigma: float, bound: float
) -> float:
    """Where √Δχ² reaches `wide` on one side, by the secant rule within a bracket; the bound where
    that comes before, infinity where it is not reached.
    """
    centre = float(minimum.solved.z[i])
    room, linear = abs(bound - centre), wide * sigma
    farthest = min(WIDEST * linear, room)
    beyond = bound if farthest == room else side * np.inf
    before, inner, outer, step = (0.0, 0.0), (0.0, 0.0), None, min(linear, farthest)
    failed = 0
    for _ in range(SOLVES):
        if step == 0 or failed > HALVINGS:
            return beyond
        value = _fit_at(minimum, i, known, centre + side * step)
        if value is None:
            failed, step = failed + 1, (inner[0] + step) / 2
            continue
        if abs(value - wide) <= CLOSE * wide:
            break
        if value > wide:
            outer = step, value
        elif step == farthest:
            return beyond
        else:
            before, inner = inner, (step, value)
        step = min(_next(before, inner, outer, wide), farthest)
    return centre + side * step


def _next(
    before: tuple[float, float],
    inner: tuple[float, float],
    outer: tuple[float, float] | None,
    wide: float,
) -> float:
    """Where the line through both ends of the bracket, or the last two points within, reaches
    `wide`.
    """
    (a, fa), farther = inner, FARTHER * inner[0]
    if outer is None:
        rise = (fa - before[1]) / (a - before[0])
        return a + min((wide - fa) / rise, farther - a) if rise > 0 else farther
    b, fb = outer
    return a + min(max((wide - fa) / (fb - fa), EDGE), 1 - EDGE) * (b - a)

"""Special orbits of a family, and the first orbits of the families that branch off."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from varint.errors import InputError
from varint.orbits.continuation import (
    arclength_row,
    corrected,
    held_rows,
    linear_of,
    null_directions,
    together,
)
from varint.orbits.correct import driven_period
from varint.orbits.curve import Curve, Direction, Measures, measures, product, scaled
from varint.orbits.orbit import Orbit
from varint.orbits.shooting import Iterate
from varint.scene.inputs import number

SIZE = 0.02  # of the orbit's ranges: how far along a branch its first orbit lies
CROSSES = (
    1e-6  # of the largest singular value: a second null vector, of a branch as well as located
)
DOUBLING, BRANCH, COLLISION = "period doubling", "branch point", "collision of multipliers"
INTEGRAL = "fold in an integral"


@dataclass(frozen=True, eq=False, repr=False)
class Bifurcation:
    """A special orbit of a family.

    Attributes
    ----------
    kind : str
        ``"fold in energy"`` (or in what is varied), ``"branch point"`` (a multiplier passes 1: a
        symmetry breaks, families cross), ``"period doubling"`` (one passes −1), ``"collision of
        multipliers"`` (two pairs meet and leave the unit circle or the real axis, or come back),
        ``"fold in an integral"`` (one passes 1 though no other orbit that closes is near: a
        momentum is stationary along orbits that turn, which close in a frame that turns with them,
        or the energy along those with other periods). Pairs that pass ±1 and stay on the circle,
        as symmetries make them, count, too.
    orbit : Orbit
        There.
    value : float
        Of the energy, period or parameter.
    tangent : Direction
        Of the family.
    curve : Curve
    """

    kind: str
    orbit: Orbit
    value: float
    tangent: Direction
    curve: Curve

    def __repr__(self) -> str:
        return (
            f"Bifurcation({self.kind}: {self.curve.along}={self.value:.10g}, "
            f"period={self.orbit.period:.10g})"
        )

    def branch(self, size: float = SIZE, sign: int = 1) -> Orbit:
        """The first orbit of the family that branches off, along the second null vector of the
        orbit's equations; of a period doubling it takes two laps.

        Parameters
        ----------
        size : float
            Distance from here, in ranges of the orbit.
        sign : {1, −1}
            To which side; both may be mirror images.

        Raises
        ------
        InputError
            If nothing branches off here.
        ConvergenceError
            If no orbit is found at that distance: try another.
        """
        if self.kind not in (DOUBLING, BRANCH):
            why = "; see corotating for orbits that turn" if self.kind == INTEGRAL else ""
            raise InputError(f"nothing branches off at a {self.kind}{why}")
        length, laps = number("size", size), 2 if self.kind == DOUBLING else 1
        base = repeated(self.orbit, laps)
        by = measures(base, self.curve)
        curve = self.curve
        if curve.hold == "period":
            curve = replace(curve, value=curve.value * laps)
        along = Direction(
            np.tile(self.tangent.x, (laps, 1)), laps * self.tangent.period, self.tangent.parameter
        )
        across = _across(base, along, curve, by)
        start = base.at
        x = start.x + sign * length * across.x
        c, period = start.c.copy(), start.period + sign * length * across.period
        if curve.index is not None:
            c[curve.index] += sign * length * across.parameter
            period = driven_period(period, start.c, c, curve.index, curve.drive)
        trial = Iterate(x, period, c)
        rows = together(
            arclength_row(start, across, sign * length, curve, by),
            held_rows(curve, base.shooting, by),
        )
        return corrected(base.shooting, trial, rows, curve, by)


def _across(base: Orbit, along: Direction, curve: Curve, by: Measures) -> Direction:
    """The null vector across the family, of length one."""
    linear = linear_of(base, curve)
    two = null_directions(base.shooting, base.at, linear, curve, by, least=2)[-2:]
    a, b = (product(one, along, by) for one in two)
    x = b * two[0].x - a * two[1].x
    found = Direction(
        x,
        b * two[0].period - a * two[1].period,
        b * two[0].parameter - a * two[1].parameter,
    )
    return scaled(found, 1 / np.sqrt(product(found, found, by)))


def repeated(orbit: Orbit, laps: int) -> Orbit:
    """The same orbit, run through several times."""
    if laps == 1:
        return orbit
    s, n = orbit.shooting, len(orbit.shooting.shift)
    x = np.concatenate([orbit.at.x] * laps)
    for lap in range(laps):
        x[lap * s.segments : (lap + 1) * s.segments, :n] += lap * s.shift
    parts = None if s.parts is None else np.tile(s.parts, laps) / laps
    shooting = replace(s, segments=laps * s.segments, shift=laps * s.shift, parts=parts)
    at = orbit.at._replace(x=x, period=laps * orbit.period)
    return replace(orbit, shooting=shooting, at=at)

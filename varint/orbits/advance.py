"""From an orbit of a family to the next: the length of the step, its finer steps, its segments."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from varint.errors import ConvergenceError
from varint.orbits.continuation import (
    PATIENT,
    at_value,
    hasty,
    quantity,
    remeshed,
    same_way,
    stepped,
)
from varint.orbits.correct import Patience
from varint.orbits.curve import Curve, change, product, scaled
from varint.orbits.guess import MODERATE, PIECES
from varint.orbits.mesh import EACH
from varint.orbits.orbit import Orbit
from varint.orbits.passages import Point, passing, point_of
from varint.orbits.predict import ahead, on_cubic
from varint.orbits.shooting import Iterate

FIRST, SHORTEST = 0.03, 1e-7  # arclengths of steps, in ranges of the orbit
LONGER, SHORTER = 1.5, 0.5
QUICK = 5  # Newton steps: then the next step may be longer
BENT = 0.97  # cosine of the angle between tangents: a step round a sharper bend is too long
LOOSE = 2e-14  # in ranges: errors of the steps at which they are made shorter
ROUNDED = 1e-13  # in ranges: errors that may be round-off
FINER, MOST_FINER = 1.1, 4.0  # times the steps: beyond what is needed, and at once
FAST = 0.3  # of all that (1 ∓ ν)/2 can change by: more may hide two bifurcations
MESHED = 1e-14  # in sizes of the coordinates: errors of the steps of new segments
OUTGROWN = 1.6  # times the steps of a segment: then segments are made anew
CLOSEST = 1e-6  # of a step: brackets of a value in it
HALVED = 0.5  # of the error before: what shorter steps must bring, or it is round-off


def next_point(
    here: Point, before: Point | None, step: float, curve: Curve
) -> tuple[Point, float, float] | None:
    """The next point, the arclength to it, and the next step; None where every step fails."""
    made = _by(hasty(here.orbit.shooting), here, before, step, curve)
    return _by(PATIENT, here, None, step, curve) if made is None else made


def _by(
    patience: Patience, here: Point, before: Point | None, step: float, curve: Curve
) -> tuple[Point, float, float] | None:
    """The next point with so much patience for one step."""
    base, last, near = here.orbit, np.inf, _predicted(here, before, step, curve)
    coarser: Point | None = None
    while step >= SHORTEST:
        try:
            orbit = stepped(base, here.tangent, step, curve, here.by, near, patience)
            point = point_of(orbit, curve, here.tangent, 1.0)
        except (ConvergenceError, np.linalg.LinAlgError):
            step, coarser = SHORTER * step, None
            near = _predicted(here, before, step, curve)
            continue
        size = np.sqrt(product(point.tangent, point.tangent, here.by))
        straight = product(scaled(point.tangent, 1 / size), here.tangent, here.by)
        leap = max((abs(x - here.tests[name]) for name, x in passing(point)), default=0.0)
        if (straight < BENT or leap > FAST) and step > FIRST / 30:
            step, coarser = SHORTER * step, None
            near = _predicted(here, before, step, curve)
            continue
        # a gap that no correction closes is one of the steps, too, as where a perihelion turns
        error, finest = max(orbit.error_estimate, orbit.residual), max(1.0, farness(orbit))
        if coarser is not None and error > HALVED * last:
            if last <= ROUNDED * finest:
                point = coarser  # more steps do not help
        elif error > LOOSE * finest:
            wanted = (error / (LOOSE * finest)) ** (1 / orbit.rule.order)
            each = int(np.ceil(min(FINER * wanted, MOST_FINER) * base.shooting.each))
            base = replace(base, shooting=replace(base.shooting, each=each))
            last, near, coarser = error, orbit.at, point
            continue
        return point, step, step * (LONGER if point.orbit.iterations <= QUICK else 1.0)
    return None


def farness(orbit: Orbit) -> float:
    """How many times their ranges coordinates and momenta are: so much larger is round-off, in
    ranges, of a small orbit far from the origin.
    """
    return float((np.abs(orbit.at.x) / orbit.units.scale).max())


def _predicted(here: Point, before: Point | None, step: float, curve: Curve) -> Iterate | None:
    """Where the orbit of a step is looked for, if not along the tangent."""
    if before is None or not (here.alone and before.alone):
        return None
    return on_cubic(here.orbit, here.tangent, (before.orbit, before.tangent), step, curve, here.by)


def in_new_segments(here: Point, curve: Curve) -> Point:
    """The point in segments that are made for its orbit, where that saves most of its steps."""
    orbit = here.orbit
    fit = orbit.shooting.parts is not None and orbit.shooting.each <= OUTGROWN * EACH
    if orbit.steps <= PIECES * MODERATE or fit:
        return here
    try:
        made = remeshed(orbit, curve, MESHED)
    except ConvergenceError:
        return here
    if made is None:
        return here
    found = point_of(made, curve, None, 1.0)
    return found._replace(tangent=same_way(found.tangent, here.tangent, found.by))


def exactly(
    here: Point, beyond: Point, length: float, to: float, curve: Curve
) -> tuple[Point, float]:
    """The point at which the quantity has its last value, and the arclength to it."""
    try:
        return _between(hasty(here.orbit.shooting), here, beyond, length, to, curve)
    except ConvergenceError:
        return _between(PATIENT, here, beyond, length, to, curve)


def _between(
    patience: Patience, here: Point, beyond: Point, length: float, to: float, curve: Curve
) -> tuple[Point, float]:
    """The same with so much patience for each trial."""
    low, high = (0.0, quantity(here.orbit, curve)), (length, quantity(beyond.orbit, curve))
    orbit = replace(here.orbit, shooting=beyond.orbit.shooting)
    ends = beyond.orbit, beyond.tangent

    def guess(at: float) -> Iterate:
        found = on_cubic(orbit, here.tangent, ends, at, curve, here.by)
        return ahead(orbit, here.tangent, at, curve) if found is None else found

    while True:
        part = 1.0 if low[1] == high[1] else (to - low[1]) / (high[1] - low[1])
        try:
            made = at_value(
                orbit, guess(low[0] + part * (high[0] - low[0])), to, curve, here.by, patience
            )
            break
        except ConvergenceError:
            if high[0] - low[0] < CLOSEST * length:
                raise
        # the quantity bends: where it is halfway is always found, for shorter steps than this are
        at = (low[0] + high[0]) / 2
        middle = (
            at,
            quantity(stepped(orbit, here.tangent, at, curve, here.by, guess(at), patience), curve),
        )
        low, high = (middle, high) if (middle[1] - to) * (low[1] - to) > 0 else (low, middle)
    moved = change(made.at, here.orbit.at, curve)
    return point_of(made, curve, here.tangent, 1.0), product(moved, here.tangent, here.by)

"""Where the next orbit of a family is looked for."""

from __future__ import annotations

import numpy as np

from varint.orbits.correct import driven_period
from varint.orbits.curve import Curve, Direction, Measures, change, product
from varint.orbits.guess import kept
from varint.orbits.orbit import Orbit
from varint.orbits.phase import independent
from varint.orbits.shooting import Iterate

TURNED = 0.5  # cosine of the angle between tangents: what turns more is no cubic's business


def ahead(orbit: Orbit, tangent: Direction, length: float, curve: Curve) -> Iterate:
    """A step along the tangent."""
    return _moved(
        orbit,
        length * tangent.x,
        length * tangent.period,
        length * tangent.parameter,
        curve,
    )


def on_cubic(
    orbit: Orbit,
    tangent: Direction,
    other: tuple[Orbit, Direction],
    length: float,
    curve: Curve,
    by: Measures,
) -> Iterate | None:
    """A step on the cubic through two orbits along their tangents, by the arclength ⟨tangent,
    orbit − first orbit⟩ of the first; None where they are in different segments, or the family
    turns between them.

    What of it goes along the flow and the symmetries is left out, as Newton's corrections leave it:
    where an orbit begins on its curve would be extrapolated else, and that is not stable.
    """
    there, slope = other
    a, b = orbit.shooting, there.shooting
    if a.segments != b.segments or (a.beginnings != b.beginnings).any():
        return None
    away = change(there.at, orbit.at, curve)
    s, rate = product(tangent, away, by), product(tangent, slope, by)
    if not s * rate or rate < TURNED * np.sqrt(product(slope, slope, by)):
        return None
    z = length / s
    # Hermite's polynomials of z: 1 at the other orbit, and slopes of 1 at the first and the other
    value, near, far = z**2 * (3 - 2 * z), z * (1 - z) ** 2, z**2 * (z - 1)
    near, far = s * near, s * far / rate

    def part(x: Direction) -> np.ndarray:
        return np.concatenate([x.x.ravel(), [x.period, x.parameter]])

    whole = value * part(away) + near * part(tangent) + far * part(slope)
    x = across(orbit, whole[:-2].reshape(orbit.at.x.shape))
    return _moved(orbit, x, whole[-2], whole[-1], curve)


def across(orbit: Orbit, x: np.ndarray) -> np.ndarray:
    """Changes of the states at all beginnings without their parts along the flow and the
    symmetries.
    """
    linear = orbit.linear
    m, k, d = linear.phases.shape
    along = independent(linear.phases.transpose(1, 0, 2).reshape(k, m * d))
    xi = np.concatenate([f.onto @ y for f, y in zip(linear.frames, x, strict=True)])
    kept = (xi - along.T @ (along @ xi)).reshape(m, d)
    return np.array([f.into @ y for f, y in zip(linear.frames, kept, strict=True)])


def _moved(orbit: Orbit, x: np.ndarray, period: float, parameter: float, curve: Curve) -> Iterate:
    """The orbit, changed; the period of a driven scene goes with the parameter alone."""
    c, period = orbit.at.c.copy(), orbit.period + period * (not curve.drive)
    if curve.index is not None:
        c[curve.index] += parameter
        period = driven_period(period, orbit.at.c, c, curve.index, curve.drive)
    return Iterate(kept(orbit.shooting, orbit.at.x + x, period, c), period, c)

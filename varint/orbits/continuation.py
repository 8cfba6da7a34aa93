"""Along a curve of orbits: its tangent, and steps."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from varint.orbits.chain import condensed
from varint.orbits.correct import (
    HALVINGS,
    Patience,
    Row,
    Rows,
    Wanted,
    bordered,
    correct,
    energy_row,
    no_row,
    period_row,
)
from varint.orbits.curve import Curve, Direction, Measures, change, measures, product, scaled
from varint.orbits.guess import kept
from varint.orbits.mesh import EACH, WORTH, meshed, uneven
from varint.orbits.orbit import Orbit
from varint.orbits.periodic import orbit_of
from varint.orbits.phase import units_of
from varint.orbits.predict import ahead
from varint.orbits.shooting import Iterate, Linear, Shooting, linearise, run_for_trials, runs

NULL = 1e-11  # of the largest singular value: further null vectors, at a branch point
NEWTON_STEPS = 8  # of a continuation step: more mean that it was too long
CONTRACTS = 0.5  # of Newton's corrections: more mean so after two (Deuflhard, Newton Methods, 5.1)
PATIENT = Patience(NEWTON_STEPS, HALVINGS, np.inf, runs)


def hasty(shooting: Shooting) -> Patience:
    """For steps that are made shorter where Newton's method does not converge at once."""
    return Patience(NEWTON_STEPS, 1, CONTRACTS, run_for_trials(shooting))


def linear_of(orbit: Orbit, curve: Curve) -> Linear:
    """The segments' maps with their derivatives by the parameter that is varied."""
    if curve.index is None or orbit.linear.parameter == curve.index:
        return orbit.linear
    s = orbit.shooting
    found = linearise(s, orbit.at, runs(s, orbit.at), orbit.units, curve.index)
    orbit.__dict__["linear"] = found  # what it has of the orbit alone is the same
    return found


def quantity(orbit: Orbit, curve: Curve) -> float:
    """The value along the curve."""
    if curve.along == "energy":
        return orbit.energy
    if curve.along == "period":
        return orbit.period
    assert curve.index is not None
    return float(orbit.at.c[curve.index])


def held_rows(curve: Curve, shooting: Shooting, by: Measures) -> Rows | None:
    """What is held besides, where a parameter is varied."""
    if curve.hold == "energy":
        unit = by.units.action / by.period
        return energy_row(curve.value, shooting, unit, curve.index, by.parameter)
    return period_row(curve.value, by.period) if curve.hold == "period" else None


def value_rows(curve: Curve, value: float, shooting: Shooting, by: Measures) -> Rows:
    """The quantity itself has a value."""
    if curve.along == "energy":
        return energy_row(value, shooting, by.units.action / by.period, curve.index, by.parameter)
    if curve.along == "period":
        return period_row(value, by.period)

    def rows(at: Iterate, linear: Linear | None) -> list[Row]:
        assert curve.index is not None
        shape = (0,) if linear is None else linear.by_period.shape
        missing = (value - float(at.c[curve.index])) / by.parameter
        return [Row(np.zeros(shape), 0.0, 1.0, missing)]

    return rows


def arclength_row(
    base: Iterate, tangent: Direction, length: float, curve: Curve, by: Measures
) -> Rows:
    """⟨tangent, orbit − base⟩ = length (Keller)."""

    def rows(at: Iterate, linear: Linear | None) -> list[Row]:
        missing = length - product(tangent, change(at, base, curve), by)
        if linear is None:
            return [Row(np.empty(0), 0.0, 0.0, missing)]
        parts = zip(tangent.x / by.units.scale**2 / len(tangent.x), linear.frames, strict=True)
        by_x = np.array([x @ frame.into for x, frame in parts])
        free = curve.index is not None
        by_c = free * tangent.parameter / by.parameter
        return [Row(by_x, tangent.period / by.period, by_c, missing)]

    return rows


def together(first: Rows, second: Rows | None) -> Rows:
    """Rows of both."""
    if second is None:
        return first
    return lambda at, linear: [*first(at, linear), *second(at, linear)]


def null_directions(
    shooting: Shooting,
    at: Iterate,
    linear: Linear,
    curve: Curve,
    by: Measures,
    least: int = 1,
    small: float = NULL,
) -> list[Direction]:
    """Null vectors of the equations of an orbit, those whose singular values are `small` beside the
    largest, `least` of them at least: tangents of the curves through it.
    """
    rows = held_rows(curve, shooting, by)
    wanted = Wanted(
        shooting,
        by.units,
        by.period,
        by.parameter,
        curve.index,
        rows or (lambda a, b: []),
        curve.drive,
    )
    links = bordered(wanted, at, linear)
    m, d, border = links.aside.shape
    used = np.ones(border, dtype=bool)
    used[:2] = shooting.autonomous, curve.index is not None
    chain = condensed(links._replace(aside=links.aside[:, :, used], corner=links.corner[:, used]))
    values = chain.parts[1]
    surplus = chain.matrix.shape[1] - len(values)
    many = max(surplus + int((values <= small * values[0]).sum()), least)
    found = []
    for row in chain.null(many):
        y = np.zeros(border)
        y[used] = row[m * d :]
        xi = row[: m * d].reshape(m, d)
        x = np.array([f.into @ u for f, u in zip(linear.frames, xi, strict=True)])
        found.append(Direction(x, y[0] * by.period, y[1] * by.parameter))
    return found


def slope_of(
    curve: Curve, shooting: Shooting, at: Iterate, linear: Linear, direction: Direction
) -> float:
    """How the quantity changes along a direction."""
    if curve.along == "period":
        return direction.period
    if curve.along != "energy":
        return direction.parameter
    by_x = shooting.integrals.gradients(at.x[0], at.c)[0] @ direction.x[0]
    return float(by_x)


def tangent_near(
    several: list[Direction],
    shooting: Shooting,
    at: Iterate,
    linear: Linear,
    curve: Curve,
    by: Measures,
    before: Direction | None,
    sign: float,
) -> Direction:
    """The unit tangent, of several null directions, that goes on from the one before; at the first
    orbit, where the quantity goes the way of `sign`.
    """
    if before is None:
        weights = [slope_of(curve, shooting, at, linear, one) for one in several]
        if not any(weights):
            weights = [0.0] * (len(several) - 1) + [1.0]
    else:
        weights = [product(one, before, by) for one in several]
    x = sum(w * one.x for w, one in zip(weights, several, strict=True))
    period = sum(w * one.period for w, one in zip(weights, several, strict=True))
    parameter = sum(w * one.parameter for w, one in zip(weights, several, strict=True))
    found = Direction(np.asarray(x), float(period), float(parameter))
    length = np.sqrt(product(found, found, by))
    if length == 0:
        found = several[-1]
        length = np.sqrt(product(found, found, by))
    if before is None:
        ahead = slope_of(curve, shooting, at, linear, found)
        length = length * (sign if ahead >= 0 else -sign)
    return scaled(found, 1 / float(length))


def stepped(
    orbit: Orbit,
    tangent: Direction,
    length: float,
    curve: Curve,
    by: Measures,
    near: Iterate | None = None,
    patience: Patience = PATIENT,
) -> Orbit:
    """The orbit at an arclength from another, from a step along the tangent or from `near`.

    Raises
    ------
    ConvergenceError
        If the corrections do not come to one.
    """
    shooting = orbit.shooting
    start = ahead(orbit, tangent, length, curve) if near is None else near
    rows = together(
        arclength_row(orbit.at, tangent, length, curve, by), held_rows(curve, shooting, by)
    )
    return corrected(shooting, start, rows, curve, by, patience)


def at_value(
    orbit: Orbit,
    start: Iterate,
    value: float,
    curve: Curve,
    by: Measures,
    patience: Patience = PATIENT,
) -> Orbit:
    """The orbit with a value of the quantity, near a start."""
    rows = together(
        value_rows(curve, value, orbit.shooting, by), held_rows(curve, orbit.shooting, by)
    )
    return corrected(orbit.shooting, start, rows, curve, by, patience)


def corrected(
    shooting: Shooting,
    start: Iterate,
    rows: Rows,
    curve: Curve,
    by: Measures,
    patience: Patience = PATIENT,
) -> Orbit:
    """The orbit that fulfils the rows, near a start, in units of its own motion."""
    wanted = Wanted(shooting, by.units, by.period, by.parameter, curve.index, rows, curve.drive)
    found = correct(wanted, start, patience)
    units = units_of(np.concatenate([piece.x for piece in found.pieces]))
    orbit = replace(orbit_of(wanted, found), units=units)
    orbit.__dict__["linear"] = linearise(shooting, orbit.at, found.pieces, units, curve.index)
    return orbit


def remeshed(orbit: Orbit, curve: Curve, tol: float) -> Orbit | None:
    """The same orbit in uneven segments made for it; None where they bring nothing."""
    begin, period = orbit.shooting.beginnings, orbit.period
    places = {float(part): i for i, part in enumerate(begin)}

    def known(part: float) -> np.ndarray | None:
        i = places.get(part)
        return None if i is None else orbit.at.x[i]

    mesh = uneven(orbit.shooting, orbit.at, known, tol, run_for_trials(orbit.shooting))
    if mesh is None or len(mesh.parts) * EACH > WORTH * orbit.steps:
        return None
    shooting, by = meshed(orbit.shooting, mesh), measures(orbit, curve)
    start = Iterate(kept(shooting, mesh.x, period, orbit.at.c), period, orbit.at.c)
    rows = held_rows(curve, shooting, by)
    return corrected(shooting, start, no_row if rows is None else rows, curve, by)


def same_way(new: Direction, old: Direction, by: Measures) -> Direction:
    """A tangent of an orbit in other segments, turned the way of the one before."""
    # the first state, the period and the parameter are what all segmentations have
    first = [one._replace(x=one.x[:1]) for one in (new, old)]
    return new if product(first[0], first[1], by) >= 0 else scaled(new, -1.0)

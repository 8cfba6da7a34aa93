"""Where families fold, branch and change their stability: found by sign changes, located on the
curve.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from varint.errors import ConvergenceError
from varint.orbits.bifurcations import BRANCH, COLLISION, CROSSES, DOUBLING, INTEGRAL, Bifurcation
from varint.orbits.continuation import (
    linear_of,
    null_directions,
    quantity,
    slope_of,
    stepped,
    tangent_near,
)
from varint.orbits.curve import Curve, Direction, Measures, measures
from varint.orbits.multipliers import ON_CIRCLE, ROUNDED
from varint.orbits.orbit import Orbit
from varint.orbits.predict import on_cubic
from varint.orbits.reduction import reduce

MOST_STEPS = 40  # of locating one
LOCATED = 1e-9  # of the step in which it lies
TOGETHER = 1e-3  # of the step: a fold and the multiplier 1 that it makes
PASSES = 1e-6  # of the energy at the ends: one that is smaller is zero
BEHIND, NEAREST = "energies below zero", "energy next to zero"  # of Ω(Φ − Φ⁻¹), not located alone


class Point(NamedTuple):
    """An orbit on its curve, the tangent there, what changes sign where something happens, and
    whether there is no other curve through it.
    """

    orbit: Orbit
    tangent: Direction
    by: Measures
    tests: dict[str, float]
    alone: bool


def tests_of(orbit: Orbit, tangent: Direction, curve: Curve) -> dict[str, float]:
    """What changes sign: the slope of the quantity (and of the energy) along the family, det(Φ ∓ 1)
    across the integrals, and how many multipliers have left the circle and the real axis.

    Where a symmetry keeps a pair on the circle as it passes ±1, det(Φ ∓ 1) touches zero and goes
    back; two eigenvalues of the symmetric matrix Ω(Φ − Φ⁻¹) = ΩΦ + (ΩΦ)ᵀ change their sign there,
    one where a pair leaves the circle, none where two pairs meet.
    """
    s, at, linear = orbit.shooting, orbit.at, orbit.linear
    found = {f"fold in {curve.along}": slope_of(curve, s, at, linear, tangent)}
    if s.integrals.energy and curve.index is None:
        by_energy = replace(curve, along="energy")
        found["fold in energy"] = slope_of(by_energy, s, at, linear, tangent)
    reduced = reduce(linear.monodromy, linear.frames[0].form, linear.gradients, linear.phases[0])
    values = np.linalg.eigvals(reduced.matrix)
    if len(values):
        size = np.prod(1 + np.abs(values))
        found[BRANCH] = float((np.prod(values - 1) / size).real)
        found[DOUBLING] = float((np.prod(values + 1) / size).real)
        width = max(ON_CIRCLE, ROUNDED * float(np.linalg.norm(reduced.matrix)))
        off = (np.abs(np.abs(values) - 1) > width**0.5) & (np.abs(values.imag) > width**0.5)
        found[COLLISION] = 0.5 - float(off.any())
        if orbit.floquet.symplectic:
            turned = reduced.form @ reduced.matrix
            energies = np.linalg.eigvalsh(turned + turned.T)
            found[BEHIND] = float((energies < 0).sum())
            found[NEAREST] = float(np.abs(energies).min())
    return found


def point_of(orbit: Orbit, curve: Curve, before: Direction | None, sign: float) -> Point:
    """The orbit with its tangent and tests."""
    by, linear = measures(orbit, curve), linear_of(orbit, curve)
    several = null_directions(orbit.shooting, orbit.at, linear, curve, by)
    tangent = tangent_near(several, orbit.shooting, orbit.at, linear, curve, by, before, sign)
    return Point(orbit, tangent, by, tests_of(orbit, tangent, curve), len(several) == 1)


def passing(point: Point) -> list[tuple[str, float]]:
    """The tests of multipliers that pass ±1."""
    return [(name, x) for name, x in point.tests.items() if name in (BRANCH, DOUBLING)]


def located(a: Point, b: Point, length: float, curve: Curve) -> list[Bifurcation]:
    """What happens between two orbits of a family, in order."""
    changed = [name for name, x in a.tests.items() if x * b.tests.get(name, x) < 0]
    found: list[tuple[float, str, Point]] = []
    for name in changed:
        where = _root(a, b, length, curve, name)
        if where is not None:
            found.append((*where[:1], name, where[1]))
    behind = [point.tests.get(BEHIND, 0.0) for point in (a, b)]
    if abs(behind[1] - behind[0]) >= 2 and not {BRANCH, DOUBLING} & set(changed):
        level = sum(behind) / 2
        where = _root(a, b, length, curve, BEHIND, level)
        if where is not None and _apart(where[1], (a, b), level):
            at, between = where
            return located(a, between, at, curve) + located(between, b, length - at, curve)
        if where is not None:
            tests = where[1].tests
            name = BRANCH if abs(tests[BRANCH]) < abs(tests[DOUBLING]) else DOUBLING
            found.append((*where[:1], name, where[1]))
    folds = [at for at, name, _ in found if name in ("fold in energy", f"fold in {curve.along}")]
    kept = [
        (at, name, point)
        for at, name, point in found
        if name != BRANCH or all(abs(at - x) > TOGETHER * length for x in folds)
    ]
    kept.sort(key=lambda x: x[0])
    return [
        Bifurcation(_kind(name, p, curve), p.orbit, quantity(p.orbit, curve), p.tangent, curve)
        for _, name, p in kept
    ]


def _kind(name: str, point: Point, curve: Curve) -> str:
    """A branch point has a second null vector: where a multiplier passes 1 without one, the motions
    near that it stands for do not close.
    """
    if name != BRANCH:
        return name
    s, linear = point.orbit.shooting, linear_of(point.orbit, curve)
    several = null_directions(s, point.orbit.at, linear, curve, point.by, small=CROSSES)
    return BRANCH if len(several) > 1 else INTEGRAL


def _apart(between: Point, ends: tuple[Point, Point], level: float) -> bool:
    """Whether an orbit lies between two where multipliers pass, not where they do together."""
    far = max(point.tests[NEAREST] for point in ends)
    return between.tests[BEHIND] == level and between.tests[NEAREST] > PASSES * far


def _signed(tests: dict[str, float], name: str, level: float) -> float:
    """A test; of a count, the energy next to zero with the sign that the count has to `level`."""
    return tests[name] if name != BEHIND else float(np.sign(tests[name] - level)) * tests[NEAREST]


def _root(
    a: Point, b: Point, length: float, curve: Curve, name: str, level: float = 0.0
) -> tuple[float, Point] | None:
    """Arclength at which a test vanishes (Illinois' method, and halves), and the point there."""
    low, high, ends = 0.0, length, (b.orbit, b.tangent)
    below, above = (_signed(point.tests, name, level) for point in (a, b))
    best: tuple[float, Point] | None = None
    side = 0
    for count in range(MOST_STEPS):
        slow = count % 4 == 3 or name == COLLISION
        at = (low + high) / 2 if slow else (low * above - high * below) / (above - below)
        try:
            near = on_cubic(a.orbit, a.tangent, ends, at, curve, a.by)
            orbit = stepped(a.orbit, a.tangent, at, curve, a.by, near)
        except ConvergenceError:
            return best
        point = point_of(orbit, curve, a.tangent, 1.0)
        ends = orbit, point.tangent
        best, value = (at, point), _signed(point.tests, name, level)
        if value * below > 0:
            low, below = at, value
            above = above / 2 if side == 1 else above
            side = 1
        else:
            high, above = at, value
            below = below / 2 if side == -1 else below
            side = -1
        if value == 0 or high - low <= LOCATED * length:
            break
    return best

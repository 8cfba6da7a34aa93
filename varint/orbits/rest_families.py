"""Equilibria that go on along curves and surfaces: where they lead, and which are of one family."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from varint.errors import ConvergenceError, InputError
from varint.orbits.oscillations import is_degenerate, loose_directions
from varint.orbits.rest import Equilibrium, left_at, rest

ASIDE = 1e-3  # of the coordinates, or of 1: the next one is looked for so far beside
NEAR = 0.2  # of such a step, or of a chord: an equilibrium this near goes on there
SHARES = 0.5, 0.25, 0.75  # of a chord, at which equilibria must lie beside it
NAMED = 0.1  # of the largest component of a direction
JOINED = 1e-9  # of the forces where nothing balances: those along which equilibria go on


def goes_on_along(one: Equilibrium) -> tuple[str, ...]:
    """The coordinates along which other equilibria follow; none of an isolated one, even where it
    has no stiffness, as of U = x³.
    """
    names = set[str]()
    if is_degenerate(one):
        size = max(float(np.abs(one.q).max()), 1.0)
        for direction in loose_directions(one).T:
            step = ASIDE * size * direction / np.abs(direction).max()
            if _lies_beside(one, one.q + step, NEAR * float(np.abs(step).max())):
                large = np.abs(step) > NAMED * np.abs(step).max()
                names |= {x for x, moves in zip(one.system.names, large, strict=True) if moves}
    return tuple(x for x in one.system.names if x in names)


def one_of_each(found: list[Equilibrium], places: np.ndarray) -> list[Equilibrium]:
    """Of those that go on from one to another, along a line or a curve, the best balanced; and all
    others.
    """
    loose = [one for one in found if is_degenerate(one)]
    if len(loose) < 2:
        return found
    forces = np.abs([left_at(loose[0], q) for q in places])
    size = JOINED * np.median(forces[np.isfinite(forces).all(axis=1)], axis=0)
    loose.sort(key=lambda x: float(np.abs(left_at(x, x.q)).max()))
    kept: list[Equilibrium] = []
    for one in loose:
        if not any(_on_a_line(one, other, size) for other in kept):
            kept.append(one)
    family = np.arange(len(kept))
    for i, j in _neighbours(np.array([one.q for one in kept])):
        if family[i] != family[j] and _on_a_curve(kept[i], kept[j]):
            family[family == family[j]] = family[i]
    kept = [kept[int(np.flatnonzero(family == x)[0])] for x in np.unique(family)]
    return [one for one in found if one in kept or one not in loose]


def _on_a_line(one: Equilibrium, other: Equilibrium, size: np.ndarray) -> bool:
    """Whether nothing drives anywhere on the line between them."""
    between = np.linspace(one.q, other.q, 7)
    return all(bool((np.abs(left_at(one, q)) <= size).all()) for q in between)


def _on_a_curve(one: Equilibrium, other: Equilibrium) -> bool:
    """Whether equilibria without stiffness lie beside all of the chord between them."""
    chord = other.q - one.q
    near = NEAR * float(np.abs(chord).max())
    return all(_lies_beside(one, one.q + share * chord, near) for share in SHARES)


def _lies_beside(one: Equilibrium, place: np.ndarray, near: float) -> bool:
    """Whether an equilibrium without stiffness lies that near to a place."""
    try:
        found = rest(one.system, place, one.c)
    except (ConvergenceError, InputError):
        return False
    return bool(np.abs(found.q - place).max() <= near) and is_degenerate(found)


def _neighbours(places: np.ndarray) -> Sequence[tuple[int, int]]:
    """The shortest lines that join all places (N, n) to one tree, by Prim's method."""
    apart = np.ptp(places, axis=0)
    x = places / np.where(apart > 0, apart, 1.0)
    inside, pairs = np.zeros(len(x), dtype=bool), list[tuple[int, int]]()
    inside[0], nearest = True, np.zeros(len(x), dtype=int)
    distance = np.linalg.norm(x - x[0], axis=1)
    for _ in range(len(x) - 1):
        new = int(np.where(inside, np.inf, distance).argmin())
        pairs.append((int(nearest[new]), new))
        inside[new] = True
        further = np.linalg.norm(x - x[new], axis=1)
        nearest = np.where(further < distance, new, nearest)
        distance = np.minimum(distance, further)
    return pairs

"""Pairs of bodies: what a run is to watch of them."""

from __future__ import annotations

from itertools import combinations
from typing import Any

import casadi as ca
import numpy as np

from varint.errors import InputError
from varint.orbits.bodies import body_places
from varint.scene.inputs import finite_array
from varint.scene.system import System, require_system

BETWEEN = "–"  # both names of a pair
TOGETHER = "approach "  # before them in the names of events
Pair = tuple[ca.SX, ca.SX, float]


def approaches(system: System, within: Any) -> dict[str, tuple[ca.SX, int]]:
    """What a run must log for its `encounters`: every pair of bodies coming within a distance.

    Parameters
    ----------
    system : System
        Bodies whose coordinates are called x1, y1, z1, x2, …
    within : float or array (B,)
        The distance; or a radius of each body, such as a few Hill radii a (m/3M)^{1/3}, of which
        the larger one of the two counts.

    Returns
    -------
    dict
        ``simulate(system, ..., events=vi.orbits.approaches(system, 0.1))``

    Raises
    ------
    InputError
        If the bodies are not known or the distance is not positive.

    Examples
    --------
    >>> import varint as vi
    >>> model = vi.models.pythagorean_three_body()
    >>> list(vi.orbits.approaches(model.system, 0.2))
    ['approach 1–2', 'approach 1–3', 'approach 2–3']
    """
    return {
        f"{TOGETHER}{name}": (ca.sumsqr(apart) / reach**2 - 1, -1)
        for name, (apart, _, reach) in pairs_within(system, within, max).items()
    }


def collisions(system: System, radii: Any) -> ca.SX:
    """An expression that crosses zero, falling, when two bodies touch: min (|r_i − r_j|/(R_i + R_j)
    − 1).

    Parameters
    ----------
    system : System
        As for `approaches`.
    radii : float or array (B,)
        R of all bodies or of each; 0 for points.

    Returns
    -------
    SX
        ``simulate(system, ..., until=(vi.orbits.collisions(system, radii), -1))`` stops there.

    Raises
    ------
    InputError
        If the bodies are not known, or no two radii have a positive sum.

    Examples
    --------
    >>> import casadi as ca
    >>> import varint as vi
    >>> q, v = vi.coordinates("x1", "y1", "x2", "y2")
    >>> free = vi.System(q, v, ca.sumsqr(v) / 2)
    >>> touch = vi.simulate(
    ...     free, vi.gauss(1), q0=[0, 0, 3, 0], v0=[1, 0, 0, 0], h=0.3, steps=20,
    ...     until=(vi.orbits.collisions(free, 0.5), -1),
    ... )
    >>> round(float(touch.t[-1]), 12)
    2.0
    """
    rows = [
        ca.norm_2(apart) / reach - 1
        for apart, _, reach in pairs_within(system, radii, lambda a, b: a + b).values()
    ]
    least = rows[0]
    for row in rows[1:]:
        least = ca.fmin(least, row)
    return least


def pairs_within(system: System, sizes: Any, both: Any) -> dict[str, Pair]:
    """By the names of both bodies: their difference, that of their velocities, and the size that
    counts.
    """
    require_system(system)
    places = body_places(system)
    given = finite_array("the distance", sizes)
    if given.shape not in ((), (len(places),)) or (given < 0).any():
        raise InputError(
            f"distances must be one positive number, or one for each of {list(places)}, got "
            f"{sizes!r}"
        )
    each = np.broadcast_to(given, (len(places),))
    found: dict[str, Pair] = {}
    for (i, (a, first)), (j, (b, second)) in combinations(enumerate(places.items()), 2):
        reach = float(both(each[i], each[j]))
        if reach > 0:
            apart = system.q[first.tolist()] - system.q[second.tolist()]
            rate = system.v[first.tolist()] - system.v[second.tolist()]
            found[f"{a}{BETWEEN}{b}"] = apart, rate, reach
    if not found:
        raise InputError("no pair of bodies has a positive distance")
    return found

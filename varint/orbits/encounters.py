"""Close encounters of bodies, and collisions."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import casadi as ca
import numpy as np

from varint.errors import InputError
from varint.integration.simulate import simulate
from varint.orbits.bodies import body_places
from varint.orbits.files import save
from varint.results.records import Event
from varint.results.trajectory import Trajectory
from varint.scene.inputs import finite_array
from varint.scene.system import System, require_system

BETWEEN = "–"  # both names of a pair
TOGETHER = "approach "  # before them in the names of events


@dataclass(frozen=True, eq=False)
class Encounters:
    """Close encounters in the order of time; arrays (K,).

    Attributes
    ----------
    pairs : tuple of str
        Both bodies, ``"1–2"``.
    entered, left : ndarray
        When they came within the distance and left it; not a number where the run ended before.
    t : ndarray
        When they were nearest.
    distance, speed : ndarray
        How near, and their relative speed there.
    """

    pairs: tuple[str, ...]
    entered: np.ndarray
    left: np.ndarray
    t: np.ndarray
    distance: np.ndarray
    speed: np.ndarray

    def __len__(self) -> int:
        return len(self.pairs)

    def __repr__(self) -> str:
        return f"Encounters({len(self)})"

    def __str__(self) -> str:
        lines = [f"{'pair':>12} {'nearest at':>16} {'distance':>12} {'speed':>12} {'lasted':>12}"]
        columns = self.t, self.distance, self.speed, self.left - self.entered
        rows = zip(self.pairs, *columns, strict=True)
        lines += [f"{a:>12} {t:16.8g} {d:12.5g} {v:12.5g} {s:12.5g}" for a, t, d, v, s in rows]
        return "\n".join(lines)

    def save(self, path: Any) -> None:
        """Write it to one ``.npz`` file, which `varint.load` reads."""
        save(self, path)


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
        for name, (apart, _, reach) in _pairs(system, within, max).items()
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
        for apart, _, reach in _pairs(system, radii, lambda a, b: a + b).values()
    ]
    least = rows[0]
    for row in rows[1:]:
        least = ca.fmin(least, row)
    return least


def encounters(motion: Trajectory, within: Any) -> Encounters:
    """The close encounters of a run that has logged its `approaches`: when, how near, how fast.

    From each approach the motion is followed by steps of the same rule until r·v of the pair is
    zero, where they are nearest, and until they part: with the rule's own accuracy, whatever
    nodes the run has kept.

    Parameters
    ----------
    motion : Trajectory
        From ``simulate(..., events=vi.orbits.approaches(system, within))``.
    within : float or array (B,)
        As there.

    Returns
    -------
    Encounters

    Raises
    ------
    InputError
        If the run has controls, or steps of a fictitious time.

    Examples
    --------
    >>> import varint as vi
    >>> model = vi.models.pythagorean_three_body()
    >>> watched = vi.orbits.approaches(model.system, 0.2)
    >>> motion = vi.simulate(
    ...     model.system, vi.gauss(8), q0=model.q0, v0=model.v0, h=5e-4, duration=4.0,
    ...     events=watched,
    ... )
    >>> found = vi.orbits.encounters(motion, 0.2)
    >>> found.pairs, found.distance.round(4)
    (('2–3', '2–3'), array([0.0097, 0.0611]))
    """
    if motion.u.shape[2]:
        raise InputError("encounters are followed without controls; the scene has some")
    if motion.fictitious is not None:
        raise InputError(
            "this run took its steps in a fictitious time; encounters are followed by steps of "
            "one size: run it with h="
        )
    pairs = _pairs(motion.system, within, max)
    rows = [
        (event.kind.removeprefix(TOGETHER), event.time, *_followed(motion, event, pairs))
        for event in motion.events
        if event.kind.startswith(TOGETHER)
    ]
    names = tuple(row[0] for row in rows)
    numbers = np.array([row[1:] for row in rows], dtype=float).reshape(-1, 5)
    entered, left, t, distance, speed = numbers.T
    return Encounters(names, entered, left, t, distance, speed)


Pair = tuple[ca.SX, ca.SX, float]


def _pairs(system: System, sizes: Any, both: Any) -> dict[str, Pair]:
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


def _followed(motion: Trajectory, event: Event, pairs: Mapping[str, Pair]) -> tuple[float, ...]:
    """When a pair parts, is nearest, how near and how fast."""
    name = event.kind.removeprefix(TOGETHER)
    if name not in pairs:
        raise InputError(f"the run logged {event.kind!r}, but no such pair is within= a distance")
    apart, rate, reach = pairs[name]
    steps = int(np.ceil((motion.t[-1] - event.time) / motion.h - 1e-9))
    if steps < 1:
        return np.nan, event.time, *_size(motion, event, apart, rate)
    on = simulate(
        motion.system,
        motion.rule,
        q0=event.q,
        p0=event.p_after,
        t0=event.time,
        duration=motion.t[-1] - event.time,
        steps=steps,
        params=motion.parameters,
        until=(ca.sumsqr(apart) / reach**2 - 1, 1),
        events={"nearest": (ca.dot(apart, rate), 1)},
        save_every=steps,
        progress=False,
    )
    parted = on.t[-1] if on.t[-1] < motion.t[-1] - 1e-9 * abs(motion.h) else np.nan
    candidates = [x for x in on.events if x.kind == "nearest"] or [event]
    sizes = [_size(motion, x, apart, rate) for x in candidates]
    best = int(np.argmin([x[0] for x in sizes]))
    return parted, candidates[best].time, *sizes[best]


def _size(motion: Trajectory, event: Event, apart: ca.SX, rate: ca.SX) -> tuple[float, float]:
    """Distance and relative speed at an event."""
    s = motion.system
    function = ca.Function("size", [s.q, s.v], [ca.norm_2(apart), ca.norm_2(rate)])
    distance, speed = function(event.q, event.v_after)
    return float(distance), float(speed)

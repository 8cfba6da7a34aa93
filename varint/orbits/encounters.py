"""Close encounters of bodies, and collisions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from varint.errors import InputError
from varint.integration.simulate import simulate
from varint.orbits.files import save
from varint.orbits.pairs import TOGETHER, Pair, approaches, pairs_within
from varint.orbits.section import crossings
from varint.results.records import Event
from varint.results.trajectory import Trajectory


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


def encounters(motion: Trajectory, within: Any) -> Encounters:
    """The close encounters of a run: when, how near, how fast.

    Approaches are those that the run has logged; where it has logged none, they are located between
    its nodes, and where it has not kept these, the run is made once more. From each approach the
    motion is followed by steps of the same rule until r·v of the pair is zero, where they are
    nearest, and until they part: with the rule's own accuracy, whatever nodes the run has kept.

    Parameters
    ----------
    motion : Trajectory
        From ``simulate(..., events=vi.orbits.approaches(system, within))``, best.
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
    pairs = pairs_within(motion.system, within, max)
    logged = [event for event in motion.events if event.kind.startswith(TOGETHER)]
    met: Sequence[Met] = logged or _located(motion, within)
    names = tuple(event.kind.removeprefix(TOGETHER) for event in met)
    rows = [(event.time, *_followed(motion, event, pairs)) for event in met]
    numbers = np.array(rows, dtype=float).reshape(-1, 5)
    entered, left, t, distance, speed = numbers.T
    return Encounters(names, entered, left, t, distance, speed)


class Approach(NamedTuple):
    """Where a pair comes within its distance, in the words of an event."""

    kind: str
    time: float
    q: np.ndarray
    v_after: np.ndarray
    p_after: np.ndarray


Met = Event | Approach


def _again(motion: Trajectory, within: Any) -> tuple[Event, ...]:
    """The events of the same run, watched for approaches."""
    steps = int(motion.k[-1] - motion.k[0])
    return simulate(
        motion.system,
        motion.rule,
        q0=motion.q[0],
        p0=motion.p[0],
        t0=float(motion.t[0]),
        h=motion.h,
        steps=steps,
        params=motion.parameters,
        events=approaches(motion.system, within),
        save_every=steps,
    ).events


def _located(motion: Trajectory, within: Any) -> Sequence[Met]:
    """The approaches between the nodes of a motion that has logged none, in the order of time."""
    if (np.diff(motion.k) > 1).any():
        return [one for one in _again(motion, within) if one.kind.startswith(TOGETHER)]
    found = [
        Approach(kind, float(time), *state)
        for kind, (apart, way) in approaches(motion.system, within).items()
        for time, *state in zip(*crossings(motion, apart, way), strict=True)
    ]
    return sorted(found, key=lambda one: one.time)


def _followed(motion: Trajectory, event: Met, pairs: Mapping[str, Pair]) -> tuple[float, ...]:
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


def _size(motion: Trajectory, event: Met, apart: ca.SX, rate: ca.SX) -> tuple[float, float]:
    """Distance and relative speed at an event."""
    s = motion.system
    function = ca.Function("size", [s.q, s.v], [ca.norm_2(apart), ca.norm_2(rate)])
    distance, speed = function(event.q, event.v_after)
    return float(distance), float(speed)

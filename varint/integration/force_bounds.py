"""Forces at many points, and bounds of them on the way between nodes, as data."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import casadi as ca
import numpy as np

from varint.codegen.rows import RowFunction, as_data, at_many_points
from varint.integration.events.intervals import ZERO, Interval, point
from varint.integration.events.jets import Jet, enclosures
from varint.scene.memory import per_system
from varint.scene.system import System

BOUNDED = 2_000  # operations of a force whose bounds along a step are worth their set-up

Rows = Callable[..., list[np.ndarray]]  # (c, arguments) → values at many points


def forces_as_data(system: System) -> tuple[RowFunction | None, ...] | None:
    """What the first looks of `missed_impulse` ask for, where it is data: `push`, `bounds` and
    `bounds_of_many`. None of scenes without explicit time.
    """
    if system.structure.autonomous:
        return None
    return tuple(x and as_data(x) for x in (f(system) for f in (push, bounds, bounds_of_many)))


@per_system
def push(system: System) -> Rows:
    """(c, q, v, t) → the force and the diagonal of M."""
    s = system
    mass = ca.densify(ca.fabs(ca.diag(s.mass_matrix)))
    return at_many_points("push", [s.q, s.v, s.t], s.c, [_force(s), mass])


@per_system
def bounds(system: System) -> Rows | None:
    """(c, q at both ends of a part, when it begins and ends) → bounds of the force and of its
    second derivative in time on the straight line between; None where they take too much to be set
    up.
    """
    s, (begin, end) = system, _times()
    q0, q1 = ca.SX.sym("q0", s.structure.n), ca.SX.sym("q1", s.structure.n)
    speeds = [point(x) for x in ca.vertsplit((q1 - q0) / (end - begin))]
    ways = [_hull(*x) for x in zip(ca.vertsplit(q0), ca.vertsplit(q1), strict=True)]
    found = _bounds(s, ways, speeds, begin, end)
    if found is None:
        return None
    return at_many_points("bounds", [q0, q1, begin, end], s.c, found)


@per_system
def bounds_of_many(system: System) -> Rows | None:
    """(c, least and largest q, least and largest velocity, when they begin and end) → the same
    bounds on all straight lines that lie within.
    """
    s, (begin, end) = system, _times()
    at = [ca.SX.sym(name, s.structure.n) for name in ("low", "high", "slowest", "fastest")]
    low, high, slowest, fastest = map(ca.vertsplit, at)
    ways, speeds = (
        [Interval(*x) for x in zip(*ends, strict=True)]
        for ends in ((low, high), (slowest, fastest))
    )
    found = _bounds(s, ways, speeds, begin, end)
    if found is None:
        return None
    return at_many_points("bounds_of_many", [*at, begin, end], s.c, found)


def _bounds(
    system: System,
    ways: Sequence[Interval],
    speeds: Sequence[Interval],
    begin: ca.SX,
    end: ca.SX,
) -> list[ca.SX] | None:
    s = system
    value = ca.Function("force", [s.q, s.v, s.t, s.c], [_force(s)])
    if value.n_instructions() > BOUNDED:
        return None
    path = [Jet(way, speed, ZERO) for way, speed in zip(ways, speeds, strict=True)]
    still = [Jet(x, ZERO, ZERO) for x in (*speeds, *map(point, ca.vertsplit(s.c)))]
    clock, n = Jet(_hull(begin, end), point(1.0), ZERO), len(speeds)
    jets = enclosures(value, [path, still[:n], [clock], still[n:]])
    return [
        ca.densify(ca.vertcat(*(getattr(interval, side) for interval in of_all)))
        for of_all in ([x.value for x in jets], [x.curvature for x in jets])
        for side in ("low", "high")
    ]


def _force(system: System) -> ca.SX:
    """∂L/∂q + F without controls."""
    s = system
    force = ca.substitute(s.force, s.control, ca.SX.zeros(s.control.shape))
    return ca.densify(ca.gradient(s.lagrangian, s.q) + force)


def _times() -> tuple[ca.SX, ca.SX]:
    return ca.SX.sym("begin"), ca.SX.sym("end")


def _hull(a: ca.SX, b: ca.SX) -> Interval:
    return Interval(ca.fmin(a, b), ca.fmax(a, b))

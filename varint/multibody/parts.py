"""Couplings, loops and actuators as data, checked; and what limits them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import casadi as ca
import numpy as np

from varint.errors import InputError
from varint.multibody.data import Actuator, Anchor, Body, Coupling, Joint, Loop, Machine, Spring
from varint.multibody.quantities import (
    SYMMETRIC,
    excess_moment,
    inertia_matrix,
    not_negative,
    point,
    scalar,
)

LOOPS = ("point", "axis", "weld", "distance", "line", "plane")
THRUSTS = ("thrust", "torque")
FEW_DIGITS = 0.01  # what rounding in files makes of a moment, relative


def named(given: Any) -> Any:
    """The name of a joint, or the name itself."""
    return given.name if isinstance(given, Joint) else given


def joint_named(machine: Machine, name: Any) -> Joint:
    """The joint of that name."""
    if not isinstance(name, str) or name not in machine.joints:
        raise InputError(f"unknown joint {name!r}; known: {list(machine.joints)}")
    return machine.joints[name]


def body_of(name: str, mass: Any, com: Any, inertia: Any, visuals: Sequence[Any]) -> Body:
    """A body, checked; its principal moments fulfil I1 + I2 ≥ I3."""
    body = body_as_told(name, mass, com, inertia, visuals)
    if excess_moment(body.inertia) > SYMMETRIC:
        raise InputError(
            f"no rigid body has the principal moments {_moments(body)} of body {body.name!r}: none "
            "is larger than the sum of the others, as of ∫ (y² + z²), ∫ (z² + x²), ∫ (x² + y²); "
            "give them about the centre of mass, or of a body that turns about one axis alone "
            "that moment and zeros, as (0, 0, I)"
        )
    return body


def body_as_told(name: str, mass: Any, com: Any, inertia: Any, visuals: Sequence[Any]) -> Body:
    """A body, checked but for the sums of its moments."""
    return Body(
        name,
        not_negative(f"the mass of body {name!r}", mass),
        point(f"the centre of mass of body {name!r}", com),
        inertia_matrix(f"the inertia of body {name!r}", inertia),
        tuple(visuals),
    )


def doubtful_moments(source: str, bodies: Mapping[str, Body]) -> str | None:
    """The words of the warning of a file whose bodies have moments that none may have, by more
    than numbers of few digits make; None where there are no such.
    """
    found = [body for body in bodies.values() if excess_moment(body.inertia) > FEW_DIGITS]
    if not found:
        return None
    names = [body.name for body in found]
    return (
        f"{source}: no rigid body has the principal moments of {names}, of the first "
        f"{_moments(found[0])}: none is larger than the sum of the others. They are taken as they "
        "are; see whether the file gives them about the centre of mass, and products of inertia "
        "with their signs"
    )


def _moments(body: Body) -> str:
    return f"({', '.join(f'{x:.6g}' for x in np.linalg.eigvalsh(body.inertia))})"


def spring_of(name: str, a: Anchor, b: Anchor, stiffness: Any, rest: Any, damping: Any) -> Spring:
    """A spring, checked."""
    values = (
        not_negative(f"{what} of spring {name!r}", value)
        for what, value in (("stiffness", stiffness), ("rest", rest), ("damping", damping))
    )
    return Spring(name, a, b, *values)


def coupling_of(
    machine: Machine, follower: Any, leader: Any, coefficients: Sequence[Any]
) -> Coupling:
    """A coupling of two joints of one coordinate each."""
    for name in (follower, leader):
        joint = joint_named(machine, name)
        if joint.kind not in ("revolute", "prismatic"):
            raise InputError(
                f"joint {name!r} is {joint.kind}; couplings join revolute and prismatic joints"
            )
    if follower == leader or follower in [other.follower for other in machine.couplings]:
        raise InputError(f"joint {follower!r} cannot follow {leader!r}: it follows one already")
    if len(coefficients) < 2:
        raise InputError(f"a coupling has at least two coefficients, got {coefficients!r}")
    what = f"a coefficient of the coupling of {follower!r}"
    return Coupling(follower, leader, tuple(scalar(what, x) for x in coefficients))


def loop_of(name: str, kind: str, a: Anchor, b: Anchor, length: Any) -> Loop:
    """A loop of a known kind."""
    if kind not in LOOPS:
        raise InputError(f"unknown kind of loop {kind!r}; known: {list(LOOPS)}")
    if (length is None) != (kind != "distance"):
        raise InputError(f'length belongs to loops of the kind "distance"; {name!r} is {kind!r}')
    if a.body == b.body:
        raise InputError(f"loop {name!r} closes body {a.body!r} upon itself; give two bodies")
    return Loop(
        name, kind, a, b, 0.0 if length is None else not_negative(f"length of {name!r}", length)
    )


def motor_of(
    machine: Machine, joint: Any, name: str | None, index: int, gear: Any, limits: Any
) -> Actuator:
    """An actuator of a joint's coordinate."""
    driven = joint_named(machine, joint)
    if driven.kind in ("spherical", "free", "fixed"):
        raise InputError(
            f"joint {joint!r} is {driven.kind}: no coordinate of it takes a motor; use thrust(...)"
        )
    if index not in range(len(driven.coordinates)):
        raise InputError(f"joint {joint!r} has the coordinates {driven.coordinates}, not {index!r}")
    if name is None:
        name = f"{driven.coordinates[index]}_u"
    gear = scalar(f"gear of {name!r}", gear)
    if limits is None:
        limits = (-driven.limits.effort, driven.limits.effort)
    return Actuator(
        name, "joint", driven.name, index, None, gear, _range(name, limits), ca.SX.sym(name)
    )


def thrust_of(name: str, kind: str, anchor: Anchor, gear: Any, limits: Any) -> Actuator:
    """An actuator along a frame's third axis."""
    if kind not in THRUSTS:
        raise InputError(f"unknown kind of thrust {kind!r}; known: {list(THRUSTS)}")
    limits = (-np.inf, np.inf) if limits is None else limits
    gear = scalar(f"gear of {name!r}", gear)
    return Actuator(name, kind, "", 0, anchor, gear, _range(name, limits), ca.SX.sym(name))


def _range(name: str, limits: Any) -> tuple[float, float]:
    least, largest = limits
    if not least <= largest:
        raise InputError(f"limits of {name!r} exclude everything: {limits!r}")
    return float(least), float(largest)


def bounds_of(machine: Machine) -> list[tuple[float, ca.SX, float]]:
    """What is finite of the limits of joints and actuators."""
    rows = []
    for joint in machine.moving:
        if joint.kind in ("revolute", "prismatic"):
            rows.append((joint.limits.lower, joint.q, joint.limits.upper))
            rows.append((-joint.limits.speed, joint.v, joint.limits.speed))
    rows += [(x.limits[0], x.u, x.limits[1]) for x in machine.actuators.values()]
    return [row for row in rows if np.isfinite(row[0]) or np.isfinite(row[2])]

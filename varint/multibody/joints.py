"""The kinds of joints: their coordinates, axes and what they may carry."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import casadi as ca
import numpy as np

from varint.errors import InputError
from varint.multibody.data import Joint, Limits, Passive
from varint.multibody.quantities import not_negative, placement, scalar
from varint.multibody.rotations import unit

QUATERNION = ("qw", "qx", "qy", "qz")
# what each kind's coordinates are called after the joint's name
COORDINATES: Mapping[str, tuple[str, ...]] = {
    "revolute": ("",),
    "prismatic": ("",),
    "universal": ("1", "2"),
    "spherical": QUATERNION,
    "planar": ("x", "y", "angle"),
    "free": ("x", "y", "z", *QUATERNION),
    "fixed": (),
}
# in which coordinate the unit quaternion of a joint begins
QUATERNION_AT = {"spherical": 0, "free": 3}
STEEP = 0.9  # cosine from which on x is no direction to measure from
ACROSS = 1e-9  # cosine of the angle between two axes that must be at right angles


def joint_of(
    kind: str,
    name: str,
    parent: str,
    child: str,
    axes: tuple[Any, ...],
    at: Any,
    child_at: Any,
    passive: Passive,
    limits: Any,
) -> Joint:
    """A joint as data, checked, with symbols for its coordinates."""
    units = [unit(f"an axis of joint {name!r}", axis) for axis in axes]
    if len(units) == 2 and kind == "planar" and abs(units[0] @ units[1]) > ACROSS:
        raise InputError(
            f"joint {name!r}: the first direction of a planar joint lies in its plane, at right "
            f"angles to the normal; got {axes}"
        )
    if len(units) == 2 and np.linalg.norm(np.cross(units[0], units[1])) < ACROSS:
        raise InputError(f"joint {name!r}: the two axes must differ, got {axes}")
    names = tuple(f"{name}_{x}" if x else name for x in COORDINATES[kind])
    values = (
        (scalar if what == "rest" else not_negative)(f"{what} of joint {name!r}", value)
        for what, value in passive._asdict().items()
    )
    return Joint(
        name,
        kind,
        parent,
        child,
        np.array(units).reshape(-1, 3),
        placement(f"the place of joint {name!r}", at),
        placement(f"the place of joint {name!r} in its child", child_at),
        ca.vertcat(ca.SX(0, 1), *(ca.SX.sym(x) for x in names)),
        ca.vertcat(ca.SX(0, 1), *(ca.SX.sym(f"{x}_dot") for x in names)),
        names,
        Passive(*values),
        limits_of(name, limits),
    )


def direction_across(normal: Any) -> np.ndarray:
    """The direction in a plane that is next to x, or next to y where x is next to the normal."""
    n = unit("the normal", normal)
    x = np.eye(3)[0 if abs(n[0]) < STEEP else 1]
    return x - n * (x @ n)


def limits_of(name: str, given: Any) -> Limits:
    """Limits from None, (lower, upper), or `Limits`."""
    if given is None:
        return Limits()
    limits = given if isinstance(given, Limits) else Limits(*given)
    if not limits.lower <= limits.upper or not limits.speed >= 0 or not limits.effort >= 0:
        raise InputError(f"limits of {name!r} exclude everything: {tuple(limits)}")
    return limits

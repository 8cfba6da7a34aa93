"""Start values by the names of joints, rotations as unit quaternions."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from varint.errors import InputError
from varint.multibody.data import Joint
from varint.multibody.joints import QUATERNION_AT
from varint.multibody.model import Model
from varint.multibody.parts import joint_named
from varint.multibody.rotations import quaternion_rate
from varint.scene.inputs import finite_array

NO_TURN = np.array([1.0, 0.0, 0.0, 0.0])


def start_values(
    model: Model, q: Mapping[str, Any] | None = None, v: Mapping[str, Any] | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Coordinates and rates (n,) each of a model, from those of its joints; the others are zero.

    In a model from MJCF the others are where the file puts them, MuJoCo's ``qpos0``: free bodies in
    their place, joints at their reference.

    Quaternions are made unit vectors, and their rates are those of angular velocities,
    ``q̇ = ½ q (0, ω)``. Loops are not closed: `varint.project` does that.

    Parameters
    ----------
    model : Model
    q : dict of str to float or array, optional
        Coordinates by joint: of a ball joint the quaternion (4,), (w, x, y, z), of any length but
        zero; of a free joint the position and the quaternion (7,).
    v : dict of str to float or array, optional
        Rates by joint: of a ball joint the angular velocity (3,) along the body's axes; of a free
        joint the velocity and the angular velocity (6,).

    Returns
    -------
    q0, v0 : array (n,)

    Raises
    ------
    InputError
        If a joint is unknown or follows another, or its values have the wrong shape.

    Examples
    --------
    >>> import varint.multibody as mb
    >>> world = mb.Model()
    >>> ball = world.spherical(world, world.body(1.0, inertia=1.0, name="ball"))
    >>> mb.start_values(world, {"ball": [2, 0, 0, 0]}, {"ball": [0, 0, 4]})
    (array([1., 0., 0., 0.]), array([0., 0., 0., 2.]))
    """
    moving = {joint.name for joint in model.machine.moving}
    home = {name: value for name, value in model.machine.home.items() if name in moving}
    given_q, given_v = home | dict(q or {}), dict(v or {})
    for name in (*given_q, *given_v):
        if joint_named(model.machine, name).name not in moving:
            raise InputError(f"joint {name!r} follows another; give the start of that one")
    both = [
        _of_joint(joint, given_q.get(joint.name), given_v.get(joint.name))
        for joint in model.machine.moving
    ]
    places, rates = zip(*both, strict=True)
    return np.concatenate(places), np.concatenate(rates)


def _of_joint(joint: Joint, q: Any, v: Any) -> tuple[np.ndarray, np.ndarray]:
    first = QUATERNION_AT.get(joint.kind)
    size = len(joint.coordinates)
    if first is None:
        return _numbers(joint, "q", q, size), _numbers(joint, "v", v, size)
    place = np.append(np.zeros(first), NO_TURN) if q is None else _numbers(joint, "q", q, size)
    rate, turn = _numbers(joint, "v", v, size - 1), place[first:]
    length = np.linalg.norm(turn)
    if length == 0:
        raise InputError(f"the quaternion of joint {joint.name!r} is zero: no rotation has it")
    turn = turn / length
    return (
        np.append(place[:first], turn),
        np.append(rate[:first], quaternion_rate(turn, rate[first:])) + 0.0,  # no −0
    )


def _numbers(joint: Joint, what: str, given: Any, size: int) -> np.ndarray:
    if given is None:
        return np.zeros(size)
    value = np.atleast_1d(finite_array(f"{what} of joint {joint.name!r}", given))
    if value.shape != (size,):
        raise InputError(
            f"{what} of joint {joint.name!r} ({joint.kind}) has shape {value.shape}; it must be "
            f"({size},)"
        )
    return value

"""The pose that a file describes."""

from __future__ import annotations

import numpy as np

from varint.multibody.joints import QUATERNION_AT
from varint.multibody.model import Model


def home(model: Model) -> np.ndarray:
    """Coordinates of the pose that a model's file describes: where its bodies stand in the file.

    Joints are at zero, or at the reference that MJCF gives; unit quaternions are the identity, and
    free bodies of MJCF stand where the file puts them (MuJoCo's ``qpos0``).

    Parameters
    ----------
    model : Model

    Returns
    -------
    ndarray (n,)
        As ``q0`` of `simulate`.

    Examples
    --------
    >>> import varint.multibody as mb
    >>> ball = '<body pos="1 0 2"><freejoint/><geom size="1"/></body>'
    >>> mb.home(mb.from_mjcf(f"<mujoco><worldbody>{ball}</worldbody></mujoco>"))
    array([1., 0., 2., 1., 0., 0., 0.])
    """
    found = []
    for joint in model.machine.moving:
        rest = np.zeros(len(joint.coordinates))
        if joint.kind in QUATERNION_AT:
            rest[QUATERNION_AT[joint.kind]] = 1.0
        found.append(model.machine.home.get(joint.name, rest))
    return np.concatenate(found) if found else np.zeros(0)

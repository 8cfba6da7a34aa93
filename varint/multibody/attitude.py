"""How well a fit knows the attitude of a joint that turns by a quaternion."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from varint.errors import InputError
from varint.multibody.joints import QUATERNION
from varint.scene.rays import tangent_columns

if TYPE_CHECKING:
    from varint.estimation.result import Fit

QUARTERS = 4.0  # B⁺ = 4 Bᵀ of δq = B δθ


def rotation_covariance(found: Fit, joint: Any, experiment: int = 0) -> np.ndarray:
    """Covariance (3, 3), rad², of the rotation vector by which a fitted start attitude is off,
    about the body's axes: δq = ½ q ∘ (0, δθ).

    The covariance of the quaternion's four numbers in the fit is B Σ Bᵀ of it, of rank three.

    Parameters
    ----------
    found : Fit
        With "q0" among its unknowns.
    joint : Joint or str
        A ball or free joint.
    experiment : int, optional
        Which of several.

    Returns
    -------
    ndarray (3, 3)

    Raises
    ------
    InputError
        If the fit has no such quaternion.

    Examples
    --------
    >>> import numpy as np
    >>> import varint as vi
    >>> import varint.multibody as mb
    >>> world = mb.Model(gravity=(0, 0, 0))
    >>> ball = world.body(1.0, inertia=(1, 2, 3), name="ball")
    >>> joint = world.spherical(world, ball)
    >>> q0, v0 = mb.start_values(world, {}, {"ball": [0, 0, 1]})
    >>> motion = vi.simulate(world.system(), vi.gauss(2), q0=q0, v0=v0, h=0.1, steps=10)
    >>> tips = [world.frame((ball, x)).position for x in np.eye(3)]
    >>> seen = [vi.Measurement(x, motion.t, motion.value(x), sigma=0.01) for x in tips]
    >>> found = vi.fit(
    ...     world.system(), vi.gauss(2), data=seen, unknown=["q0", "v0"], h=0.1, q0=q0, v0=v0)
    >>> np.sqrt(np.diag(mb.rotation_covariance(found, joint))).round(4)
    array([0.0039, 0.0039, 0.004 ])
    """
    name = joint if isinstance(joint, str) else getattr(joint, "name", joint)
    wanted = [f"{name}_{x}(0)" for x in QUATERNION]
    if f"{wanted[0]} of experiment {experiment}" in found.names:
        wanted = [f"{x} of experiment {experiment}" for x in wanted]
    if missing := [x for x in wanted if x not in found.names]:
        raise InputError(
            f"the fit has no {missing[0]!r}: it needs 'q0' among its unknowns, and a ball or free "
            f"joint; it found {list(found.names)}"
        )
    at = [found.names.index(x) for x in wanted]
    back = QUARTERS * tangent_columns(((0, 1, 2, 3),), found.estimates[at]).T
    return back @ found.covariance[np.ix_(at, at)] @ back.T

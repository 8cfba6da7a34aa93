"""Mass, centre of mass and inertia as ten free numbers, of which any belong to a body that exists.

A body's density has a positive matrix of second moments, its pseudo-inertia, which says more than
that its principal moments are positive: none is larger than the sum of the others.
"""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from varint.errors import InputError
from varint.multibody.quantities import inertia_matrix, point
from varint.scene.inputs import finite_array, number

COUNT = 10


def log_cholesky(mass: Any, com: Any, inertia: Any) -> np.ndarray:
    """θ = (α, d₁, d₂, d₃, s₁₂, s₂₃, s₁₃, t₁, t₂, t₃) of a body: mass e^{2α}, centre of mass t, and
    ½ tr(I) 1 − I = m S Sᵀ with S upper triangular, e^{d} on its diagonal.

    What a fit may vary without bounds: any ten numbers are a body's, see `rigid_body`.

    Parameters
    ----------
    mass : float
    com : array (3,)
        Centre of mass in the body's frame.
    inertia : float or array (3,) or (3, 3)
        About the centre of mass.

    Returns
    -------
    ndarray (10,)

    Raises
    ------
    InputError
        If no body has these: its mass or a moment is not positive, or a principal moment is not
        smaller than the sum of the others.

    Notes
    -----
    Rucker & Wensing, Smooth parameterization of rigid-body inertia, IEEE Robotics and Automation
    Letters 7 (2022) 2771; Wensing, Kim & Slotine, 3 (2018) 60.

    Examples
    --------
    >>> import varint.multibody as mb
    >>> theta = mb.log_cholesky(2.0, [0.0, 0.0, 0.3], [0.02, 0.03, 0.04])
    >>> mass, com, inertia = mb.rigid_body(theta)
    >>> round(float(mass), 12), [round(float(x), 12) for x in inertia.diagonal()]
    (2.0, [0.02, 0.03, 0.04])
    """
    m, c = number("mass", mass), finite_array("com", point("com", com))
    if m <= 0:
        raise InputError(f"mass must be positive, got {mass!r}")
    moments = np.array(inertia_matrix("inertia", inertia), dtype=float)
    second = np.trace(moments) / 2 * np.eye(3) - moments
    principal = np.linalg.eigvalsh(moments)
    if np.linalg.eigvalsh(second).min() <= 0:
        raise InputError(
            f"no body has the principal moments {principal.tolist()}: each must be smaller than "
            "the sum of the others"
        )
    # S upper: the Cholesky factor of the matrix read from its end
    s = np.linalg.cholesky(second[::-1, ::-1] / m)[::-1, ::-1]
    logs = np.log(np.diag(s))
    return np.concatenate([[np.log(m) / 2], logs, [s[0, 1], s[1, 2], s[0, 2]], c])


def rigid_body(theta: Any) -> tuple[Any, Any, Any]:
    """Mass, centre of mass (3,) and inertia about it (3, 3) of ten numbers, or of ten unknowns.

    Parameters
    ----------
    theta : array or SX (10,)
        See `log_cholesky`.

    Returns
    -------
    tuple
        Numbers, or expressions: what ``Model.body`` takes.

    Raises
    ------
    InputError
        If these are not ten.
    """
    if isinstance(theta, ca.SX):
        if theta.numel() != COUNT:
            raise InputError(f"theta has {theta.numel()} entries, a body {COUNT}")
        a = ca.vertsplit(ca.vec(ca.densify(theta)))
        s = ca.vertcat(
            ca.horzcat(ca.exp(a[1]), a[4], a[6]),
            ca.horzcat(0, ca.exp(a[2]), a[5]),
            ca.horzcat(0, 0, ca.exp(a[3])),
        )
        mass = ca.exp(2 * a[0])
        second = mass * ca.mtimes(s, s.T)
        return mass, ca.vertcat(*a[7:]), ca.trace(second) * ca.SX.eye(3) - second
    a = finite_array("theta", theta)
    if a.shape != (COUNT,):
        raise InputError(f"theta has shape {a.shape}, a body {COUNT} numbers")
    d = np.exp(a[1:4])
    s = np.array([[d[0], a[4], a[6]], [0, d[1], a[5]], [0, 0, d[2]]])
    mass = float(np.exp(2 * a[0]))
    second = mass * s @ s.T
    return mass, a[7:].copy(), np.trace(second) * np.eye(3) - second

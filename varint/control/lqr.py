"""Feedback about a motion: the discrete linear–quadratic regulator on the exact derivative of
one step.
"""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from varint.errors import InputError
from varint.integration.step_function import step_function
from varint.numerics.arrays import over_columns
from varint.results.trajectory import Trajectory
from varint.rules.rule import Rule
from varint.scene.memory import per_system
from varint.scene.system import System


def lqr(motion: Trajectory, state_cost: Any, control_cost: Any, end_cost: Any = None) -> np.ndarray:
    """Gains K_k of δu_k = −K_k (δq_k, δp_k) that keep a motion at least cost Σ h (δxᵀQδx + δuᵀRδu)
    + δx_NᵀQ_N δx_N.

    The linearisation is that of the discrete step itself, (A_k, B_k) = ∂(q1, p1)/∂(q0, p0) and
    ∂(q1, p1)/∂u, so the gains belong to the simulation exactly; δu_k is added to all the values of
    u in step k.

    Parameters
    ----------
    motion : Trajectory
        With nodes one step apart, from `simulate` or `optimal_control`.
    state_cost, end_cost : array (2n, 2n)
        Q and Q_N for (q, p), symmetric, positive semidefinite; Q_N defaults to Q.
    control_cost : array (k, k)
        R, symmetric, positive definite.

    Returns
    -------
    ndarray (N, k, 2n)

    Raises
    ------
    InputError
        If the scene has no controls, nodes are several steps apart, or shapes do not match.

    Notes
    -----
    Riccati's recursion, for example Anderson & Moore, Optimal Control: Linear Quadratic Methods,
    §2.4.

    Examples
    --------
    >>> import casadi as ca, numpy as np
    >>> import varint as vi
    >>> q, v = vi.coordinates("x")
    >>> force = ca.SX.sym("force")
    >>> cart = vi.System(q, v, v**2 / 2, force=force, control=force)
    >>> still = np.zeros((20000, 1))
    >>> rest = vi.simulate(cart, vi.gauss(2), q0=0, v0=0, h=0.001, steps=20000, u=still)
    >>> np.round(vi.lqr(rest, np.eye(2), np.eye(1))[0], 2)
    array([[1.  , 1.73]])
    """
    if not isinstance(motion, Trajectory):
        raise InputError(f"lqr takes the Trajectory to follow, got {type(motion).__name__}")
    structure = motion.system.structure
    if not structure.controls:
        raise InputError("lqr() needs a scene with controls")
    if (np.diff(motion.k) != 1).any():
        raise InputError("lqr() needs every node; run the simulation without at= and save_every=")
    x = 2 * structure.n
    Q = _symmetric("state_cost", state_cost, x)
    R = _symmetric("control_cost", control_cost, structure.controls)
    P = Q if end_cost is None else _symmetric("end_cost", end_cost, x)
    if np.linalg.eigvalsh(R).min() <= 0:
        raise InputError("control_cost must be positive definite")
    A, B = linearise(motion)
    h = np.diff(motion.t)
    gains = np.empty((len(h), structure.controls, x))
    for k in range(len(h) - 1, -1, -1):
        weighted = B[k].T @ P
        gains[k] = np.linalg.solve(h[k] * R + weighted @ B[k], weighted @ A[k])
        P = h[k] * Q + A[k].T @ P @ (A[k] - B[k] @ gains[k])
        P = (P + P.T) / 2
    return gains


def linearise(motion: Trajectory) -> tuple[np.ndarray, np.ndarray]:
    """A_k (N, 2n, 2n) and B_k (N, 2n, k) of every step of a motion, by exact derivatives."""
    n, controls, rule = motion.system.structure.n, motion.system.structure.controls, motion.rule
    count = len(motion) - 1
    u = np.broadcast_to(motion.u[motion.k[:-1]], (count, len(rule.nodes), controls)).reshape(
        count, -1
    )
    t, h = motion.t[:-1, None], np.diff(motion.t)[:, None]
    A, B = over_columns(
        _slopes(motion.system, rule), motion.q[:-1], motion.p[:-1], u, motion.c, t, h
    )
    return A.reshape(count, 2 * n, 2 * n).transpose(0, 2, 1), B.reshape(
        count, controls, 2 * n
    ).transpose(0, 2, 1)


@per_system
def _slopes(system: System, rule: Rule) -> ca.Function:
    """(q, p, u, c, t, h) → (A, B) of one step; u changes by the same amount at all nodes."""
    step = step_function(system, rule)
    q, p, u, c, t, h = (ca.MX.sym(f"i{i}", *step.size_in(i)) for i in range(6))
    change = ca.MX.sym("change", system.structure.controls)
    q1, p1, _ = step(q, p, u + ca.repmat(change, 1, u.shape[1]), c, t, h)
    after, state = ca.vertcat(q1, p1), ca.vertcat(q, p)
    slopes = [ca.densify(ca.jacobian(after, x)) for x in (state, change)]
    f = ca.Function("slopes", [q, p, u, c, t, h, change], slopes)
    return ca.Function("slopes", [q, p, u, c, t, h], f(q, p, u, c, t, h, 0))


def _symmetric(what: str, value: Any, size: int) -> np.ndarray:
    try:
        matrix = np.array(value, dtype=float)
    except (TypeError, ValueError):
        raise InputError(f"{what} must be a matrix of numbers, got {value!r}") from None
    if matrix.shape != (size, size) or not np.allclose(matrix, matrix.T):
        raise InputError(
            f"{what} must be a symmetric matrix ({size}, {size}), got shape {matrix.shape}"
        )
    return matrix

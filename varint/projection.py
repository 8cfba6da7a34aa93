"""The nearest start on the constraint manifold."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import casadi as ca
import numpy as np

from varint.arrays import call
from varint.errors import InputError
from varint.manifold import rows_function
from varint.parameters import finite_array, number
from varint.system import System, parameter_values, per_system, require_system

OFF = 1e-11  # of what the coordinates themselves contribute to g: larger is a wrong start, smaller is round-off
MOST_ITERATIONS = 100


@per_system
def _shape_function(system: System) -> ca.Function:
    """(q, v, t, c) → (g and gaps, their slopes, M, ∂L/∂v)."""
    s = system
    g = ca.vertcat(s.constraint, s.contact)
    outputs = [ca.densify(x) for x in (g, ca.jacobian(g, s.q), s.mass_matrix, s.momentum)]
    return ca.Function("shape", [s.q, s.v, s.t, s.c], outputs)


def shape(system: System, q: np.ndarray, v: np.ndarray, t: float, c: np.ndarray) -> tuple[np.ndarray, ...]:
    """g and gaps (m + c,), their slopes (m + c, n), M (n, n), p (n,) at one state."""
    n = system.structure.n
    g, slope, mass, p = call(_shape_function(system), q, v, np.array([t]), c)
    return g, slope.reshape(n, -1).T, mass.reshape(n, n).T, p


def row_sizes(slope: np.ndarray, q: np.ndarray) -> np.ndarray:
    """What a change of each coordinate by its own size would make of each row: the yardstick of |g|."""
    far = np.abs(q).max(initial=0.0)
    return np.abs(slope) @ np.maximum(np.abs(q), 1e-3 * far if far else 1.0)


def project(
    system: System, q0: Any, v0: Any = None, *, t0: float = 0.0, params: Mapping[str, Any] | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Nearest consistent start: min |q − q0| with g(q, t0) = 0, then min |v − v0| with G v + ∂g/∂t = 0, |x|² = xᵀMx.

    Parameters
    ----------
    system : System
        With constraints.
    q0, v0 : array (n,)
        A start near the manifold; v0 defaults to rest.
    t0 : float
        Start time.
    params : dict, optional
        Parameter values that differ from the defaults.

    Returns
    -------
    q, v : ndarray (n,)
        A start that `simulate` accepts.

    Raises
    ------
    InputError
        If no configuration near q0 fulfils the constraints: start closer, or check that they can all hold at once.

    References
    ----------
    Hairer, Lubich & Wanner, Geometric Numerical Integration, 2nd ed., IV.4, VII.1.

    Examples
    --------
    >>> import casadi as ca
    >>> import varint as vi
    >>> q, v = vi.coordinates("x", "y")
    >>> pendulum = vi.System(q, v, ca.dot(v, v) / 2 - 9.81 * q[1], constraint=ca.dot(q, q) - 1)
    >>> q0, v0 = vi.project(pendulum, [1.1, 0.0], [0.3, 2.0])
    >>> q0, v0
    (array([1., 0.]), array([0., 2.]))
    """
    require_system(system)
    n, names = system.structure.n, system.names
    q = finite_array("q0", q0).ravel()
    v = np.zeros(n) if v0 is None else finite_array("v0", v0).ravel()
    if q.shape != (n,) or v.shape != (n,):
        raise InputError(f"q0 has {q.size} and v0 {v.size} numbers; each needs {n}, one for each of {list(names)}")
    c, t0 = parameter_values(system, params), number("t0", t0)
    q = onto(system, q, v, t0, c)
    rows, slope = velocity_gaps(system, q, v, t0, c)
    _, _, mass, _ = shape(system, q, v, t0, c)
    return q, v + _least(mass, slope, -rows)


def onto(system: System, q0: np.ndarray, v: np.ndarray, t: float, c: np.ndarray) -> np.ndarray:
    """Gauss–Newton onto g = 0 in the metric of the mass matrix at q0."""
    m = system.constraint.numel()
    q = q0.copy()
    mass = shape(system, q0, v, t, c)[2]
    last = np.inf
    for _ in range(MOST_ITERATIONS):
        g, slope = (x[:m] for x in shape(system, q, v, t, c)[:2])
        if not (np.isfinite(g).all() and np.isfinite(slope).all()):
            break
        # Lagrange–Newton with the curvature of g left out: q stays the foot of the perpendicular through q0
        step = _least(mass, slope, -g - slope @ (q0 - q)) + (q0 - q)
        size = np.abs(step).max(initial=0.0)
        q = q + step
        if size <= 4 * np.finfo(float).eps * np.abs(q).max(initial=0.0) or last <= size <= OFF * np.abs(q).max():
            break
        last = size
    g, slope = (x[:m] for x in shape(system, q, v, t, c)[:2])
    bad = ~(np.abs(g) <= OFF * row_sizes(slope, q))
    if bad.any():
        raise InputError(
            f"no configuration near q0={q0} fulfils the constraint rows {np.flatnonzero(bad).tolist()}: "
            f"|g| = {np.abs(g[bad]).max():.1e} is the best found; start closer, or check that all rows can hold at once"
        )
    return q


@np.errstate(all="ignore")  # what is not finite is looked at
def _least(mass: np.ndarray, slope: np.ndarray, target: np.ndarray) -> np.ndarray:
    """min xᵀMx with slope x = target, of least norm where that leaves a choice."""
    n, m = mass.shape[0], len(target)
    size = np.sqrt(np.abs(np.diag(mass)))
    size = np.where(size > 0, size, size.max() or 1.0)
    rows = slope / size
    length = np.linalg.norm(rows, axis=1)
    length = np.where(length > 0, length, 1.0)
    matrix = np.zeros((n + m, n + m))
    matrix[:n, :n] = mass / np.outer(size, size)
    matrix[:n, n:], matrix[n:, :n] = (rows / length[:, None]).T, rows / length[:, None]
    right = np.concatenate([np.zeros(n), target / length])
    if not (np.isfinite(matrix).all() and np.isfinite(right).all()):
        raise InputError(
            "no projection: the constraints, their gradients or the mass matrix are not finite or too large on the way "
            "(a square root of a negative number, a pole, an overflow); start closer, or in other units"
        )
    return np.linalg.lstsq(matrix, right, rcond=1e-13)[0][:n] / size


@per_system
def _gaps_function(system: System) -> ca.Function:
    """(q, v, t, c) → (W v + w, W), dense."""
    s = system
    outputs = [ca.densify(x) for x in rows_function(s)(s.q, s.v, s.t, s.c)]
    return ca.Function("velocity_gaps", [s.q, s.v, s.t, s.c], outputs)


def velocity_gaps(
    system: System, q: np.ndarray, v: np.ndarray, t: float, c: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """W v + w (rows,) and W (rows, n) at one state."""
    rows, slope = call(_gaps_function(system), q, v, np.array([t]), c)
    return rows, slope.reshape(len(q), -1).T

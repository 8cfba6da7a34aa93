"""The nearest start on the constraint manifold."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from varint.discrete.constraints import every_row_function, position_rows
from varint.discrete.inertia import inertia_roots, mass_at, scaled_mass
from varint.errors import InputError
from varint.numerics.arrays import call, is_definite
from varint.numerics.limits import PROJECTION_ITERATIONS
from varint.scene.inputs import finite_array, number
from varint.scene.memory import per_system
from varint.scene.parameters import ParameterValues
from varint.scene.system import System, parameter_values, require_system

# of what the coordinates themselves contribute to g: larger is a wrong start, smaller is round-off
OFF = 1e-11
LEAST = 1e-3  # of the largest coordinate: the size of one that is smaller, or at zero
NEARLY = 1e-4  # of the coordinates: steps within which Newton's method converges by itself
HALVINGS = 12  # of a step that would not come nearer
FREE = 1e-10  # of the largest singular value of the gradients: directions that stay on the manifold
# where to look for the manifold if the gradients lead nowhere: this far away, so many times
WIDER, STARTS = (1e-3, 0.1, 0.5, 2.0), 5


def row_sizes(slope: np.ndarray, q: np.ndarray) -> np.ndarray:
    """What a change of each coordinate by its own size would make of each row, (…, m, n) and (…, n)
    → (…, m): the yardstick of |g|.
    """
    size = np.abs(q)
    far = size.max(axis=-1, keepdims=True, initial=0.0)
    least = np.where(far > 0, LEAST * far, 1.0)
    return (np.abs(slope) @ np.maximum(size, least)[..., None])[..., 0]


def project(
    system: System,
    q0: Any,
    v0: Any = None,
    *,
    t0: float = 0.0,
    params: ParameterValues | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Nearest consistent start: min |q − q0| with g(q, t0) = 0, then min |v − v0| with G v + ∂g/∂t
    = 0, |x|² = xᵀMx.

    Parameters
    ----------
    system : System
        With constraints.
    q0, v0 : array (n,)
        A start near the manifold; v0 defaults to rest.
    t0 : float
        Start time.
    params : dict, optional
        Parameter values that differ from the defaults, by name or symbol.

    Returns
    -------
    q, v : ndarray (n,)
        A start that `simulate` accepts.

    Raises
    ------
    InputError
        If no configuration near q0 fulfils the constraints: start closer, or check that they can
        all hold at once.

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
        raise InputError(
            f"q0 has {q.size} and v0 {v.size} numbers; each needs {n}, one for each of "
            f"{list(names)}"
        )
    c, t0 = parameter_values(system, params), number("t0", t0)
    q = project_configuration(system, q, v, t0, c)
    rows, slope = velocity_gaps(system, q, v, t0, c)
    return q, v + _least(_finite_mass(system, q, v, t0, c), slope, -rows)


def _finite_mass(
    system: System, q: np.ndarray, v: np.ndarray, t: float, c: np.ndarray
) -> np.ndarray:
    """The metric of the projection at a state."""
    mass = mass_at(system, q, v, t, c)
    if not np.isfinite(mass).all():
        raise InputError(
            f"no projection: the mass matrix ∂²L/∂v² is not finite at q0={q}, v0={v}, t0={t:g} (a "
            "square root or a pole there); start elsewhere"
        )
    return mass


@np.errstate(all="ignore")  # what is not finite is looked at
def project_configuration(
    system: System, q0: np.ndarray, v: np.ndarray, t: float, c: np.ndarray
) -> np.ndarray:
    """The foot of the perpendicular through q0 onto g = 0, in the metric of the mass matrix at q0.

    Newton's method with the curvature of g along the manifold (sequential quadratic programming);
    every point is on it, and the distance to q0 shrinks from one to the next.
    """
    mass = _finite_mass(system, q0, v, t, c)
    root, metric = inertia_roots(mass), scaled_mass(mass)
    q = _feasible(system, q0, root, t, c)
    last = np.inf
    for _ in range(PROJECTION_ITERATIONS):
        away = (q0 - q) * root
        step, exact = _along(system, q, away, root, metric, t, c)
        size, far = np.abs(step / root).max(initial=0.0), np.abs(q).max(initial=0.0)
        if not size > 4 * np.finfo(float).eps * far or (exact and last <= size <= OFF * far):
            break
        if exact and size <= NEARLY * far:  # the distance no longer tells, Newton's method does
            q, last = restore(system, q + step / root, root, t, c), size
            continue
        for halving in range(HALVINGS):
            trial = restore(system, q + step / root / 2**halving, root, t, c)
            left = (q0 - trial) * root
            if is_on(system, trial, t, c) and left @ metric @ left < away @ metric @ away:
                break
        else:
            break
        q = trial
    return q


def _feasible(
    system: System, q0: np.ndarray, root: np.ndarray, t: float, c: np.ndarray
) -> np.ndarray:
    """A configuration on g = 0: from q0, or from near it where the gradients of g vanish there."""
    random, far = np.random.default_rng(1), max(np.abs(q0).max(initial=0.0), 1e-3)
    best, least = q0, np.inf
    for wide in (0.0, *WIDER):
        for _ in range(STARTS if wide else 1):
            q = restore(system, q0 + wide * far * random.normal(size=len(q0)), root, t, c)
            if is_on(system, q, t, c):
                return q
            left = np.abs(_rows(system, q, t, c)[0]).max()
            if left < least:
                best, least = q, left
    g, slope = _rows(system, best, t, c)
    bad = ~(np.abs(g) <= OFF * row_sizes(slope, best))
    if not (np.isfinite(least) and np.isfinite(slope).all()):
        raise _not_finite(q0)
    raise InputError(
        f"no configuration near q0={q0} fulfils the constraint rows "
        f"{np.flatnonzero(bad).tolist()}: |g| = {np.abs(g[bad]).max():.1e} is the best found; "
        "start closer, or check that all rows can hold at once"
    )


def _not_finite(q: np.ndarray | None = None) -> InputError:
    where = "on the way" if q is None else f"near {q}"
    return InputError(
        f"no projection: the constraints, their gradients or the mass matrix {where} are not "
        "finite or too large (a square root of a negative number, a pole, an overflow); start "
        "closer, or in other units"
    )


def restore(system: System, q: np.ndarray, root: np.ndarray, t: float, c: np.ndarray) -> np.ndarray:
    """Where g vanishes near q, by Gauss and Newton's method.

    Whole steps: |g| may grow at first, as across a narrow valley, which shorter steps would follow
    for ever. Halved only where g is not defined.
    """
    g, slope = _rows(system, q, t, c)
    last = np.inf
    for _ in range(PROJECTION_ITERATIONS):
        length = np.linalg.norm(slope / root, axis=1)
        length = np.where(length > 0, length, 1.0)
        rows = slope / root / length[:, None]
        if not (np.isfinite(g).all() and np.isfinite(rows).all()):
            return q
        step = np.linalg.lstsq(rows, -g / length, rcond=1e-13)[0] / root
        size, far = np.abs(step).max(initial=0.0), np.abs(q).max(initial=0.0)
        if size <= 4 * np.finfo(float).eps * far or last <= size <= OFF * far:
            return q
        last = size
        for halving in range(HALVINGS):
            trial = q + step / 2**halving
            g, slope = _rows(system, trial, t, c)
            if np.isfinite(g).all() and np.isfinite(slope).all():
                break
        else:
            return q
        q = trial
    return q


def _along(
    system: System,
    q: np.ndarray,
    away: np.ndarray,
    root: np.ndarray,
    metric: np.ndarray,
    t: float,
    c: np.ndarray,
) -> tuple[np.ndarray, bool]:
    """Newton's step from a point of the manifold towards the foot, times the roots of the masses,
    and whether it has the curvature: without, where that would lead to a farthest point.
    """
    slope = _rows(system, q, t, c)[1] / root
    if not np.isfinite(slope).all():
        raise _not_finite(q)
    lam = np.linalg.lstsq(slope.T, metric @ away, rcond=1e-13)[0]
    n = len(q)
    bent = call(_curvature_function(system), q, np.array([t]), c, lam)[0].reshape(n, n)
    _, values, right = np.linalg.svd(slope)
    free = right[int((values > FREE * values.max(initial=0.0)).sum()) :]
    for hessian, exact in ((metric + bent / np.outer(root, root), True), (metric, False)):
        reduced = free @ hessian @ free.T
        if not exact or is_definite(reduced):
            wanted = free @ metric @ away
            return free.T @ np.linalg.lstsq(reduced, wanted, rcond=1e-13)[0], exact
    raise AssertionError("the metric itself is always taken")


@per_system
def _curvature_function(system: System) -> ca.Function:
    """(q, t, c, λ) → ∂²(λ·g)/∂q², dense."""
    s, lam = system, ca.SX.sym("lam", system.structure.constraints)
    bent = ca.hessian(ca.dot(lam, s.constraint), s.q)[0]
    return ca.Function("curvature", [s.q, s.t, s.c, lam], [ca.densify(bent)])


def _rows(system: System, q: np.ndarray, t: float, c: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    m = system.constraint.numel()
    g, slope = position_rows(system, q, t, c)
    return g[:m], slope[:m]


def is_on(system: System, q: np.ndarray, t: float, c: np.ndarray) -> bool:
    """Whether g vanishes at q but for round-off, with slopes that tell where else it does."""
    g, slope = _rows(system, q, t, c)
    return bool(np.isfinite(slope).all() and (np.abs(g) <= OFF * row_sizes(slope, q)).all())


@np.errstate(all="ignore")  # what is not finite is looked at
def _least(mass: np.ndarray, slope: np.ndarray, target: np.ndarray) -> np.ndarray:
    """min xᵀMx with slope x = target, of least norm where that leaves a choice."""
    n, m = mass.shape[0], len(target)
    size = inertia_roots(mass)
    rows = slope / size
    length = np.linalg.norm(rows, axis=1)
    length = np.where(length > 0, length, 1.0)
    matrix = np.zeros((n + m, n + m))
    matrix[:n, :n] = mass / np.outer(size, size)
    matrix[:n, n:], matrix[n:, :n] = (rows / length[:, None]).T, rows / length[:, None]
    right = np.concatenate([np.zeros(n), target / length])
    if not (np.isfinite(matrix).all() and np.isfinite(right).all()):
        raise _not_finite()
    return np.linalg.lstsq(matrix, right, rcond=1e-13)[0][:n] / size


def velocity_gaps(
    system: System, q: np.ndarray, v: np.ndarray, t: float, c: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """W v + w (rows,) and W (rows, n) of holonomic and non-holonomic constraints at one state."""
    rows, slope = call(every_row_function(system), q, v, np.array([t]), c)
    count = len(rows) - system.contact.numel()
    return rows[:count], slope.reshape(len(q), -1).T[:count]

"""Whether a generator is a symmetry of the Lagrangian, and what else in the scene does not share it."""

from __future__ import annotations

import casadi as ca
import numpy as np

from varint.arrays import over_columns
from varint.errors import InputError
from varint.symmetry.sampling import Points, Region, at_points, sampled
from varint.system import System

CHECKS = 40  # fresh random points
TOLERANCE = 1e-9  # residual relative to the sum of its terms' absolute values; true symmetries leave 1e-16 to 1e-12
LEAST_TERM = 1e-3  # of L: terms that should cancel inside ∂L/∂q leave rounding errors measured against it
ON_SURFACE = 1e-12
MOST_PROJECTIONS = 50


def variation(system: System, xi: ca.SX, tau: ca.SX) -> ca.SX:
    """δL − d(τL)/dt = ∂L/∂q·ξ + ∂L/∂v·ξ̇ − τ ∂L/∂t."""
    s = system
    change = ca.dot(ca.gradient(s.lagrangian, s.q), xi) + ca.dot(s.momentum, rate(system, xi))
    return change - tau * ca.jacobian(s.lagrangian, s.t)


def rate(system: System, xi: ca.SX) -> ca.SX:
    """d/dt of an expression of q and t."""
    return ca.jtimes(xi, system.q, system.v) + ca.jacobian(xi, system.t)


def residual(region: Region, xi: ca.SX, tau: ca.SX, gauge: ca.SX, rng) -> tuple[float, Points]:
    """Largest |δL − d(τL + K)/dt| relative to its terms over random points, and the point where it occurs."""
    s = region.system
    terms = [
        ca.gradient(s.lagrangian, s.q) * xi,
        s.momentum * rate(s, xi),
        -tau * ca.jacobian(s.lagrangian, s.t),
        -ca.gradient(gauge, s.q) * s.v,
        -ca.jacobian(gauge, s.t),
    ]
    parts = ca.vertcat(*terms)
    least = LEAST_TERM * ca.norm_inf(xi) * (ca.sum1(ca.fabs(s.momentum * s.v)) + ca.fabs(s.lagrangian))
    size = ca.fmax(ca.sum1(ca.fabs(parts)), least)
    return _worst(region, at_points(s, "symmetry", [ca.sum1(parts), size]), rng)


def _worst(region: Region, function: ca.Function, rng) -> tuple[float, Points]:
    points, (left, size) = sampled(region, function, CHECKS, rng)
    ratio = np.abs(left).max(axis=1) / np.where(size[:, 0] > 0, size[:, 0], 1.0)
    worst = int(np.argmax(ratio))
    return float(ratio[worst]), points[worst : worst + 1]


def broken_by(region: Region, xi: ca.SX, tau: ca.SX, rng) -> tuple[str, ...]:
    """What in the scene, other than L, does not share the symmetry.

    Forces must do no work along ξ + τ v, non-holonomic reactions none along ξ; constraints and contacts must be
    invariant on their surfaces, and a shift of time needs elastic impacts.
    """
    s, structure = region.system, region.system.structure
    broken = []
    if structure.constraints and not _invariant(region, s.constraint, xi, tau, rng):
        broken.append("constraint")
    if structure.nonholonomic:
        works = [ca.mtimes(s.nonholonomic, xi), _product_size(s.nonholonomic, xi)]
        if _worst(region, at_points(s, "work", works), rng)[0] > TOLERANCE:
            broken.append("nonholonomic")
    if structure.forced:
        along = xi + tau * s.v
        works = [ca.dot(s.force, along), ca.dot(ca.fabs(s.force), ca.fabs(along))]
        if _worst(region, at_points(s, "work", works), rng)[0] > TOLERANCE:
            broken.append("force")
    if structure.contacts:
        free = all(_invariant(region, s.contact[i], xi, tau, rng) for i in range(structure.contacts))
        if not free or (not tau.is_zero() and (s.restitution < 1).any()):
            broken.append("contact")
    return tuple(broken)


def _product_size(rows: ca.SX, column: ca.SX) -> ca.SX:
    return ca.sum1(ca.mtimes(ca.fabs(rows), ca.fabs(column)))


def _invariant(region: Region, surface: ca.SX, xi: ca.SX, tau: ca.SX, rng) -> bool:
    """Whether ∂g/∂q ξ − τ ∂g/∂t = 0 where g = 0."""
    s = region.system
    slope, by_t = ca.jacobian(surface, s.q), ca.jacobian(surface, s.t)
    change = ca.mtimes(slope, xi) - tau * by_t
    size = _product_size(slope, xi) + ca.norm_1(ca.vec(tau * by_t))
    function = at_points(s, "invariance", [surface, slope, change, size])
    points, _ = sampled(region, function, CHECKS, rng)
    held = projected(points, function, surface.numel())
    _, _, left, total = over_columns(function, *held.columns)
    return bool((np.abs(left).max(axis=1) <= TOLERANCE * np.where(total[:, 0] > 0, total[:, 0], 1.0)).all())


def projected(points: Points, function: ca.Function, m: int) -> Points:
    """Those of the points that Gauss–Newton steps bring onto the surface g = 0; never none."""
    n = points.q.shape[1]
    q, t = points.q.copy(), points.t
    held = np.zeros(len(q), dtype=bool)
    for _ in range(MOST_PROJECTIONS):
        now, left = Points(q, points.v, points.a, points.u, t, points.c), np.flatnonzero(~held)
        g, slope, *_ = over_columns(function, *now[left].columns)
        good = np.isfinite(g).all(axis=1) & np.isfinite(slope).all(axis=1)
        g, slope = np.where(good[:, None], g, 0.0), np.where(good[:, None], slope, 0.0)
        held[left] = good & (np.abs(g).max(axis=1) <= ON_SURFACE * (1 + np.abs(q[left]).max(axis=1)))
        rows = slope.reshape(-1, n, m).transpose(0, 2, 1)
        q[left] -= np.einsum("snm,sm->sn", np.linalg.pinv(rows, rcond=1e-10), g)  # once more where it is held: free
        if held.all():
            break
    now = Points(q, points.v, points.a, points.u, t, points.c)
    if not held.any():
        raise InputError("no point was found where the constraints or contacts hold; give near=q close to one")
    return now[held]

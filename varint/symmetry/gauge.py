"""The gauge term K of a symmetry, δL = dK/dt, from exact derivatives of δL."""

from __future__ import annotations

import casadi as ca
import numpy as np

from varint.numerics.arrays import over_columns
from varint.symmetry.coefficients import parameter_samples, readable
from varint.symmetry.sampling import Region, at_points, sample
from varint.symmetry.verify import TOLERANCE, identities, is_balanced, residual, variation

ZERO = 1e-10  # of the largest coefficient


def quadratic_gauge(region: Region, xi: ca.SX, tau: ca.SX, rng: np.random.Generator) -> ca.SX:
    """K = (k + k' t)·q + ½ qᵀ(S + S' t) q + α t + β t² with δL = dK/dt, if there is one of this
    form; verify it.

    As δL = ∂K/∂t + v·∂K/∂q, its velocity gradient is ∂K/∂q; its Taylor polynomial gives the
    coefficients.
    """
    s = region.system
    if is_balanced(region, xi, tau, ca.SX(0)):
        return ca.SX(0)
    change = variation(s, xi, tau)
    slope = ca.gradient(change, s.v)
    curve = ca.jacobian(slope, s.q)
    taylor = [
        slope,
        ca.jacobian(slope, s.t),
        curve,
        _by_time(curve, s.t),
        change,
        ca.jacobian(change, s.t),
    ]
    origin = _expansion_point(region, taylor, rng)
    n = s.structure.n
    where = ca.vertcat(s.q, s.v, s.t)
    at = ca.vertcat(ca.SX(ca.DM(origin)), ca.SX.zeros(n + 1))
    taylor = ca.substitute(taylor, [where], [at])
    q0 = ca.DM(origin)
    k, k_t, curve, curve_t, rest, rest_t = taylor
    k, k_t = k - ca.mtimes(curve, q0), k_t - ca.mtimes(curve_t, q0)
    rest = rest - ca.dot(k_t, q0) - ca.dot(q0, ca.mtimes(curve_t, q0)) / 2
    k, k_t, curve, curve_t = _tidy(region, [k, k_t, curve, curve_t], rng)
    q, t = s.q, s.t
    gauge = ca.dot(k + k_t * t, q) + ca.dot(q, ca.mtimes(curve + curve_t * t, q)) / 2
    if is_balanced(region, xi, tau, gauge):
        return gauge
    rest, rest_t = _tidy(region, [rest, rest_t], rng)
    full = gauge + rest * t + rest_t * t**2 / 2
    if is_balanced(region, xi, tau, full):
        return full
    simplest = (ca.SX(0), gauge)
    return next((k for k in simplest if residual(region, xi, tau, k, rng)[0] <= TOLERANCE), full)


def _by_time(matrix: ca.SX, t: ca.SX) -> ca.SX:
    return ca.reshape(ca.jacobian(ca.vec(matrix), t), *matrix.shape)


def _expansion_point(region: Region, taylor: list[ca.SX], rng) -> np.ndarray:
    """The origin where everything is finite there (it reads best), otherwise a random point."""
    s = region.system
    function = at_points(s, "taylor", taylor)
    points, _ = sample(region, function, 4, rng)
    nowhere = np.zeros_like(points.q)
    values = over_columns(
        function, nowhere, nowhere, points.a, points.u, np.zeros_like(points.t), points.c
    )
    if all(np.isfinite(x).all() for x in values):
        return nowhere[0]
    for q in np.round(points.q, 2):
        start = np.tile(q, (len(points), 1))
        values = over_columns(
            function, start, nowhere, points.a, points.u, np.zeros_like(points.t), points.c
        )
        if all(np.isfinite(x).all() for x in values):
            return q
    return points.q[0]


def _tidy(region: Region, coefficients: list[ca.SX], rng) -> list[ca.SX]:
    """Coefficients that vanish or are numbers for all parameter values as such; the others as
    they are.
    """
    s = region.system
    c = parameter_samples(s, rng) if region.c is None else region.c[None]
    function = ca.Function("coefficients", [s.c], [ca.densify(x) for x in coefficients])
    values = over_columns(function, c)
    scale = max(np.abs(x).max(initial=0.0) for x in values)
    tidy = []
    for expression, table in zip(coefficients, values, strict=True):
        new = ca.SX(*expression.shape)
        size = np.abs(table).max(axis=0)
        present = np.flatnonzero(size)
        entries = [ca.SX(ca.vec(ca.densify(expression))[int(i)]) for i in present]
        exact = identities(region, entries or [ca.SX(0)])
        there = exact.rows.any(axis=0) & (exact.decided | (size[present] > ZERO * scale))
        for i in present[there[: len(present)]]:
            row, col = int(i) % expression.shape[0], int(i) // expression.shape[0]
            new[row, col] = readable(ca.SX(expression[row, col]), table[:, i], c, s.c)
        tidy.append(new)
    return tidy

"""The null space of generators: affine ξ = A q + b + c t and shifts of time that leave the Lagrangian's motion alone.

δL = ∂L/∂q·ξ + ∂L/∂v·ξ̇ − τ ∂L/∂t is a total derivative dK/dt if and only if its Euler–Lagrange expression vanishes
(Olver, Applications of Lie Groups to Differential Equations, §4.4, 5.3). With E = d/dt ∂L/∂v − ∂L/∂q that reads

    ∂E/∂q ξ + ∂E/∂v ξ̇ + ∂E/∂a ξ̈ + Aᵀ E − τ ∂E/∂t = 0   for all q, v, a, t:

linear in (τ, A, b, c), n equations a point, and free of the gauge term K.
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np

from varint.arrays import over_columns
from varint.errors import InputError
from varint.symmetry.sampling import Points, Region, at_points, draw, sampled
from varint.system import System, per_system

NULL = 1e-9  # singular values below this part of the largest one count as zero …
GAP = 30.0  # … and the next one must be larger by this factor
ABSENT = 1e-11  # a column this small, relative to the largest, is one of zeros
SURPLUS = 1.2  # equations per unknown
LEAST = 12  # points more than needed


Pairs = tuple[np.ndarray, np.ndarray]


def unknowns(system: System, groups: Sequence[Pairs]) -> int:
    """Number of unknowns: τ, the groups of entries of A, b and c."""
    return 1 + len(groups) + 2 * system.structure.n


@per_system
def euler_function(system: System) -> ca.Function:
    """(q, v, a, u, t, c) → E, ∂E/∂q, ∂E/∂v, ∂E/∂a, ∂E/∂t with E = d/dt ∂L/∂v − ∂L/∂q."""
    s, n = system, system.structure.n
    a = ca.SX.sym("a", n)
    p = s.momentum
    e = ca.jtimes(p, s.q, s.v) + ca.jtimes(p, s.v, a) + ca.jacobian(p, s.t) - ca.gradient(s.lagrangian, s.q)
    return at_points(s, "euler", [e, *(ca.jacobian(e, x) for x in (s.q, s.v, a, s.t))], a)


@per_system
def slopes_function(system: System) -> ca.Function:
    """(q, v, a, u, t, c) → ∂L/∂q, ∂L/∂v, ∂L/∂t."""
    s = system
    return at_points(s, "slopes", [ca.gradient(s.lagrangian, s.q), s.momentum, ca.jacobian(s.lagrangian, s.t)])


def null_space(region: Region, groups: Sequence[Pairs], rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Generators whose gauge term is at most quadratic in q, at one set of parameters: coefficients = size · basis.

    Returns
    -------
    basis : ndarray (unknowns, r)
        Columns, in units in which the unknowns are of like size.
    size : ndarray (unknowns,)
        Those units.
    """
    basis, size = _euler_null_space(region, groups, rng)
    if basis.shape[1]:
        basis = basis / np.linalg.norm(size[:, None] * basis, axis=0)
        rows = gauge_rows(region, groups, size[:, None] * basis, rng)
        _, values, vectors = np.linalg.svd(rows, full_matrices=False)
        basis = basis @ vectors[values <= NULL].T
    return basis, size


def _euler_null_space(region: Region, groups: Sequence[Pairs], rng: np.random.Generator):
    n, wanted = region.system.structure.n, unknowns(region.system, groups)
    rows = np.empty((0, wanted))
    for _ in range(3):
        count = int(np.ceil(SURPLUS * wanted / n)) + LEAST
        points, values = sampled(region, euler_function(region.system), count, rng)
        if not len(rows):
            size = units(groups, values[3].reshape(count, n, n))
        new = euler_rows(groups, points, values) * size
        new /= _nonzero(np.abs(new).max(axis=1, keepdims=True))
        rows = np.concatenate([rows, new])
        found = _kernel(rows)
        if found is not None:
            return found, size
    raise InputError(
        "the symmetries cannot be told from rounding errors: the Lagrangian's terms differ too much in size; choose "
        "units in which they are comparable, or check single generators with noether(system, xi)"
    )


def units(groups: Sequence[Pairs], mass: np.ndarray) -> np.ndarray:
    """Units of the unknowns in mass-weighted coordinates √M_ii q_i, where all of them are of like size."""
    inertia = np.abs(np.einsum("sii->si", mass)).mean(axis=0)
    weight = np.sqrt(np.where(inertia > 0, inertia, inertia.max(initial=0.0) or 1.0))
    matrix = [weight[j[0]] / weight[i[0]] for i, j in groups]
    return np.concatenate([[1.0], matrix, 1 / weight, 1 / weight])


def euler_rows(groups: Sequence[Pairs], points: Points, values: list[np.ndarray]) -> np.ndarray:
    """Equations of the unknowns (τ, A by groups, b, c), n at each point."""
    count, n = points.q.shape
    e, by_t = values[0], values[4]
    by_q, by_v, by_a = (x.reshape(count, n, n).transpose(0, 2, 1) for x in values[1:4])
    table = np.empty((count, n, 1 + len(groups) + 2 * n))
    table[:, :, 0] = -by_t
    for column, (i, j) in enumerate(groups, start=1):
        table[:, :, column] = sum(
            np.einsum("skj,sj->sk", d[:, :, i], x[:, j])
            for d, x in ((by_q, points.q), (by_v, points.v), (by_a, points.a))
        )
        table[:, j, column] += e[:, i]
    table[:, :, -2 * n : -n] = by_q
    table[:, :, -n:] = by_q * points.t[:, :, None] + by_v
    return table.reshape(count * n, -1)


def gauge_rows(region: Region, groups: Sequence[Pairs], basis: np.ndarray, rng) -> np.ndarray:
    """What vanishes if δL = dK/dt has K at most quadratic in q and linear in t (free terms: quadratic in t).

    δL = ∂K/∂t + v·∂K/∂q is then quadratic in q and affine in t, and its part odd in v affine in q: higher differences
    along random lines vanish. One column a basis vector, relative to the terms of δL.
    """
    s = region.system
    count = 2 * basis.shape[1] + 20
    function = slopes_function(s)
    rows = []
    for stencil in STENCILS:
        start, _ = sampled(region, function, count, rng)
        step = draw(region, count, rng)
        total, size = np.zeros((count, basis.shape[1])), np.zeros(count)
        for weight, along_q, along_t, sign in stencil:
            q, t = start.q + along_q * (step.q - start.q), start.t + along_t * step.t
            points = Points(q, sign * start.v, start.a, start.u, t, start.c)
            change, terms = _variation(groups, points, over_columns(function, *points.columns), basis)
            total, size = total + weight * change, size + abs(weight) * terms
        good = np.isfinite(total).all(axis=1) & np.isfinite(size)
        rows.append(total[good] / _nonzero(size[good])[:, None])
    return np.concatenate(rows)


# weights, and how far along the line of q, of t, and the sign of v
STENCILS = (
    tuple((w * sign, 0.3 * k, 0.0, sign) for k, w in enumerate((1, -2, 1)) for sign in (1, -1)),
    tuple((w, 0.3 * k, 0.0, 1) for k, w in enumerate((1, -3, 3, -1))),
    tuple((w, 0.0, 0.3 * k, 1) for k, w in enumerate((1, -2, 1))),
)


def _variation(groups, points: Points, values: list[np.ndarray], basis: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """δL of every basis vector at every point, (N, r), and the size of its terms, (N,)."""
    force, momentum, by_t = values
    n = points.q.shape[1]
    table = np.empty((len(points), len(basis)))
    table[:, 0] = -by_t[:, 0]
    for column, (i, j) in enumerate(groups, start=1):
        table[:, column] = (force[:, i] * points.q[:, j] + momentum[:, i] * points.v[:, j]).sum(axis=1)
    table[:, -2 * n : -n] = force
    table[:, -n:] = force * points.t + momentum
    return table @ basis, np.abs(table).max(axis=1)


def _kernel(rows: np.ndarray) -> np.ndarray | None:
    """Null space of a tall matrix, columns; None where no gap tells zero from non-zero singular values."""
    size = np.sqrt((rows**2).mean(axis=0))
    size = np.where(size > ABSENT * size.max(initial=0.0), size, 1.0)  # rounding errors of zeros stay small
    _, values, vectors = np.linalg.svd(np.linalg.qr(rows / size, mode="r"))
    scale = max(values[0], 1.0)
    small = values <= NULL * scale
    if values[~small].min(initial=np.inf) < GAP * NULL * scale:
        return None
    return vectors[small].T / size[:, None]


def _nonzero(x: np.ndarray) -> np.ndarray:
    return np.where(x > 0, x, 1.0)

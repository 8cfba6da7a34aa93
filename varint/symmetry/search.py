"""The null space of generators: affine ξ = A q + b + c t and shifts of time that leave the
Lagrangian's motion alone.

δL = ∂L/∂q·ξ + ∂L/∂v·ξ̇ − τ ∂L/∂t is a total derivative dK/dt if and only if its Euler–Lagrange
expression vanishes (Olver, Applications of Lie Groups to Differential Equations, §4.4, 5.3). With E
= d/dt ∂L/∂v − ∂L/∂q that reads

    ∂E/∂q ξ + ∂E/∂v ξ̇ + ∂E/∂a ξ̈ + Aᵀ E − τ ∂E/∂t = 0   for all q, v, a, t:

linear in (τ, A, b, c), n equations a point, and free of the gauge term K.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import casadi as ca
import numpy as np

from varint.errors import InputError
from varint.numerics.arrays import over_columns
from varint.scene.memory import per_system
from varint.scene.system import System
from varint.symmetry import finite_field
from varint.symmetry.identities import Evaluated, P, evaluate
from varint.symmetry.sampling import Points, Region, at_points, draw, sample

MOST_EXACT = 110  # unknowns of an exact search: nine coordinates
NULL = 1e-9  # singular values below this part of the largest one count as zero …
GAP = 30.0  # … and the next one must be larger by this factor
ABSENT = 1e-11  # a column this small, relative to the largest, is one of zeros
LIGHTEST = 1e-6  # of the largest inertia: below it, units of length are not told by the masses
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
    e = (
        ca.jtimes(p, s.q, s.v)
        + ca.jtimes(p, s.v, a)
        + ca.jacobian(p, s.t)
        - ca.gradient(s.lagrangian, s.q)
    )
    return at_points(s, "euler", [e, *(ca.jacobian(e, x) for x in (s.q, s.v, a, s.t))], a)


@per_system
def slopes_function(system: System) -> ca.Function:
    """(q, v, a, u, t, c) → ∂L/∂q, ∂L/∂v, ∂L/∂t."""
    s = system
    return at_points(
        s, "slopes", [ca.gradient(s.lagrangian, s.q), s.momentum, ca.jacobian(s.lagrangian, s.t)]
    )


class NullSpace(NamedTuple):
    """Generators with coefficients = size · basis.

    Attributes
    ----------
    basis : ndarray (unknowns, r)
        Columns, in units in which the unknowns are of like size.
    left_out : int
        Generators with coefficients that only an exact search could tell, and did not.
    size : ndarray (unknowns,)
        Those units.
    """

    basis: np.ndarray
    left_out: int
    size: np.ndarray


class ExactSpace(NamedTuple):
    """Generators (unknowns, r) with simple fractions as coefficients; the number of others; and
    whether no constant with rounding errors may have broken one.
    """

    basis: np.ndarray
    left_out: int
    decided: bool


def null_space(region: Region, groups: Sequence[Pairs], rng: np.random.Generator) -> NullSpace:
    """Generators whose gauge term is at most quadratic in q, at one set of parameters."""
    basis, left_out, size = _euler_null_space(region, groups, rng)
    if basis.shape[1]:
        basis = basis / np.linalg.norm(size[:, None] * basis, axis=0)
        rows = gauge_rows(region, groups, size[:, None] * basis, rng)
        _, values, vectors = np.linalg.svd(rows, full_matrices=False)
        basis = basis @ vectors[values <= NULL].T
    return NullSpace(basis, left_out, size)


def _euler_null_space(
    region: Region, groups: Sequence[Pairs], rng: np.random.Generator
) -> NullSpace:
    n, wanted = region.system.structure.n, unknowns(region.system, groups)
    rows = np.empty((0, wanted))
    for _ in range(3):
        count = int(np.ceil(SURPLUS * wanted / n)) + LEAST
        points, values = sample(region, euler_function(region.system), count, rng)
        if not len(rows):
            size = units(groups, values[3].reshape(count, n, n))
        new = euler_rows(groups, points, values) * size
        new /= _nonzero(np.abs(new).max(axis=1, keepdims=True))
        rows = np.concatenate([rows, new])
        found = _kernel(rows)
        if found is not None:
            basis, left_out = _with_exact(found, region, groups, size)
            return NullSpace(basis, left_out, size)
    exact = exact_null_space(region, groups)
    if exact is not None:
        return NullSpace(exact.basis / size[:, None], exact.left_out, size)
    raise InputError(
        "the symmetries cannot be told from rounding errors: the Lagrangian's terms differ too "
        "much in size; choose units in which they are comparable, or check single generators with "
        "noether(system, xi)"
    )


def exactly(region: Region, function: ca.Function) -> Evaluated:
    """A function (q, v, a, u, t, c) at points without rounding; parameters are positive as their
    defaults are.
    """
    positive = bool((region.system.default_vector > 0).all())
    return evaluate(function, [*[None] * 5, region.c], positive)


def exact_null_space(region: Region, groups: Sequence[Pairs]) -> ExactSpace | None:
    """The same without rounding, in integers modulo a prime: neither a well far away nor a body of
    1e-30 is overlooked.

    None with functions whose rules are not known, or with too many unknowns.
    """
    s, n = region.system, region.system.structure.n
    if (region.c is None and s.c.numel()) or unknowns(s, groups) > MOST_EXACT:
        return None
    a = ca.SX.sym("a", n)
    e, by_q, by_v, by_a, by_t = euler_function(s).call([s.q, s.v, a, s.control, s.t, s.c])
    columns = [-by_t]
    for i, j in groups:
        column = ca.SX.zeros(n)
        for k, x in zip(i.tolist(), j.tolist(), strict=True):
            column += by_q[:, k] * s.q[x] + by_v[:, k] * s.v[x] + by_a[:, k] * a[x]
            column[x] += e[k]
        columns.append(column)
    table = ca.densify(ca.horzcat(*columns, by_q, by_q * s.t + by_v))
    function = at_points(s, "rows", [table], a)
    values = exactly(region, function).values
    if not values.ruled:
        return None
    few = values.rows[: max(2 * table.shape[1] // n, 1) + LEAST]
    rows = few.reshape(len(few), -1, n).transpose(0, 2, 1).reshape(-1, table.shape[1])
    basis, _ = finite_field.null_space(rows, P)
    columns = [[finite_field.reconstruct(int(x), P) for x in column] for column in basis.T]
    simple = [column for column in columns if all(x is not None for x in column)]
    basis = np.array(simple, dtype=float).reshape(-1, table.shape[1]).T
    return ExactSpace(basis, len(columns) - len(simple), values.decided)


def _with_exact(found: np.ndarray, region: Region, groups, size: np.ndarray):
    """The exact null space where it is smaller, and how many of its generators are left out as no
    simple fractions.
    """
    exact = exact_null_space(region, groups) if found.shape[1] else None
    if exact is None or not exact.decided:
        return found, 0
    if exact.basis.shape[1] + exact.left_out >= found.shape[1]:
        return found, 0
    return exact.basis / size[:, None], exact.left_out


def units(groups: Sequence[Pairs], mass: np.ndarray) -> np.ndarray:
    """Units of the unknowns in mass-weighted coordinates √M_ii q_i, where all of them are of
    like size.

    What is lighter than `LIGHTEST` is a test particle: it moves over the same distances as the
    others, and what its motion adds to theirs, A_ij with j light, is smaller by its mass.
    """
    inertia = np.abs(np.einsum("sii->si", mass)).mean(axis=0)
    inertia = inertia / (inertia.max(initial=0.0) or 1.0)
    inertia = np.where(inertia > 0, inertia, 1.0)
    light = np.minimum(inertia / LIGHTEST, 1.0)
    weight = np.sqrt(inertia / light)
    matrix = [weight[j[0]] / weight[i[0]] * min(light[j[0]] / light[i[0]], 1.0) for i, j in groups]
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
    """What vanishes if δL = dK/dt has K at most quadratic in q and linear in t (free terms:
    quadratic in t).

    δL = ∂K/∂t + v·∂K/∂q is then quadratic in q and affine in t, and its part odd in v affine in q:
    higher differences along random lines vanish. One column a basis vector, relative to the terms
    of δL.
    """
    s = region.system
    count = 2 * basis.shape[1] + 20
    function = slopes_function(s)
    rows = []
    for stencil in STENCILS:
        start, _ = sample(region, function, count, rng)
        step = draw(region, count, rng)
        total, size = np.zeros((count, basis.shape[1])), np.zeros(count)
        for weight, along_q, along_t, sign in stencil:
            q, t = start.q + along_q * (step.q - start.q), start.t + along_t * step.t
            points = Points(q, sign * start.v, start.a, start.u, t, start.c)
            change, terms = _variation(
                groups, points, over_columns(function, *points.columns), basis
            )
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


def _variation(
    groups, points: Points, values: list[np.ndarray], basis: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """δL of every basis vector at every point, (N, r), and the size of its terms, (N,)."""
    force, momentum, by_t = values
    n = points.q.shape[1]
    table = np.empty((len(points), len(basis)))
    table[:, 0] = -by_t[:, 0]
    for column, (i, j) in enumerate(groups, start=1):
        table[:, column] = (force[:, i] * points.q[:, j] + momentum[:, i] * points.v[:, j]).sum(
            axis=1
        )
    table[:, -2 * n : -n] = force
    table[:, -n:] = force * points.t + momentum
    return table @ basis, np.abs(table).max(axis=1)


def _kernel(rows: np.ndarray) -> np.ndarray | None:
    """Null space of a tall matrix, columns; None where no gap tells zero from non-zero singular
    values.
    """
    size = np.sqrt((rows**2).mean(axis=0))
    # rounding errors of zeros stay small
    size = np.where(size > ABSENT * size.max(initial=0.0), size, 1.0)
    _, values, vectors = np.linalg.svd(np.linalg.qr(rows / size, mode="r"))
    scale = max(values[0], 1.0)
    small = values <= NULL * scale
    if values[~small].min(initial=np.inf) < GAP * NULL * scale:
        return None
    return vectors[small].T / size[:, None]


def _nonzero(x: np.ndarray) -> np.ndarray:
    return np.where(x > 0, x, 1.0)

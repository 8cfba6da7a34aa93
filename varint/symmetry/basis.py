"""A readable basis of generators: reduced echelon form, simple fractions, coefficients as
functions of parameters.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from varint.symmetry.coefficients import as_monomial, simple, solve_coefficients
from varint.symmetry.independent import SAME, list_independent, orthonormal, products
from varint.symmetry.naming import particles
from varint.symmetry.sampling import Region, random_parameters, sample
from varint.symmetry.search import Pairs, euler_function, euler_rows, gauge_rows, null_space
from varint.symmetry.shared import conditions, conditions_kernel

SMALL = 1e-6  # coefficients below it are rounding errors of the null space
# relative: the exact solution of some of the equations is the generator found from all of them
AGREES = 1e-6
MOST_BROKEN = 20  # symmetries of L that are listed although the scene breaks them
# residual, relative to its terms, of a generator that is a symmetry; verified more sharply
# afterwards
HOLDS = 1e-7


@dataclass(frozen=True, eq=False)
class Found:
    """Coefficient lists (τ, A by groups, b, c) of generators, and how many more there are.

    `dependent` ones conserve functions of the others' quantities; for `unrecognised` ones no
    coefficients were found that hold for all parameters; `left_out` are linear ones that the rest
    of the scene breaks, where there are many. Of these together `unclear` combinations are shared
    by the rest of the scene, but not listed as such.
    """

    vectors: list[list]
    dependent: int
    unrecognised: int
    left_out: int = 0
    unclear: int = 0

    @property
    def dimension(self) -> int:
        return len(self.vectors) + self.dependent + self.unrecognised + self.left_out


def generators(region: Region, groups: Sequence[Pairs], rng: np.random.Generator) -> Found:
    """Basis of the affine generators.

    With parameter values given in `region` the coefficients are numbers. Otherwise they hold for
    all values: numbers, and functions of the parameters such as Ω or m1/(m1 + m2).
    """
    s = region.system
    order = _order(s.structure.n, groups)
    fixed = region.c is not None or not s.c.numel()
    here = Region(
        s, region.c if region.c is not None else random_parameters(s, rng, 1)[0], region.near
    )
    basis, hidden, size = null_space(here, groups, rng)
    rows, pivots = reduce_generators(basis, size, order)
    turns, kept, dependent = list_independent(here, groups, rows, size, particles(s.names), rng)
    constant = (
        np.ones(len(kept), dtype=bool)
        if fixed
        else _hold_everywhere(region, groups, rows[kept], rng)
    )
    plain = np.concatenate([turns, rows[kept[constant]]])
    found = [(row, [simple(x) for x in row]) for row in plain]
    for i in kept[~constant]:
        coefficients = solve_coefficients(here, groups, rows[i], size, pivots[i], rng)
        values = np.array(ca.Function("at", [s.c], [ca.vertcat(*coefficients)])(here.c)).ravel()
        if np.abs((values - rows[i]) / size).max() <= AGREES * np.abs(rows[i] / size).max():
            found.append((rows[i], coefficients))
    lost = hidden + len(turns) + len(kept) - len(found)
    more = (
        s.structure.constraints
        or s.structure.nonholonomic
        or s.structure.forced
        or s.structure.contacts
    )
    if found and more:
        found, left_out, unclear = _add_shared(
            region, here, groups, found, len(turns), (basis, size, order), rng
        )
        return Found([x for _, x in found], dependent, lost, left_out, unclear)
    return Found([x for _, x in found], dependent, lost)


def _add_shared(
    region: Region, here: Region, groups: Sequence[Pairs], found: list, turns: int, space, rng
):
    """The generators with combinations of them that the rest of the scene shares in place of ones
    that it breaks.

    Where it breaks many, the linear ones among these are left out, but for the first `turns`. Also
    returned: how many these are, and of how many combinations the coefficients depend on the
    parameters unclearly.
    """
    basis, size, order = space
    n = here.system.structure.n
    shared = basis @ conditions_kernel(here, groups, size[:, None] * basis, rng)
    rows = np.array([row / size for row, _ in found]).reshape(len(found), len(size))
    span = orthonormal(shared.T)
    off = np.linalg.norm(rows - (rows @ span.T) @ span, axis=1)
    kept = [int(i) for i in np.flatnonzero(off <= SAME * np.linalg.norm(rows, axis=1))]
    flat = [i for i in kept if not np.abs(rows[i, 1 : -2 * n]).max(initial=0.0)]
    follow = products(here, rows[flat] * size, n, rng) if len(groups) == n * n else []
    known = [*rows[kept], *(x / size for x in follow)]
    reduced_rows, pivots = reduce_generators(shared, size, order)
    more = [k for k, _ in _add_generators(known, reduced_rows / size)]
    extra, unclear = [], 0
    if more:
        extra, unclear = _for_all_parameters(
            region, here, groups, reduced_rows[more], pivots, more, order, rng
        )
    taken = [*rows[kept], *(row / size for row, _ in extra)]
    broken = [i for i in range(len(found)) if i not in kept]
    broken = [broken[k] for k, _ in _add_generators(taken, rows[broken])]
    few = broken
    if len(broken) > MOST_BROKEN:
        few = [i for i in broken if i < turns or not np.abs(rows[i, 1 : -2 * n]).max(initial=0.0)]
    return (
        [*(found[i] for i in kept), *extra, *(found[i] for i in few)],
        len(broken) - len(few),
        unclear,
    )


def _add_generators(known: list[np.ndarray], rows: np.ndarray) -> list[tuple[int, np.ndarray]]:
    """Numbers of the rows, and they, that are independent of what is known and of the rows taken
    before.
    """
    taken: list[tuple[int, np.ndarray]] = []
    span = orthonormal(np.array(known).reshape(len(known), rows.shape[1]))
    for k, row in enumerate(rows):
        rest = row - span.T @ (span @ row)
        rest -= span.T @ (span @ rest)
        if np.linalg.norm(rest) > SAME * np.linalg.norm(row):
            taken.append((k, row))
            span = np.vstack([span, rest / np.linalg.norm(rest)])
    return taken


def _for_all_parameters(
    region: Region, here: Region, groups, rows: np.ndarray, pivots, which: list[int], order, rng
):
    """(row, coefficients) of combinations that are shared, and of how many the coefficients were
    not recognised.
    """
    s = here.system
    if region.c is not None or not s.c.numel():
        return [(row, [simple(x) for x in row]) for row in rows], 0
    constant = _hold_everywhere(region, groups, rows, rng)
    constant &= np.abs(conditions(region, groups, rows.T, rng)).max(axis=0, initial=0.0) <= HOLDS
    found: list[tuple[np.ndarray, list]] = [
        (row, [simple(x) for x in row]) for row in rows[constant]
    ]
    if constant.all():
        return found, 0
    tables, c = [], random_parameters(s, rng, s.c.numel() + 4)
    for values in c:
        there = Region(s, values, region.near)
        basis, _, size = null_space(there, groups, rng)
        again, at = reduce_generators(
            basis @ conditions_kernel(there, groups, size[:, None] * basis, rng), size, order
        )
        if at != pivots:
            return found, int((~constant).sum())
        tables.append(again[which])
    for i in np.flatnonzero(~constant):
        coefficients = [as_monomial(y, c, s.c) for y in np.array([table[i] for table in tables]).T]
        if all(x is not None for x in coefficients):
            found.append((rows[i], coefficients))
    return found, len(rows) - len(found)


def _order(n: int, groups: Sequence[Pairs]) -> list[int]:
    """Columns in the order in which they become pivots: time, rotations, scalings, translations,
    boosts.
    """

    def rank(column: int) -> tuple[int, int]:
        i, j = groups[column - 1][0][0], groups[column - 1][1][0]
        return (0 if i > j else 1 if i == j else 2), column

    first = 1 + len(groups)
    return [0, *sorted(range(1, first), key=rank), *range(first, first + 2 * n)]


def reduce_generators(
    basis: np.ndarray, size: np.ndarray, order: list[int]
) -> tuple[np.ndarray, tuple[int, ...]]:
    """Reduced echelon form of size · basis (columns), as rows, with pivots taken in the given order
    of columns.

    Elimination and the removal of rounding errors are done on the basis, whose entries are of like
    size.
    """
    rows = basis.T.copy()
    pivots: list[int] = []
    for column in order:
        k = len(pivots)
        if k == len(rows):
            break
        best = k + int(np.argmax(np.abs(rows[k:, column])))
        if abs(rows[best, column]) < SMALL * np.abs(rows[best]).max():
            continue
        rows[[k, best]] = rows[[best, k]]
        rows[k] /= rows[k, column]
        others = np.arange(len(rows)) != k
        rows[others] -= np.outer(rows[others, column], rows[k])
        pivots.append(column)
    rows[np.abs(rows) < SMALL * np.abs(rows).max(axis=1, keepdims=True, initial=0.0)] = 0.0
    units = size[pivots][:, None] if pivots else 1.0
    return rows * size / units, tuple(pivots)


def _hold_everywhere(region: Region, groups: Sequence[Pairs], rows: np.ndarray, rng) -> np.ndarray:
    """Which rows are symmetries with a gauge term as wanted at points with parameter values of
    their own.
    """
    points, values = sample(region, euler_function(region.system), 20, rng)
    equations = euler_rows(groups, points, values)
    sizes = np.abs(equations) @ np.abs(rows.T)
    left = np.abs(equations @ rows.T) / np.where(sizes > 0, sizes, 1.0)
    scaled = rows / np.linalg.norm(rows, axis=1, keepdims=True)
    gauge = np.abs(gauge_rows(region, groups, scaled.T, rng)).max(axis=0)
    return (left.max(axis=0) <= HOLDS) & (gauge <= HOLDS)

"""A readable basis of generators: reduced echelon form, simple fractions, coefficients as functions of parameters."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import combinations

import casadi as ca
import numpy as np

from varint.symmetry.independent import listed
from varint.symmetry.naming import particles
from varint.symmetry.sampling import Region, random_parameters, sampled
from varint.symmetry.search import Pairs, euler_function, euler_rows, gauge_rows, null_space

SMALL = 1e-6  # coefficients below it are rounding errors of the null space
SIMPLE = ((6, 1e-7), (1000, 1e-9))  # denominators, and how close to such a fraction a coefficient is that fraction
CLOSE = 1e-8  # values this close are the same; what is made of them is verified afterwards
HOLDS = 1e-7  # residual, relative to its terms, of a generator that is a symmetry; verified more sharply afterwards
MOST_IN_PRODUCTS = 12  # parameters, for sums of products of two
MOST_PARAMETERS = 30  # one null space is needed for each when coefficients depend on them


@dataclass(frozen=True, eq=False)
class Found:
    """Coefficient lists (τ, A by groups, b, c) of generators, and how many more there are.

    `dependent` ones conserve functions of the others' quantities; `unrecognised` ones have coefficients that are no
    monomials of the parameters.
    """

    vectors: list[list]
    dependent: int
    unrecognised: int

    @property
    def dimension(self) -> int:
        return len(self.vectors) + self.dependent + self.unrecognised


def generators(region: Region, groups: Sequence[Pairs], rng: np.random.Generator) -> Found:
    """Basis of the affine generators.

    With parameter values given in `region` the coefficients are numbers. Otherwise they hold for all values: numbers,
    or monomials such as Ω or m1/m2.
    """
    s = region.system
    order = _order(s.structure.n, groups)
    fixed = region.c is not None or not s.c.numel()
    values = region.c[None] if region.c is not None else random_parameters(s, rng, s.c.numel() + 4)
    here = Region(s, values[0], region.near)
    basis, size = null_space(here, groups, rng)
    rows, pivots = reduced(basis, size, order)
    turns, kept, dependent = listed(here, groups, rows, size, particles(s.names), rng)
    found: list[list] = [[simple(x) for x in row] for row in turns]
    constant = np.ones(len(kept), dtype=bool) if fixed else _hold_everywhere(region, groups, rows[kept], rng)
    found += [[simple(x) for x in row] for row in rows[kept[constant]]]
    varying = kept[~constant]
    if not len(varying) or s.c.numel() > MOST_PARAMETERS:
        return Found(found, dependent, len(varying))
    tables = [rows]
    for c in values[1:]:
        more, at = reduced(*null_space(Region(s, c, region.near), groups, rng), order)
        if at != pivots:
            return Found(found, dependent, len(varying))
        tables.append(more)
    for i in varying:
        coefficients = [as_monomial(y, values, s.c) for y in np.array([table[i] for table in tables]).T]
        if all(x is not None for x in coefficients):
            found.append(coefficients)
    return Found(found, dependent, len(turns) + len(kept) - len(found))


def _order(n: int, groups: Sequence[Pairs]) -> list[int]:
    """Columns in the order in which they become pivots: time, rotations, scalings, translations, boosts."""

    def rank(column: int) -> tuple[int, int]:
        i, j = groups[column - 1][0][0], groups[column - 1][1][0]
        return (0 if i > j else 1 if i == j else 2), column

    first = 1 + len(groups)
    return [0, *sorted(range(1, first), key=rank), *range(first, first + 2 * n)]


def reduced(basis: np.ndarray, size: np.ndarray, order: list[int]) -> tuple[np.ndarray, tuple[int, ...]]:
    """Reduced echelon form of size · basis (columns), as rows, with pivots taken in the given order of columns.

    Elimination and the removal of rounding errors are done on the basis, whose entries are of like size.
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


def simple(x: float) -> float:
    """x, or the simple fraction that it is up to rounding: the simpler, the more rounding is allowed."""
    for denominator, close in SIMPLE:
        fraction = float(Fraction(float(x)).limit_denominator(denominator))
        if abs(fraction - x) <= close * abs(x):
            return fraction
    return float(x)


def as_monomial(y: np.ndarray, c: np.ndarray, symbols: ca.SX) -> ca.SX | float | None:
    """The function f c_1^{e_1} c_2^{e_2} … with values y at the parameters c, exponents multiples of ½; or None."""
    if np.ptp(y) <= CLOSE * np.abs(y).max():
        return simple(float(y.mean()))
    used = np.ptp(c, axis=0) > 0
    if (y == 0).any() or not (c[:, used] != 0).all():
        return None
    matrix = np.column_stack([np.log(np.abs(c[:, used])), np.ones(len(c))])
    found = np.linalg.lstsq(matrix, np.log(np.abs(y)), rcond=None)[0]
    exponents = np.round(2 * found[:-1]) / 2
    if np.abs(exponents - found[:-1]).max() > 1e-5:
        return None
    with np.errstate(invalid="ignore"):
        ratio = y / np.prod(c[:, used] ** exponents, axis=1)
    if not np.ptp(ratio) <= CLOSE * np.abs(ratio).max():
        return None
    product = ca.SX(simple(float(ratio.mean())))
    for symbol, e in zip(np.array(ca.vertsplit(symbols), dtype=object)[used], exponents, strict=True):
        if e:
            product *= symbol ** (int(e) if e == int(e) else float(e))
    return product


def products(symbols: ca.SX) -> list[tuple[int, ...]]:
    """Parameters and products of two, by number; none where there are too many."""
    n = symbols.numel()
    return [(i,) for i in range(n)] + list(combinations(range(n), 2)) if n <= MOST_IN_PRODUCTS else []


def as_products(y: np.ndarray, c: np.ndarray, symbols: ca.SX) -> ca.SX | None:
    """The sum of parameters and products of two with simple coefficients that has the values y; or None."""
    terms = products(symbols)
    if len(y) <= len(terms) or not terms:
        return None
    table = np.array([[np.prod(row[list(term)]) for term in terms] for row in c])
    size = np.abs(table).max(axis=0)
    size[size == 0] = 1.0
    found = np.linalg.lstsq(table / size, y, rcond=None)[0]
    found[np.abs(found) < CLOSE * np.abs(found).max()] = 0.0
    factors = np.array([simple(x) for x in found / size])
    if np.abs(table @ factors - y).max() > CLOSE * np.abs(y).max():
        return None
    return sum((ca.SX(f) * _product(symbols, term) for f, term in zip(factors, terms, strict=True) if f), ca.SX(0))


def _product(symbols: ca.SX, term: tuple[int, ...]) -> ca.SX:
    return symbols[term[0]] if len(term) == 1 else symbols[term[0]] * symbols[term[1]]


def _hold_everywhere(region: Region, groups: Sequence[Pairs], rows: np.ndarray, rng) -> np.ndarray:
    """Which rows are symmetries with a gauge term as wanted at points with parameter values of their own."""
    points, values = sampled(region, euler_function(region.system), 20, rng)
    equations = euler_rows(groups, points, values)
    sizes = np.abs(equations) @ np.abs(rows.T)
    left = np.abs(equations @ rows.T) / np.where(sizes > 0, sizes, 1.0)
    scaled = rows / np.linalg.norm(rows, axis=1, keepdims=True)
    gauge = np.abs(gauge_rows(region, groups, scaled.T, rng)).max(axis=0)
    return (left.max(axis=0) <= HOLDS) & (gauge <= HOLDS)

"""Coefficients of generators as functions of the parameters: numbers, monomials, sums, ratios,
or exact solutions.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from fractions import Fraction
from itertools import combinations, combinations_with_replacement

import casadi as ca
import numpy as np

from varint.numerics.arrays import over_columns
from varint.scene.system import System
from varint.symmetry.sampling import Points, Region, random_parameters, sample
from varint.symmetry.search import Pairs, euler_function, euler_rows

# denominators, and how close to such a fraction a coefficient is that fraction
SIMPLE = (
    (6, 1e-7),
    (1000, 1e-9),
)
CLOSE = 1e-8  # values this close are the same; what is made of them is verified afterwards
MOST_IN_PRODUCTS = 12  # parameters, for sums of products of two
MOST_IN_RATIOS = 5  # parameters of one coefficient
ZERO = 1e-10  # singular values of a fit below this part of the largest count as zero
SPARE = 12  # values more than unknowns of a fit
MOST_POINTS = 40  # among which the equations of one generator are chosen

Fit = Callable[[np.ndarray, np.ndarray, ca.SX], "ca.SX | float | None"]


def simple(x: float) -> float:
    """x, or the simple fraction that it is up to rounding: the simpler, the more rounding is
    allowed.
    """
    for denominator, close in SIMPLE:
        fraction = float(Fraction(float(x)).limit_denominator(denominator))
        if abs(fraction - x) <= close * abs(x):
            return fraction
    return float(x)


def as_monomial(y: np.ndarray, c: np.ndarray, symbols: ca.SX) -> ca.SX | float | None:
    """The function f c_1^{e_1} c_2^{e_2} … with values y at the parameters c, exponents
    multiples of ½; or None.
    """
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
    for symbol, e in zip(
        np.array(ca.vertsplit(symbols), dtype=object)[used], exponents, strict=True
    ):
        if e:
            product *= symbol ** (int(e) if e == int(e) else float(e))
    return product


def products(symbols: ca.SX) -> list[tuple[int, ...]]:
    """Parameters and products of two, by number; none where there are too many."""
    n = symbols.numel()
    return (
        [(i,) for i in range(n)] + list(combinations(range(n), 2)) if n <= MOST_IN_PRODUCTS else []
    )


def as_products(y: np.ndarray, c: np.ndarray, symbols: ca.SX) -> ca.SX | None:
    """The sum of parameters and products of two with simple coefficients that has the values y;
    or None.
    """
    terms = products(symbols)
    if len(y) <= len(terms) or not terms:
        return None
    table = _values(terms, c)
    size = np.abs(table).max(axis=0)
    size[size == 0] = 1.0
    found = np.linalg.lstsq(table / size, y, rcond=None)[0]
    found[np.abs(found) < CLOSE * np.abs(found).max()] = 0.0
    factors = np.array([simple(x) for x in found / size])
    if np.abs(table @ factors - y).max() > CLOSE * np.abs(y).max():
        return None
    return _sum(factors, terms, symbols)


def as_ratio(y: np.ndarray, c: np.ndarray, symbols: ca.SX) -> ca.SX | None:
    """P/Q or ±√(P/Q) with P and Q sums of parameters, or of products of two, that has the values
    y; or None.
    """
    used = [i for i in range(c.shape[1]) if np.ptp(c[:, i]) > 0]
    if not 0 < len(used) <= MOST_IN_RATIOS or not np.isfinite(y).all():
        return None
    linear: list[tuple[int, ...]] = [(i,) for i in used]
    square: list[tuple[int, ...]] = list(combinations_with_replacement(used, 2))
    kinds: list[list[tuple[int, ...]]] = [linear, square, [(), *linear], [(), *linear, *square]]
    for power in (1, 2):
        for top, bottom in ((0, 0), (1, 0), (0, 1), (2, 2), (1, 1), (3, 3)):
            found = _quotient(y**power, c, kinds[top], kinds[bottom], symbols)
            if found is None:
                continue
            if power == 1:
                return found
            if (y > 0).all() or (y < 0).all():
                return ca.sqrt(found) * (1 if y[0] > 0 else -1)
    return None


def _quotient(
    y: np.ndarray, c: np.ndarray, top: list, bottom: list, symbols: ca.SX
) -> ca.SX | None:
    if len(y) < len(top) + len(bottom) + SPARE:
        return None
    above, below = _values(top, c), _values(bottom, c)
    table = np.hstack([above, -y[:, None] * below])
    size = np.abs(table).max(axis=0)
    size[size == 0] = 1.0
    _, values, vectors = np.linalg.svd(table / size)
    if not (values[-1] <= ZERO * values[0] and values[-2] > CLOSE * values[0]):  # one solution
        return None
    found = vectors[-1] / size
    found[np.abs(vectors[-1]) < CLOSE * np.abs(vectors[-1]).max()] = 0.0
    down = found[len(top) :]
    first = down[np.flatnonzero(down)[0]] if down.any() else 0.0
    if not first:
        return None
    factors = np.array([simple(x) for x in found / first])
    up, down = factors[: len(top)], factors[len(top) :]
    with np.errstate(divide="ignore", invalid="ignore"):
        if not np.abs((above @ up) / (below @ down) - y).max() <= CLOSE * np.abs(y).max():
            return None
    return _sum(up, top, symbols) / _sum(down, bottom, symbols)


def _values(terms: list[tuple[int, ...]], c: np.ndarray) -> np.ndarray:
    return np.array([[np.prod(row[list(term)]) for term in terms] for row in c])


def _sum(factors: np.ndarray, terms: list[tuple[int, ...]], symbols: ca.SX) -> ca.SX:
    total = ca.SX(0)
    for factor, term in zip(factors, terms, strict=True):
        if factor:
            total += ca.SX(float(factor)) * _product(symbols, term)
    return total


def _product(symbols: ca.SX, term: tuple[int, ...]) -> ca.SX:
    value = ca.SX(1)
    for i in term:
        value *= symbols[i]
    return value


def parameter_samples(system: System, rng: np.random.Generator) -> np.ndarray:
    """Enough parameter values to recognise a function of them."""
    size = system.c.numel()
    most = min(size, MOST_IN_RATIOS)
    enough = size + 4, 2 * (1 + most + most * (most + 1) // 2) + SPARE, len(products(system.c)) + 4
    return random_parameters(system, rng, max(enough))


def readable(expression: ca.SX, y: np.ndarray, c: np.ndarray, symbols: ca.SX) -> ca.SX | float:
    """A function of the parameters, with values y at c, in a readable form; as it is where none
    is found.
    """
    if not np.isfinite(y).all():  # the equations were singular: there is nothing to recognise
        return expression
    matters = np.array(
        [ca.depends_on(expression, symbol) for symbol in ca.vertsplit(symbols)], dtype=bool
    )
    fits: Sequence[Fit] = (as_monomial, as_products, as_ratio)
    for fit in fits:
        found = fit(y, np.where(matters, c, c[:1]), symbols)
        if found is not None:
            return found
    return expression


def solve_coefficients(
    region: Region, groups: Sequence[Pairs], row: np.ndarray, size: np.ndarray, pivot: int, rng
) -> list:
    """The generator `row` (its pivot 1, known at one set of parameters) with coefficients exact for
    all of them.

    What is not zero beside the pivot solves as many of the equations, at fixed points, as there are
    such coefficients: a linear system with the parameters as symbols. The equations are those that
    are least dependent.
    """
    others = [int(i) for i in np.flatnonzero(row) if i != pivot]
    if not others:
        return [float(x) for x in row]
    s, n = region.system, region.system.structure.n
    count = min(max(2 * len(others) // n + 4, 6), MOST_POINTS)
    points, values = sample(region, euler_function(s), count, rng)
    table = (euler_rows(groups, points, values) * size)[:, others]
    chosen = _independent(
        table / np.maximum(np.abs(table).max(axis=1, keepdims=True), 1e-300), len(others)
    )
    lines = {k: _equations(region, groups, points, k // n, k % n, [pivot, *others]) for k in chosen}
    left = ca.vertcat(*(lines[k] for k in chosen))
    found = ca.solve(left[:, 1:] @ ca.diag(ca.DM(size[others])), -left[:, 0]) * ca.DM(size[others])
    coefficients: list = [0.0] * len(row)
    coefficients[pivot] = 1.0
    c = parameter_samples(s, rng)
    values = over_columns(ca.Function("values", [s.c], [ca.densify(found)]), c)[0]
    for i, x, y in zip(others, ca.vertsplit(found), values.T, strict=True):
        coefficients[i] = readable(x, y, c, s.c)
    return coefficients


def _independent(rows: np.ndarray, count: int) -> list[int]:
    """Numbers of `count` rows, each the farthest from the span of those before it."""
    rest, chosen = rows.copy(), []
    for _ in range(count):
        k = int(np.argmax((rest**2).sum(axis=1)))
        chosen.append(k)
        unit = rest[k] / max(np.linalg.norm(rest[k]), 1e-300)
        rest -= np.outer(rest @ unit, unit)
    return chosen


def _equations(
    region: Region, groups: Sequence[Pairs], points: Points, at: int, k: int, columns: list[int]
) -> ca.SX:
    """Row k of the equations at one point, for some of the unknowns, as a function of the
    parameters, (1, columns).
    """
    s, n = region.system, region.system.structure.n
    here = [ca.DM(x[at]) for x in points.columns]
    q, v, a, _, t, _ = here
    e, by_q, by_v, by_a, by_t = euler_function(s).call([*(ca.SX(x) for x in here[:-1]), s.c])
    entries = []
    for column in columns:
        if column == 0:
            entries.append(-by_t[k])
        elif column <= len(groups):
            i, j = groups[column - 1]
            pairs = zip(i.tolist(), j.tolist(), strict=True)
            entries.append(
                sum(
                    by_q[k, x] * q[y]
                    + by_v[k, x] * v[y]
                    + by_a[k, x] * a[y]
                    + (e[x] if k == y else 0)
                    for x, y in pairs
                )
            )
        else:
            boost, number = divmod(column - 1 - len(groups), n)
            entries.append(by_q[k, number] * t + by_v[k, number] if boost else by_q[k, number])
    return ca.horzcat(*(ca.SX(x) for x in entries))

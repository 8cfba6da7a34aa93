"""Rules of discretisation as data: control points, quadrature nodes and weights, kick and drift sequences.

A Galerkin rule replaces q(t) on a step by the polynomial through its control points and the action integral by a
quadrature (Ober-Blöbaum & Saake 2015). A composition alternates kicks and drifts of a separable Lagrangian (Hairer,
Lubich & Wanner, Geometric Numerical Integration, V.3). Nodes, weights and matrices are computed with 50 digits.
"""

from __future__ import annotations

import unicodedata
from dataclasses import dataclass
from decimal import Decimal, localcontext
from fractions import Fraction
from functools import cache, cached_property, lru_cache

import numpy as np

from varint.compositions import COMPOSITIONS
from varint.errors import InputError

DIGITS = 50  # of the decimal arithmetic; 11 control points lose fewer than 15 of them
MOST_STAGES = 10


@dataclass(frozen=True)
class Rule:
    """A discretisation of the action on one step, as data.

    Attributes
    ----------
    name : str
        How the user wrote it, e.g. ``"gauss(2)"``.
    order : int
        Order of q and p at the nodes.
    nodes, weights : tuple of float (r,)
        Quadrature nodes in [0, 1] and weights; controls have a value at each node. For a composition these are the
        times and weights of its kicks.
    points : tuple of float (d + 1,)
        Control points in [0, 1], first 0, last 1, of a Galerkin rule; empty for a composition.
    kicks, drifts : tuple of float
        Weights of the kick–drift sequence kick, drift, kick, …, kick that steps a separable Lagrangian with constant
        mass explicitly; empty where there is none.
    """

    name: str
    order: int
    nodes: tuple[float, ...]
    weights: tuple[float, ...]
    points: tuple[float, ...] = ()
    kicks: tuple[float, ...] = ()
    drifts: tuple[float, ...] = ()

    def __repr__(self) -> str:
        return self.name

    @property
    def degree(self) -> int:
        """Degree d of the path's polynomial on a step."""
        return len(self.points) - 1

    @cached_property
    def basis(self) -> np.ndarray:
        """ℓ_j(c_i): Lagrange polynomials of the control points at the quadrature nodes, (r, d + 1)."""
        return _table(self.points, self.nodes, 0)

    @cached_property
    def slopes(self) -> np.ndarray:
        """ℓ_j'(c_i): their derivatives at the quadrature nodes, (r, d + 1)."""
        return _table(self.points, self.nodes, 1)

    @cached_property
    def extrapolation(self) -> np.ndarray:
        """ℓ_k(1 + τ_j) − ℓ_k(1) for j, k = 1 … d: this step's path continued over the next step, (d, d)."""
        ahead = _table(self.points, tuple(1 + Fraction(x) for x in self.points[1:]), 0)
        return (ahead - _table(self.points, (1,), 0))[:, 1:]

    @cached_property
    def collocation(self) -> np.ndarray:
        """a_ij = ∫ of the j-th node's Lagrange polynomial from 0 to c_i, (r, r): the Butcher matrix of `gauss`."""
        return _table(self.nodes, self.nodes, -1)


def lagrange_values(points: np.ndarray, at: np.ndarray) -> np.ndarray:
    """ℓ_j(x_i) in double precision at any points, (len(at), len(points))."""
    ratios = (at[:, None, None] - points) / (points[:, None] - points + np.eye(len(points)))
    own = np.eye(len(points), dtype=bool)
    return np.where(own, 1.0, ratios).prod(axis=2)


@lru_cache(maxsize=256)
def _table(points: tuple, at: tuple, derivative: int) -> np.ndarray:
    with localcontext() as context:
        context.prec = DIGITS
        polynomials = [_derived(p, derivative) for p in _lagrange([_decimal(x) for x in points])]
        table = [[float(_horner(p, _decimal(x))) for p in polynomials] for x in at]
    result = np.array(table).reshape(len(at), len(points))
    result.flags.writeable = False
    return result


def _decimal(x) -> Decimal:
    if x in _EXACT:
        return _EXACT[x]
    x = Fraction(x)
    return Decimal(x.numerator) / Decimal(x.denominator)


_EXACT: dict[float, Decimal] = {}  # the 50-digit value behind each rounded node


def _lagrange(points: list[Decimal]) -> list[list[Decimal]]:
    """Coefficients (lowest first) of the Lagrange polynomials through the points."""
    polynomials = []
    for j, x_j in enumerate(points):
        p = [Decimal(1)]
        for k, x_k in enumerate(points):
            if k != j:
                p = [(a - x_k * b) / (x_j - x_k) for a, b in zip([Decimal(0), *p], [*p, Decimal(0)], strict=True)]
        polynomials.append(p)
    return polynomials


def _derived(p: list[Decimal], derivative: int) -> list[Decimal]:
    if derivative < 0:
        return [Decimal(0), *(a / (k + 1) for k, a in enumerate(p))]
    for _ in range(derivative):
        p = [k * a for k, a in enumerate(p)][1:] or [Decimal(0)]
    return p


def _horner(p: list[Decimal], x: Decimal) -> Decimal:
    value = Decimal(0)
    for a in reversed(p):
        value = value * x + a
    return value


def _legendre(degree: int) -> list[Fraction]:
    """Coefficients (lowest first) of the Legendre polynomial on [−1, 1]."""
    p, q = [Fraction(1)], [Fraction(0), Fraction(1)]
    for k in range(1, degree):
        shifted = [Fraction(0), *((2 * k + 1) * a for a in q)]
        old = [k * a for a in p] + [Fraction(0)] * 2
        p, q = q, [(a - b) / (k + 1) for a, b in zip(shifted, old, strict=True)]
    return p if degree == 0 else q


def _roots(coefficients: list[Fraction]) -> list[Decimal]:
    """Real simple roots on (−1, 1) mapped to (0, 1), polished by Newton's method in decimal arithmetic."""
    p = [Decimal(a.numerator) / Decimal(a.denominator) for a in coefficients]
    slope = _derived(p, 1)
    roots = []
    for start in np.sort(np.polynomial.Polynomial([float(a) for a in coefficients]).roots().real):
        x = Decimal(float(start))
        for _ in range(6):  # each iteration doubles the digits: 12 → 50 takes three
            x -= _horner(p, x) / _horner(slope, x)
        roots.append((1 + x) / 2)
    return roots


def _rounded(nodes: list[Decimal]) -> tuple[float, ...]:
    """The nodes as doubles; their 50-digit values stay known to `_table`."""
    _EXACT.update({float(x): x for x in nodes})
    return tuple(float(x) for x in nodes)


def _weights(nodes: list[Decimal]) -> tuple[float, ...]:
    return tuple(float(_horner(_derived(p, -1), Decimal(1))) for p in _lagrange(nodes))


def _gauss_nodes(stages: int) -> list[Decimal]:
    return _roots(_legendre(stages))


def _lobatto_nodes(stages: int) -> list[Decimal]:
    inner = [k * a for k, a in enumerate(_legendre(stages - 1))][1:]
    return [Decimal(0), *(_roots(inner) if stages > 2 else []), Decimal(1)]


@cache
def gauss(stages: int) -> Rule:
    """Gauss–Legendre rule: degree s, s Gauss points; order 2s, A-stable, symplectic and self-adjoint.

    Parameters
    ----------
    stages : int
        s, from 1 to 10.

    Returns
    -------
    Rule
        The Galerkin form of s-stage Gauss collocation; its control points are the s + 1 Lobatto points.

    Raises
    ------
    InputError
        If `stages` is no whole number from 1 to 10.

    Examples
    --------
    >>> import varint as vi
    >>> vi.gauss(2).order, vi.gauss(2).weights
    (4, (0.5, 0.5))
    """
    _check_stages("gauss", stages, 1)
    with localcontext() as context:
        context.prec = DIGITS
        nodes = _gauss_nodes(stages)
        return Rule(
            name="midpoint()" if stages == 1 else f"gauss({stages})",
            order=2 * stages,
            nodes=_rounded(nodes),
            weights=_weights(nodes),
            points=_rounded(_lobatto_nodes(stages + 1)),
        )


@cache
def lobatto(stages: int) -> Rule:
    """Lobatto rule: s Lobatto points both as control points and as quadrature; order 2s − 2, takes constraints.

    For separable Lagrangians with constant mass it is Lobatto IIIA–IIIB; `lobatto(2)` is Störmer–Verlet there.

    Parameters
    ----------
    stages : int
        s, from 2 to 10.

    Returns
    -------
    Rule

    Raises
    ------
    InputError
        If `stages` is no whole number from 2 to 10.

    Examples
    --------
    >>> import varint as vi
    >>> vi.lobatto(3).order, vi.lobatto(3).points
    (4, (0.0, 0.5, 1.0))
    """
    _check_stages("lobatto", stages, 2)
    with localcontext() as context:
        context.prec = DIGITS
        nodes = _lobatto_nodes(stages)
        return Rule(
            name="trapezoidal()" if stages == 2 else f"lobatto({stages})",
            order=2 * stages - 2,
            nodes=_rounded(nodes),
            weights=_weights(nodes),
            points=_rounded(nodes),
            kicks=(0.5, 0.5) if stages == 2 else (),
            drifts=(1.0,) if stages == 2 else (),
        )


def midpoint() -> Rule:
    """The implicit midpoint rule, L_d = h L((q0 + q1)/2, (q1 − q0)/h): order 2; the same as ``gauss(1)``."""
    return gauss(1)


def trapezoidal() -> Rule:
    """The trapezoidal rule, L_d = ½h (L(q0, Δq/h) + L(q1, Δq/h)): order 2; the same as ``lobatto(2)``.

    For separable Lagrangians with constant mass it is the explicit Störmer–Verlet method.
    """
    return lobatto(2)


@cache
def composition(name: str) -> Rule:
    """Explicit kick–drift composition for separable Lagrangians with constant mass, by name.

    Parameters
    ----------
    name : str
        For example ``"verlet"``, ``"yoshida4"``, ``"blanes-moan4"``, ``"kahan-li8"``; spelling is forgiving.

    Returns
    -------
    Rule

    Raises
    ------
    InputError
        If no composition has that name; the message lists those known.

    Examples
    --------
    >>> import varint as vi
    >>> vi.composition("Störmer–Verlet").kicks
    (0.5, 0.5)
    """
    found = _ALIASES.get(_plain(name)) if isinstance(name, str) else None
    if found is None:
        raise InputError(f"unknown composition {name!r}; known: {sorted(COMPOSITIONS)}")
    order, kicks, drifts = COMPOSITIONS[found]()
    with localcontext() as context:
        context.prec = DIGITS
        times = [sum(drifts[:k], Decimal(0)) for k in range(len(kicks))]
    return Rule(
        name=f"composition({found!r})",
        order=order,
        nodes=tuple(float(c) for c in times),
        weights=tuple(float(b) for b in kicks),
        kicks=tuple(float(b) for b in kicks),
        drifts=tuple(float(a) for a in drifts),
    )


def _plain(name: str) -> str:
    return "".join(x for x in unicodedata.normalize("NFKD", name).lower() if x.isascii() and x.isalnum())


_ALIASES = {_plain(name): name for name in COMPOSITIONS} | {
    "stormerverlet": "verlet",
    "leapfrog": "verlet",
    "tenth": "sofroniou-spaletta10",
    "sofroniouspaletta": "sofroniou-spaletta10",
}


def _check_stages(what: str, stages: int, least: int) -> None:
    if not isinstance(stages, (int, np.integer)) or isinstance(stages, bool) or not least <= stages <= MOST_STAGES:
        raise InputError(f"{what}(stages) takes a whole number from {least} to {MOST_STAGES}, got {stages!r}")

"""Rules of discretisation as data: control points, quadrature nodes and weights, kick and drift
sequences.

A Galerkin rule replaces q(t) on a step by the polynomial through its control points and the action
integral by a quadrature (Ober-Blöbaum & Saake 2015). A composition alternates kicks and drifts of a
separable Lagrangian (Hairer, Lubich & Wanner, Geometric Numerical Integration, V.3). Nodes, weights
and matrices are computed with 50 digits.
"""

from __future__ import annotations

import unicodedata
from dataclasses import dataclass
from decimal import Decimal, localcontext
from fractions import Fraction
from functools import cache, cached_property
from math import fsum

import numpy as np

from varint.errors import InputError
from varint.rules.compositions import COMPOSITIONS
from varint.rules.polynomials import (
    MOST_STAGES,
    PRECISE,
    gauss_nodes,
    interpolatory_weights,
    lagrange_table,
    lobatto_nodes,
    rounded,
)
from varint.rules.tableau import butcher, columns

MOST_POINTS = 10  # of Lobatto rules
ROUNDING = 1e-14  # of a sum of some 40 rounded weights of size 1


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
        Quadrature nodes in [0, 1] and weights; controls have a value at each node. For a
        composition these are the times and weights of its kicks.
    points : tuple of float (d + 1,)
        Control points in [0, 1], first 0, last 1, of a Galerkin rule; empty for a composition.
    kicks, drifts : tuple of float
        Weights of the kick–drift sequence kick, drift, kick, …, kick that steps a separable
        Lagrangian with constant mass explicitly; empty where there is none.

    Raises
    ------
    InputError
        If a quadrature or a sequence is inconsistent: weights that do not sum to 1, lengths that do
        not match.
    """

    name: str
    order: int
    nodes: tuple[float, ...]
    weights: tuple[float, ...]
    points: tuple[float, ...] = ()
    kicks: tuple[float, ...] = ()
    drifts: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        for what, weights in (
            ("weights", self.weights),
            ("kicks", self.kicks),
            ("drifts", self.drifts),
        ):
            if weights and abs(fsum(weights) - 1) > ROUNDING:
                raise InputError(
                    f"rule {self.name}: the {what} sum to {fsum(weights)!r}; a consistent rule "
                    "needs 1"
                )
        if len(self.nodes) != len(self.weights):
            raise InputError(
                f"rule {self.name}: {len(self.nodes)} nodes but {len(self.weights)} weights"
            )
        if self.kicks and len(self.kicks) != len(self.drifts) + 1:
            raise InputError(
                f"rule {self.name}: {len(self.kicks)} kicks and {len(self.drifts)} drifts; a "
                "sequence begins and ends with a kick, so it has one kick more than drifts (a "
                "kick may be 0)"
            )
        if self.points and (
            self.points[0] != 0 or self.points[-1] != 1 or any(np.diff(self.points) <= 0)
        ):
            raise InputError(
                f"rule {self.name}: control points must increase from 0 to 1, got {self.points}"
            )
        if not (self.points or self.kicks):
            raise InputError(
                f"rule {self.name}: needs control points (Galerkin) or kicks and drifts "
                "(composition)"
            )

    def __hash__(self) -> int:
        return hash(self.name)  # Python remembers it; rules are looked up in every run

    def __repr__(self) -> str:
        return self.name

    def _repr_latex_(self) -> str:
        """For notebooks: the tableau of the partitioned Runge–Kutta method that the rule is, or
        its kicks and drifts.
        """
        if not self.points:
            return columns(
                self.name, {r"b\ \text{(kicks)}": self.kicks, r"a\ \text{(drifts)}": self.drifts}
            )
        if self.degree in (len(self.nodes), len(self.nodes) - 1):
            return butcher(self.name, self.nodes, self.collocation, self.weights)
        named = {"c": self.nodes, "b": self.weights, r"\text{control points}": self.points}
        return columns(self.name, named)

    @property
    def degree(self) -> int:
        """Degree d of the path's polynomial on a step."""
        return len(self.points) - 1

    @cached_property
    def basis(self) -> np.ndarray:
        """ℓ_j(c_i): Lagrange polynomials of the control points at the quadrature nodes, (r, d +
        1).
        """
        return lagrange_table(self.points, self.nodes)

    @cached_property
    def slopes(self) -> np.ndarray:
        """ℓ_j'(c_i): their derivatives at the quadrature nodes, (r, d + 1)."""
        return lagrange_table(self.points, self.nodes, 1)

    @cached_property
    def extrapolation(self) -> np.ndarray:
        """ℓ_k(1 + τ_j) − ℓ_k(1) for j, k = 1 … d: this step's path continued over the next step,
        (d, d).
        """
        ahead = lagrange_table(self.points, [1 + Fraction(x) for x in self.points[1:]])
        return (ahead - lagrange_table(self.points, [1]))[:, 1:]

    @cached_property
    def collocation(self) -> np.ndarray:
        """a_ij = ∫ of the j-th node's Lagrange polynomial from 0 to c_i, (r, r): the Butcher
        matrix of `gauss`.
        """
        return lagrange_table(self.nodes, self.nodes, -1)


def gauss(stages: int) -> Rule:
    """Gauss–Legendre rule: degree s, s Gauss points; order 2s, A-stable, symplectic and
    self-adjoint.

    Parameters
    ----------
    stages : int
        s, from 1 to 16.

    Returns
    -------
    Rule
        The Galerkin form of s-stage Gauss collocation; its control points are the s + 1 Lobatto
        points.

    Raises
    ------
    InputError
        If `stages` is no whole number from 1 to 16.

    Examples
    --------
    >>> import varint as vi
    >>> vi.gauss(2).order, vi.gauss(2).weights
    (4, (0.5, 0.5))
    """
    return _gauss(stages if type(stages) is int else _stages("gauss", stages, 1, MOST_STAGES))


@cache
def _gauss(stages: int) -> Rule:
    nodes = gauss_nodes(_stages("gauss", stages, 1, MOST_STAGES))
    return Rule(
        name="midpoint()" if stages == 1 else f"gauss({stages})",
        order=2 * stages,
        nodes=rounded(nodes),
        weights=interpolatory_weights(nodes),
        points=rounded(lobatto_nodes(stages + 1)),
    )


def lobatto(stages: int) -> Rule:
    """Lobatto rule: s Lobatto points both as control points and as quadrature; order 2s − 2, takes
    constraints.

    For separable Lagrangians with constant mass it is Lobatto IIIA–IIIB; `lobatto(2)` is
    Störmer–Verlet there.

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
    return _lobatto(_stages("lobatto", stages, 2, MOST_POINTS))


@cache
def _lobatto(stages: int) -> Rule:
    nodes = lobatto_nodes(stages)
    return Rule(
        name="trapezoidal()" if stages == 2 else f"lobatto({stages})",
        order=2 * stages - 2,
        nodes=rounded(nodes),
        weights=interpolatory_weights(nodes),
        points=rounded(nodes),
        kicks=(0.5, 0.5) if stages == 2 else (),
        drifts=(1.0,) if stages == 2 else (),
    )


def midpoint() -> Rule:
    """The implicit midpoint rule, L_d = h L((q0 + q1)/2, (q1 − q0)/h): order 2; the same as
    ``gauss(1)``.
    """
    return gauss(1)


def trapezoidal() -> Rule:
    """The trapezoidal rule, L_d = ½h (L(q0, Δq/h) + L(q1, Δq/h)): order 2; the same as
    ``lobatto(2)``.

    For separable Lagrangians with constant mass it is the explicit Störmer–Verlet method.
    """
    return lobatto(2)


def composition(name: str) -> Rule:
    """Explicit kick–drift composition for separable Lagrangians with constant mass, by name.

    p ← p − b_i h ∂V/∂q, then q ← q + a_i h M⁻¹ p, in turn: a product of discrete Lagrangians, hence
    variational. Of scenes with non-holonomic rows or a degenerate Lagrangian, without controls and
    contacts, those made of Störmer–Verlet steps (all but Blanes & Moan's) compose steps of sizes
    a_i h of `midpoint`, with holonomic constraints besides of `trapezoidal`; where a degenerate
    Lagrangian L = ϑ(q)·v − H has a ϑ that is not linear, two of half the size for each.

    Parameters
    ----------
    name : str
        One of the table; capitals, spaces, hyphens and accents do not matter.

        =====  =====================================================  ====================
        order  names (force evaluations per step)                     best of its order
        =====  =====================================================  ====================
        2      verlet (1)
        4      yoshida4 (3), suzuki4 (5), blanes-moan4 (6)            blanes-moan4
        6      yoshida6 (7), kahan-li6 (9), blanes-moan6 (11)         blanes-moan6
        8      yoshida8 (15), suzuki-umeno8 (15), kahan-li8 (17)      kahan-li8
        10     sofroniou-spaletta10 (35)
        =====  =====================================================  ====================

    Returns
    -------
    Rule

    Raises
    ------
    InputError
        If no composition has that name; the message lists those known.

    Notes
    -----
    Blanes & Moan's are Runge–Kutta–Nyström splittings: their order needs a kinetic energy quadratic
    in p, which is what every composition here is used for. Sources of the coefficients:
    `varint/rules/compositions.py`.

    Examples
    --------
    >>> import varint as vi
    >>> vi.composition("Störmer–Verlet").kicks
    (0.5, 0.5)
    """
    found = _ALIASES.get(_plain(name)) if isinstance(name, str) else None
    if found is None:
        raise InputError(f"unknown composition {name!r}; known: {list(COMPOSITIONS)}")
    return _composition(found)


@cache
def _composition(name: str) -> Rule:
    order, kicks, drifts = COMPOSITIONS[name]()
    with localcontext(PRECISE):
        times = [sum(drifts[:k], Decimal(0)) for k in range(len(kicks))]
    return Rule(
        name=f"composition({name!r})",
        order=order,
        nodes=tuple(float(c) for c in times),
        weights=tuple(float(b) for b in kicks),
        kicks=tuple(float(b) for b in kicks),
        drifts=tuple(float(a) for a in drifts),
    )


def _plain(name: str) -> str:
    return "".join(
        x for x in unicodedata.normalize("NFKD", name).lower() if x.isascii() and x.isalnum()
    )


_ALIASES = {_plain(name): name for name in COMPOSITIONS} | {
    "stormerverlet": "verlet",
    "leapfrog": "verlet",
    "forestruth": "yoshida4",
    "mclachlan8": "suzuki-umeno8",
    "sofroniouspaletta": "sofroniou-spaletta10",
}


def _stages(what: str, stages: int, least: int, most: int) -> int:
    if (
        not isinstance(stages, (int, np.integer))
        or isinstance(stages, bool)
        or not least <= stages <= most
    ):
        raise InputError(
            f"{what}(stages) takes a whole number from {least} to {most}, got {stages!r}"
        )
    return int(stages)

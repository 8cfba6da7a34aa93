"""The record of one symmetry: generator, gauge term, conserved quantity, what breaks it and
which rules keep it.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from varint.rules.rule import Rule
from varint.scene.expressions import in_own_symbols
from varint.scene.system import System
from varint.scene.travel import as_fields, itself

HIGHEST_DEGREE = 10  # in time, of a polynomial that a rule can still integrate exactly
ROUNDING = 1e-13
LONGEST_TEXT = 120  # characters of a coefficient


@dataclass(frozen=True, eq=False, repr=False)
class Symmetry:
    """A symmetry q(t) → q(t) + s (ξ(q, t) + τ q̇(t)) of the Lagrangian, δL = d/dt (K + τ L).

    The conserved quantity is ``J = p·ξ + τ H − K`` (Noether's theorem); a shift of time is ξ = 0, τ
    = 1, J = H.

    Attributes
    ----------
    system : System
    name : str
        ``"translation along x"``, ``"rotation about z"``, ``"time translation"``, …
    xi : SX (n,)
        Generator ξ(q, t).
    tau : SX
        Rate τ of the accompanying shift of time; 0 for a pure point symmetry.
    gauge : SX
        Gauge term K(q, t); 0 where L itself does not change.
    broken_by : tuple of str
        What else is in the scene and does not share the symmetry: "constraint", "nonholonomic",
        "force", "contact".
    params : ndarray or None
        Parameter values for which the symmetry holds; None if it does for all values.
    tested : str
        How it is known: "identically", by the rules of algebra; or to which size of what is left,
        at how many points and how far from the origin.
    """

    system: System
    name: str
    xi: ca.SX
    tau: ca.SX
    gauge: ca.SX
    broken_by: tuple[str, ...]
    params: np.ndarray | None = None
    tested: str = "identically"

    def __repr__(self) -> str:
        return f"Symmetry({self.name}: {self.generator})"

    def __reduce__(self) -> tuple[Callable[..., Symmetry], tuple[Any, ...]]:
        """To another process its expressions go, in the symbols of the system that arrives."""
        return _symmetry_of, as_fields(self)

    __copy__ = __deepcopy__ = itself

    @cached_property
    def quantity(self) -> ca.SX:
        """Conserved expression J = p·ξ + τ H − K of q, v, t and the parameters."""
        s = self.system
        return (
            ca.dot(s.momentum, self.xi)
            + (0 if self.tau.is_zero() else self.tau * s.energy)
            - self.gauge
        )

    @cached_property
    def size(self) -> ca.SX:
        """Sum of the absolute values of the terms of J: what a drift of J is measured against."""
        s = self.system
        terms = [ca.fabs(s.momentum * self.xi), ca.fabs(self.gauge)]
        if not self.tau.is_zero():
            terms += [ca.fabs(self.tau * s.momentum * s.v), ca.fabs(self.tau * s.lagrangian)]
        return ca.sum1(ca.vertcat(*terms))

    @property
    def conserved(self) -> bool:
        """Whether J is constant along the motion: nothing in the scene breaks the symmetry."""
        return not self.broken_by

    @property
    def generator(self) -> str:
        """ξ + τ v as a vector field, ``-y ∂x + x ∂y``."""
        parts = zip(ca.vertsplit(ca.densify(self.xi)), self.system.names, strict=True)
        return _sum([*((part, f"∂{name}") for part, name in parts), (self.tau, "∂t")])

    @property
    def formula(self) -> str:
        """J in momenta, ``x p_y - y p_x``."""
        parts = zip(ca.vertsplit(ca.densify(self.xi)), self.system.names, strict=True)
        terms = _sum([(self.tau, "H"), *((part, f"p_{name}") for part, name in parts)])
        sign, gauge = _signed(-self.gauge)
        return terms if self.gauge.is_zero() else f"{terms} {sign} {gauge}"

    @property
    def kept(self) -> str:
        """What rules in general make of J."""
        if self.broken_by:
            return f"broken by {', '.join(self.broken_by)}"
        if not self.tau.is_zero():
            return "to the rule's order, bounded"
        return (
            "exactly"
            if self._is_affine(1) and self._gauge_degree(1) <= 1
            else "to the rule's order"
        )

    def kept_by(self, rule: Rule) -> str:
        """How `rule` keeps J: "exactly" (to round-off), "to order …" or "broken by …".

        A rule keeps J exactly if its polynomials map to such under the symmetry, i.e. ξ = A q +
        b(t) with b of at most their degree, and if its quadrature integrates dK/dt exactly along
        them. Shifts of time are no symmetry of a fixed grid: energy errors stay bounded (Ge &
        Marsden 1988), but for quadratic Lagrangians with Gauss rules, which conserve quadratic
        invariants (Hairer, Lubich & Wanner IV.2).
        """
        if self.broken_by:
            return f"broken by {', '.join(self.broken_by)}"
        return "exactly" if self.shared_by(rule) else f"to order {rule.order}"

    def shared_by(self, rule: Rule) -> bool:
        """Whether the discrete Lagrangian of `rule` has the symmetry too: J, or its balance, is
        exact to round-off.
        """
        if not self.tau.is_zero():
            s = self.system.structure
            return (
                self.gauge.is_zero()
                and self.xi.is_zero()
                and s.linear
                and s.autonomous
                and is_gauss(rule)
            )
        degree = max(rule.degree, 1)  # a composition's path is straight between kicks
        return self._is_affine(degree) and self._gauge_degree(degree) <= exactness(rule)

    def _is_affine(self, degree: int) -> bool:
        """Whether ξ = A q + b(t) with constant A and b of at most the given degree."""
        slope = ca.jacobian(self.xi, self.system.q)
        return not ca.depends_on(slope, ca.vertcat(self.system.q, self.system.t)) and (
            degree_in(self.xi, self.system.t) <= degree
        )

    def _gauge_degree(self, degree: int) -> float:
        """Degree in t of dK/dt along a path of the given degree; infinite unless K is a
        quadratic polynomial of q.
        """
        q, t = self.system.q, self.system.t
        if self.gauge.is_zero():
            return 0
        slope = ca.gradient(self.gauge, q)
        curvature = ca.jacobian(slope, q)
        if ca.depends_on(curvature, q):
            return np.inf
        rest = [ca.substitute(x, q, ca.SX.zeros(q.shape)) for x in (self.gauge, slope, curvature)]
        return max(
            i * degree + degree_in(part, t) - 1
            for i, part in enumerate(rest)
            if not ca.SX(part).is_zero()
        )


def _sum(terms: list[tuple[ca.SX, str]]) -> str:
    """Text of Σ factor · symbol."""
    texts = []
    for factor, symbol in terms:
        if factor.is_zero():
            continue
        sign, text = _signed(factor)
        texts.append((sign, symbol if text == "1" else f"{text} {symbol}"))
    text = " ".join(f"{sign} {term}" for sign, term in texts)
    return (
        text.removeprefix("+ ").replace("- ", "-", 1)
        if text.startswith("- ")
        else text.removeprefix("+ ") or "0"
    )


def _signed(factor: ca.SX) -> tuple[str, str]:
    """Sign and text of the rest, whichever way reads shorter."""
    sign, rest = ("-", -factor) if len(str(-factor)) < len(str(factor)) else ("+", factor)
    text = _plain(rest)
    if negative := re.fullmatch(r"\(?-([^()+-]*)\)?", text):  # of a product with a negative number
        return ("+" if sign == "-" else "-"), negative[1]
    return sign, text


def _plain(expression: ca.SX) -> str:
    """CasADi's text, without the parentheses around a whole product; long ones as a function of
    what they depend on.
    """
    text = str(expression)
    if "@" in text or len(text) > LONGEST_TEXT:
        return f"f({', '.join(sorted(x.name() for x in ca.symvar(expression)))})"
    return text[1:-1] if re.fullmatch(r"\([^()+-]*\)", text) else text


def degree_in(expression: ca.SX, t: ca.SX) -> float:
    """Degree of the expression as a polynomial of t, infinite if it is none of degree up to
    `HIGHEST_DEGREE`.
    """
    for degree in range(HIGHEST_DEGREE + 1):
        if not ca.depends_on(expression, t):
            return degree
        expression = ca.jacobian(ca.vec(expression), t)
    return np.inf


def exactness(rule: Rule) -> int:
    """Highest degree of the polynomials that the rule's quadrature integrates exactly."""
    nodes, weights = np.array(rule.nodes), np.array(rule.weights)
    degree = 0
    while abs(weights @ nodes ** (degree + 1) - 1 / (degree + 2)) < ROUNDING and degree < 2 * len(
        nodes
    ):
        degree += 1
    return degree


def is_gauss(rule: Rule) -> bool:
    """Whether the rule is Gauss collocation: r nodes on paths of degree r, exact to degree 2r −
    1.
    """
    return (
        bool(rule.points)
        and rule.degree == len(rule.nodes)
        and exactness(rule) == 2 * len(rule.nodes) - 1
    )


def _symmetry_of(*given: Any) -> Symmetry:
    """A symmetry that has travelled."""
    there = Symmetry(*given)
    names = "xi", "tau", "gauge"
    return replace(there, **{x: in_own_symbols(getattr(there, x), there.system, x) for x in names})

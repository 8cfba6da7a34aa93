"""Lagrange's equations of a scene in SymPy: momenta, equations of motion, forces, energy."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

from varint.notation.extra import sympy_module
from varint.notation.tidy import common_factor, slope, terms, tidied
from varint.scene.letters import Letters


class Mechanics(NamedTuple):
    """What a scene is made of, in its letters.

    Attributes
    ----------
    letters : Letters
    lagrangian : sympy.Expr
        L, tidied.
    force : list of sympy.Expr
        Generalised forces, one a coordinate.
    constraint, contact : list of sympy.Expr
        g = 0 and gap ≥ 0.
    nonholonomic : list of list of sympy.Expr
        Rows of A(q).
    """

    letters: Letters
    lagrangian: Any
    force: list[Any]
    constraint: list[Any]
    nonholonomic: list[list[Any]]
    contact: list[Any]

    @property
    def momenta(self) -> list[Any]:
        """∂L/∂v, tidied."""
        x = self.letters
        return [tidied(slope(self.lagrangian, v), x.v, x.moving) for v in x.v]

    @property
    def energy(self) -> Any:
        """v·∂L/∂v − L, tidied."""
        x = self.letters
        whole = sum(v * slope(self.lagrangian, v) for v in x.v) - self.lagrangian
        return tidied(whole, x.v, x.moving)

    @property
    def slopes(self) -> list[list[Any]]:
        """Gradients of constraints, rows of A, gradients of gaps: what multipliers act along."""
        x = self.letters
        return [
            *([slope(g, q) for q in x.q] for g in self.constraint),
            *self.nonholonomic,
            *([slope(g, q) for q in x.q] for g in self.contact),
        ]

    @property
    def acting(self) -> list[tuple[str, ...]]:
        """What acts along each coordinate beside L: what changes the momentum of a cyclic one."""
        held = {
            "constraint": self.slopes[: len(self.constraint)],
            "nonholonomic": self.nonholonomic,
            "contact": self.slopes[len(self.constraint) + len(self.nonholonomic) :],
        }
        return [
            tuple(["force"] if force != 0 else [])
            + tuple(what for what, rows in held.items() if any(row[i] != 0 for row in rows))
            for i, force in enumerate(self.force)
        ]


def euler_lagrange(m: Mechanics, multipliers: Sequence[Any]) -> list[tuple[Any, Any]]:
    """(left, right) of d/dt ∂L/∂v − ∂L/∂q = Σ λ ∂g/∂q + F, one a coordinate, tidied.

    What is constant and common to all terms is divided out; where nothing stands on the right and
    one acceleration on the left, its constant coefficient is.
    """
    return [_equation(m, multipliers, i) for i in range(len(m.letters.q))]


def _equation(m: Mechanics, multipliers: Sequence[Any], i: int) -> tuple[Any, Any]:
    x = m.letters
    sp = sympy_module("euler_lagrange()")
    p = slope(m.lagrangian, x.v[i])
    left = slope(p, x.t) - slope(m.lagrangian, x.q[i])
    for q, v, a in zip(x.q, x.v, x.a, strict=True):
        left += slope(p, q) * v + slope(p, v) * a
    right = sum((row[i] * y for row, y in zip(m.slopes, multipliers, strict=True)), m.force[i])
    on_left = terms(left, (*x.a, *x.v), x.moving)
    on_right = terms(right, (*multipliers, *x.v), x.moving)
    divisor = common_factor([*on_left, *on_right], (*x.moving, *x.v, *x.a, *multipliers))
    lone = [y for y in on_left if y.has(*x.a)]
    if not on_right and len(lone) == 1:
        constant, rest = lone[0].as_independent(*x.moving, *x.v, *x.a, as_Add=False)
        divisor = constant if rest in x.a and not constant.has(sp.Add) else divisor
    return sp.Add(*(y / divisor for y in on_left)), sp.Add(*(y / divisor for y in on_right))

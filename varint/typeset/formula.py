"""Formulas as data that show themselves: in notebooks, as LaTeX, as plain text, in SymPy."""

from __future__ import annotations

from typing import Any, NamedTuple

from varint.notation.extra import sympy_module
from varint.notation.names import latex_name, latex_text, plain_name
from varint.notation.styles import LATEX, PLAIN
from varint.notation.writer import write


class Quantity(NamedTuple):
    """A named quantity, ``p_θ = m ℓ² θ̇``.

    Attributes
    ----------
    name : str
        As symbols are called: ``"L"``, ``"p_theta"``.
    expression : sympy.Expr
        Of parameters, functions of time (``dynamicsymbols``) and their derivatives.
    order : tuple of str
        Names as they come in sums and products.
    """

    name: str
    expression: Any
    order: tuple[str, ...]

    def sympy(self) -> Any:
        """The expression."""
        return self.expression

    def latex(self) -> str:
        """LaTeX without dollar signs."""
        return f"{latex_name(self.name)} = {write(self.expression, LATEX, self.order)}"

    def _repr_latex_(self) -> str:
        return rf"$\displaystyle {self.latex()}$"

    def __str__(self) -> str:
        return f"{plain_name(self.name)} = {write(self.expression, PLAIN, self.order)}"

    def __repr__(self) -> str:
        return str(self)


class Equation(NamedTuple):
    """An equation, ``θ̈ + (g/ℓ) sin(θ) = 0``, or an inequality ``… ≥ 0``.

    Attributes
    ----------
    name : str
        What it belongs to: the coordinate of an equation of motion.
    left, right : sympy.Expr
        Of parameters, functions of time (``dynamicsymbols``) and their derivatives.
    order : tuple of str
        Names as they come in sums and products.
    relation : str
        ``"Equality"`` or ``"GreaterThan"``, as SymPy calls them.
    """

    name: str
    left: Any
    right: Any
    order: tuple[str, ...]
    relation: str = "Equality"

    def sympy(self) -> Any:
        """The relation, ``sympy.Eq`` or ``sympy.Ge``, unevaluated."""
        sp = sympy_module("Equation.sympy()")
        return getattr(sp, self.relation)(self.left, self.right, evaluate=False)

    def latex(self) -> str:
        """LaTeX without dollar signs."""
        left, right = (write(x, LATEX, self.order) for x in (self.left, self.right))
        return f"{left} {LATEX.relation[self.relation]} {right}"

    def _repr_latex_(self) -> str:
        return rf"$\displaystyle {self.latex()}$"

    def __str__(self) -> str:
        left, right = (write(x, PLAIN, self.order) for x in (self.left, self.right))
        return f"{left} {PLAIN.relation[self.relation]} {right}"

    def __repr__(self) -> str:
        return str(self)


class Conserved(NamedTuple):
    """A conserved quantity, and what else in the scene breaks its symmetry.

    Attributes
    ----------
    name : str
        The coordinate that is cyclic, or the name of the symmetry.
    quantity : Quantity
    broken_by : tuple of str
        ``"force"``, ``"constraint"``, …; empty where it is conserved along the motion.
    """

    name: str
    quantity: Quantity
    broken_by: tuple[str, ...]

    def sympy(self) -> Any:
        """The conserved expression."""
        return self.quantity.expression

    def latex(self) -> str:
        """LaTeX of the quantity without dollar signs."""
        return self.quantity.latex()

    def _repr_latex_(self) -> str:
        return rf"$\displaystyle {self.latex_in_words()}$"

    def latex_in_words(self) -> str:
        """LaTeX with its name, and whether it is conserved."""
        before, after = latex_text(f"{plain_name(self.name)}: "), latex_text(f", {self.kept}")
        return f"{before} {self.quantity.latex()} {after}"

    @property
    def kept(self) -> str:
        """Whether it is conserved, in words."""
        return f"broken by {', '.join(self.broken_by)}" if self.broken_by else "conserved"

    def __str__(self) -> str:
        return f"{plain_name(self.name)}: {self.quantity}, {self.kept}"

    def __repr__(self) -> str:
        return str(self)

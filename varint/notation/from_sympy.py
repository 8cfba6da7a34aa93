"""SymPy expressions as CasADi's: node by node, no text in between."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from fractions import Fraction
from math import inf, nan, pi
from typing import Any

import casadi as ca

from varint.errors import InputError
from varint.notation.extra import sympy_module
from varint.notation.to_sympy import SAME

# by the names of SymPy's functions
FUNCTIONS: Mapping[str, Callable[..., ca.SX]] = {
    **{name: getattr(ca, name) for name in SAME},
    "Abs": ca.fabs,
    "ceiling": ca.ceil,
    "sec": lambda x: 1 / ca.cos(x),
    "csc": lambda x: 1 / ca.sin(x),
    "cot": lambda x: 1 / ca.tan(x),
    "sech": lambda x: 1 / ca.cosh(x),
    "csch": lambda x: 1 / ca.sinh(x),
    "coth": lambda x: 1 / ca.tanh(x),
    "erfc": lambda x: 1 - ca.erf(x),
    "Mod": lambda x, y: x - y * ca.floor(x / y),
    "Heaviside": lambda x, at_zero: ca.if_else(x > 0, 1, ca.if_else(x < 0, 0, at_zero)),
    "Min": lambda *x: _folded(ca.fmin, x),
    "Max": lambda *x: _folded(ca.fmax, x),
    "Add": lambda *x: _folded(lambda a, b: a + b, x),
    "StrictLessThan": lambda x, y: x < y,
    "LessThan": lambda x, y: x <= y,
    "StrictGreaterThan": lambda x, y: x > y,
    "GreaterThan": lambda x, y: x >= y,
    "Equality": lambda x, y: x == y,
    "Unequality": lambda x, y: x != y,
    "And": lambda *x: _folded(ca.logic_and, x),
    "Or": lambda *x: _folded(ca.logic_or, x),
    "Not": ca.logic_not,
}
STRUCTURE = {"Mul", "Pow", "Piecewise", "ExprCondPair"}


def casadi_of(what: str, expression: Any, table: Mapping[Any, ca.SX]) -> ca.SX:
    """A SymPy expression as an SX scalar, with `table` for its symbols, functions of time and their
    derivatives.

    Raises
    ------
    InputError
        If it holds functions that CasADi has not, or symbols that are not in the table: all of
        them are named.
    """
    sp = sympy_module("casadi_of()")
    _require_known(sp, what, expression, table)
    known: dict[Any, ca.SX] = dict(table)

    def value(e: Any) -> ca.SX:
        if e not in known:
            known[e] = made(e)
        return known[e]

    def made(e: Any) -> ca.SX:
        if e.is_Number or e.is_NumberSymbol or e in (sp.true, sp.false):
            return ca.SX(_number(sp, e))
        if e.is_Mul:
            above = [x for x in e.args if not _divides(x)]
            below = [1 / x for x in e.args if _divides(x)]
            product = _folded(lambda a, b: a * b, [value(x) for x in above] or [ca.SX(1)])
            return product / _folded(lambda a, b: a * b, map(value, below)) if below else product
        if e.is_Pow:
            return _power(sp, e, value)
        if isinstance(e, sp.Piecewise):
            found = ca.SX(nan)  # where no condition holds
            for branch, condition in reversed(e.args):
                taken = condition == True  # noqa: E712  (SymPy's own true)
                found = (
                    value(branch) if taken else ca.if_else(value(condition), value(branch), found)
                )
            return found
        return FUNCTIONS[type(e).__name__](*(value(x) for x in e.args))

    return value(expression)


def _require_known(sp: Any, what: str, expression: Any, table: Mapping[Any, ca.SX]) -> None:
    """Refuse functions that CasADi has not and symbols that nobody declared, all at once."""
    functions, strangers = set(), set()
    walk = sp.preorder_traversal(expression)
    for e in walk:
        if e in table:
            walk.skip()
        elif isinstance(e, sp.Derivative):
            functions.add(f"{e} (only coordinates and their first derivatives)")
            walk.skip()
        elif isinstance(e, sp.core.function.AppliedUndef) or e.is_Symbol:
            strangers.add(str(e))
            walk.skip()
        elif not _has_counterpart(sp, e):
            functions.add(type(e).__name__)
    if functions:
        raise InputError(
            f"{what} holds {sorted(functions)}, for which CasADi has no counterpart; write it with "
            f"{', '.join(sorted(x for x in FUNCTIONS if x[0].islower()))}, Piecewise, Min and Max"
        )
    if strangers:
        raise InputError(
            f"{what} holds {sorted(strangers)}, which nobody declared: give constants in "
            "parameters={m: 1.0}, functions of time among the coordinates or the controls"
        )


def _has_counterpart(sp: Any, e: Any) -> bool:
    name = type(e).__name__
    if e.is_Atom:
        number = getattr(e, "is_extended_real", False) and (e.is_Number or e.is_NumberSymbol)
        return bool(number) or e in (sp.true, sp.false)
    return name in FUNCTIONS or name in STRUCTURE


def _number(sp: Any, e: Any) -> float:
    """The nearest floating-point number."""
    if e.is_Rational:
        return float(Fraction(int(e.p), int(e.q)))
    if e is sp.pi:
        return pi
    return inf if e is sp.oo else -inf if e is -sp.oo else float(e)


def _divides(e: Any) -> bool:
    return bool(e.is_Pow and e.exp.is_Rational and e.exp.is_negative)


def _power(sp: Any, e: Any, value: Callable[[Any], ca.SX]) -> ca.SX:
    base, exponent = e.args
    if base is sp.E:
        return ca.exp(value(exponent))
    if _divides(e):
        return 1 / value(base**-exponent)
    if exponent == sp.Rational(1, 2):
        return ca.sqrt(value(base))
    return value(base) ** (float(exponent) if exponent.is_Rational else value(exponent))


def _folded(join: Callable[[Any, Any], Any], items: Any) -> Any:
    first, *rest = items
    for item in rest:
        first = join(first, item)
    return first

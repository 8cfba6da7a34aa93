"""Expressions brought into the form of a book: term by term in the velocities, coefficients as
short as bounded work makes them.

SymPy's `simplify` tries everything on the whole expression and may take minutes; here only
coefficients are shortened, by identities of sines and cosines, factors and common denominators, and
long ones are left alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import reduce
from math import gcd
from typing import Any

from varint.notation.extra import sympy_module

LONG = 120  # operations of a coefficient that is still shortened
HIGHEST = 4  # power of a sum that is still multiplied out
NESTED = 3  # operations that a fraction inside of a product counts for


def tidied(e: Any, by: Sequence[Any], moving: Sequence[Any]) -> Any:
    """The expression as a sum over products of `by`, each coefficient as short as it was found.

    Parameters
    ----------
    e : sympy.Expr
    by : sequence of sympy.Symbol
        Velocities, momenta, multipliers: what stands apart in a sum.
    moving : sequence of sympy.Symbol
        Coordinates and time; everything else is constant.
    """
    return sum(terms(e, by, moving), start=sympy_module("tidied()").Integer(0))


def terms(e: Any, by: Sequence[Any], moving: Sequence[Any]) -> list[Any]:
    """The terms that `tidied` adds up, each a coefficient times a product of `by`."""
    sp = sympy_module("terms()")
    letters: dict[Any, Any] = {}
    flat = sp.expand(_frozen(e, letters, sp))
    back = {dummy: inner for inner, dummy in letters.items()}
    apart = [*by, *(dummy for dummy, inner in back.items() if inner.has(*by))] if by else []
    groups: dict[Any, list[Any]] = {}
    for term in sp.Add.make_args(flat):
        coefficient, product = term.as_independent(*apart, as_Add=False) if apart else (term, 1)
        groups.setdefault(sp.sympify(product), []).append(coefficient.xreplace(back))
    found = []
    for product, parts in groups.items():
        whole = shortest(sp.Add(*parts), moving, summed=product == 1)
        pieces = sp.Add.make_args(whole) if product == 1 else [whole]
        found += [x * product.xreplace(back) for x in pieces if x != 0]
    return found


def opened(e: Any) -> Any:
    """The expression multiplied out, functions, denominators and high powers of sums left alone."""
    sp = sympy_module("opened()")
    letters: dict[Any, Any] = {}
    flat = sp.expand(_frozen(e, letters, sp))
    return flat.xreplace({dummy: inner for inner, dummy in letters.items()})


def _frozen(e: Any, letters: dict[Any, Any], sp: Any) -> Any:
    """The expression as a polynomial: functions, roots and denominators as letters of their own."""
    if e.is_Atom or (e.is_Pow and e.base.is_Symbol and e.exp.is_Rational):
        return e
    if e.is_Add or e.is_Mul or (e.is_Pow and e.exp.is_Integer and 0 < e.exp <= HIGHEST):
        return e.func(*(_frozen(x, letters, sp) for x in e.args))
    if e not in letters:
        letters[e] = sp.Dummy(real=True)
    return letters[e]


def shortest(e: Any, moving: Sequence[Any], *, summed: bool = False) -> Any:
    """The shortest of some forms of a coefficient.

    `summed`: a sum stays one, with its constants collected.
    """
    sp = sympy_module("shortest()")
    if not e.is_Add and not e.has(sp.Add):
        return e
    if sp.count_ops(e) > LONG:
        return _collected(e, moving, sp)
    forms = [_collected(x, moving, sp) for x in (e, *_turned(e, sp))]
    best = min(forms, key=_length)
    if any(x.exp.is_negative for x in best.atoms(sp.Pow)):
        best = min((best, sp.cancel(sp.together(best))), key=_length)
    return best if summed else min((best, sp.factor(best)), key=_length)


def _turned(e: Any, sp: Any) -> list[Any]:
    """The expression with sin² + cos² = 1 used both ways, products of two angles as functions of
    their sum or difference.
    """
    sums = [x for x in sp.preorder_traversal(e) if x.is_Add]
    turning = {y for x in sums for y in x.atoms(sp.sin, sp.cos)}
    if not turning:
        return []
    from sympy.simplify.fu import TR5, TR6, TR10i

    several = len({x.args[0] for x in turning}) > 1
    starts = [e, sp.expand_mul(TR10i(e))] if several else [e]
    even = [sp.expand(rule(x)) for x in starts for rule in (TR5, TR6)]
    return [x for x in dict.fromkeys((*starts[1:], *even)) if x != e]


def _length(e: Any) -> int:
    """Operations, and a fine for fractions inside of products."""
    sp = sympy_module("_length()")
    inner = [x for x in sp.preorder_traversal(e) if x.is_Add and x != e]
    nested = sum(
        any(y.is_Pow and y.exp.is_negative for z in x.args for y in sp.Mul.make_args(z))
        for x in inner
    )
    return int(sp.count_ops(e)) + NESTED * nested


def _collected(e: Any, moving: Sequence[Any], sp: Any) -> Any:
    """A sum by what moves in its terms, constants in front as products."""
    groups: dict[Any, list[Any]] = {}
    for term in sp.Add.make_args(e):
        constant, rest = term.as_independent(*moving, as_Add=False) if moving else (term, 1)
        groups.setdefault(sp.sympify(rest), []).append(constant)
    sums = [(rest, sp.Add(*parts)) for rest, parts in groups.items()]
    return sp.Add(*(rest * (sp.factor(x) if sp.count_ops(x) <= LONG else x) for rest, x in sums))


def slope(e: Any, x: Any) -> Any:
    """∂e/∂x, where steps such as those of sign(x) have none, as in CasADi."""
    sp = sympy_module("slope()")
    found = e.diff(x)
    steps = (sp.DiracDelta, sp.Derivative, sp.Subs)
    return (
        found.replace(lambda y: isinstance(y, steps), lambda y: 0) if found.has(*steps) else found
    )


def common_factor(parts: Sequence[Any], moving: Sequence[Any]) -> Any:
    """The constant that all terms have as a factor, a number included; it is positive."""
    sp = sympy_module("common_factor()")
    powers: dict[Any, list[Any]] = {}
    numbers, count = [], 0
    for part in parts:
        for term in sp.Add.make_args(part):
            constant = term.as_independent(*moving, as_Add=False)[0] if moving else term
            number, rest = constant.as_coeff_Mul()
            numbers.append(number)
            count += 1
            for base, exponent in rest.as_powers_dict().items():
                if exponent.is_Rational and base != 1:
                    powers.setdefault(base, []).append(exponent)
    common = sp.Integer(1)
    for base, exponents in powers.items():
        if len(exponents) == count and min(exponents) * max(exponents) > 0:
            common *= base ** (min(exponents) if min(exponents) > 0 else max(exponents))
    if not numbers or not all(x.is_Rational for x in numbers):
        return common
    # denominators that not all have stay: I θ̈ = ½ ℓ λ, not 2 I θ̈ = ℓ λ
    return common * sp.Rational(
        reduce(gcd, (abs(int(x.p)) for x in numbers)), reduce(gcd, (int(x.q) for x in numbers))
    )

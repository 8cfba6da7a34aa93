"""SymPy expressions written as a mechanics book writes them: kinetic terms first, constants before
coordinates, dots for derivatives.

SymPy's own printers order terms and factors by the alphabet and give no hold on it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import Any, NamedTuple

from varint.notation.extra import sympy_module, time_symbol
from varint.notation.numbers import decimal_text
from varint.notation.styles import ATOM, POWER, PRODUCT, SUM, Style, Text, held


class Hand(NamedTuple):
    """Who writes: style, the order in which names come, SymPy."""

    style: Style
    order: Mapping[str, int]
    sp: Any


class Letter(NamedTuple):
    """A symbol: its name, its dots, and whether it changes with time."""

    name: str
    dots: int
    moves: bool


def write(expression: Any, style: Style, order: Sequence[str] = ()) -> str:
    """The expression as text.

    Parameters
    ----------
    expression : sympy.Expr
        Of symbols, functions of time and their derivatives.
    style : Style
    order : sequence of str
        Names in the order in which they come in sums and products.
    """
    hand = Hand(style, {name: i for i, name in enumerate(order)}, sympy_module("write()"))
    found = _sum(expression, hand, whole=True) if expression.is_Add else _text(expression, hand)
    return found.text


def letter_of(e: Any, sp: Any) -> Letter | None:
    """The letter that an expression is, if it is one."""
    if isinstance(e, sp.Derivative):
        [(_, count)] = e.variable_count
        inner = letter_of(e.expr, sp)
        return inner and Letter(inner.name, int(count), True)
    if isinstance(e, sp.core.function.AppliedUndef):
        return Letter(e.func.__name__, 0, True)
    if e.is_Symbol:
        return Letter(e.name, 0, e == time_symbol())
    return None


@lru_cache(maxsize=10_000)
def _letters(e: Any, sp: Any) -> tuple[Letter, ...]:
    """The letters of an expression, with those in powers as often as they count."""
    found = letter_of(e, sp)
    if found is not None:
        return (found,)
    if e.is_Pow and e.exp.is_Integer:
        return _letters(e.base, sp) * min(abs(int(e.exp)), 9)
    return tuple(letter for x in e.args for letter in _letters(x, sp))


def _text(e: Any, hand: Hand) -> Text:
    style, sp = hand.style, hand.sp
    letter = letter_of(e, sp)
    if letter is not None:
        return Text(style.name(letter.name, letter.dots), ATOM)
    if e.is_Rational:
        return _number(e, hand)
    if e.is_Float:
        return Text(f"{float(e):.12g}", ATOM if e >= 0 else SUM)
    if e in (sp.pi, sp.oo):
        return Text(style.words[str(e)], ATOM)
    if e.is_Add:
        return _sum(e, hand)
    if e.is_Mul or (e.is_Pow and e.exp.is_Rational and e.exp.is_negative):
        return _product(e, hand)
    if e.is_Pow:
        return _power(e, hand)
    return _call(e, "", hand)


def _number(e: Any, hand: Hand) -> Text:
    p, q = abs(int(e.p)), int(e.q)
    decimal = decimal_text(p, q)
    known = hand.style.decimal(decimal) if decimal else hand.style.number(p, q)
    if q == 1 and not decimal:
        known = str(p)
    part = (
        Text(known, ATOM) if known else hand.style.fraction(Text(str(p), ATOM), Text(str(q), ATOM))
    )
    return part if e.p >= 0 else Text(MINUS + part.text, SUM)


def _sum(e: Any, hand: Hand, *, whole: bool = False) -> Text:
    """A sum; one that is part of something begins with no minus where it can."""
    places = {x: _place_in_sum(x, hand) for x in e.args}
    terms = sorted(e.args, key=places.__getitem__)
    # no minus in front where a term of the same kind has none; M + m sin² θ, but x² + y² − ℓ²
    still = places[terms[0]][0] >= -1
    plus = [x for x in terms if not x.could_extract_minus_sign()]
    ahead = [x for x in plus if places[x][0] == 0] if still else []
    ahead = ahead or [x for x in plus if places[x][0] == places[terms[0]][0]][:1]
    ahead = ahead or ([] if whole else plus[:1])
    terms = [*ahead, *(x for x in terms if x not in ahead)]
    text = ""
    for term in terms:
        minus = term.could_extract_minus_sign()
        part = held(_text(-term if minus else term, hand), PRODUCT, hand.style.group)
        if text:
            text += f" {MINUS if minus else '+'} {part}"
        else:
            text = (MINUS if minus else "") + part
    return Text(text, SUM)


MINUS = "-"
FIRST = {"sin": 0, "cos": 1}  # of functions of the same letters


def _place_in_sum(term: Any, hand: Hand) -> tuple:
    """Accelerations first, then velocities, coordinates, constants; each in their order."""
    letters = _letters(term, hand.sp)
    rank = max((x.dots + x.moves for x in letters), default=0)
    top = sorted(_rank(x.name, hand) for x in letters if x.dots + x.moves == rank)
    return -rank, top, sorted(_rank(x.name, hand) for x in letters), hand.sp.default_sort_key(term)


def _rank(name: str, hand: Hand) -> tuple[int, str]:
    return hand.order.get(name, len(hand.order)), name


def _place_in_product(factor: Any, hand: Hand) -> tuple:
    """Constants, coordinates, velocities, accelerations, functions."""
    letters = _letters(factor, hand.sp)
    if factor.is_number:
        return False, 0, False, [], 0, hand.sp.default_sort_key(factor)
    base = factor.base if factor.is_Pow else factor
    rank = max((x.dots + x.moves for x in letters), default=0)
    is_letter = letter_of(base, hand.sp) is not None
    function = not (is_letter or base.is_Add)
    kind = FIRST.get(type(base).__name__, len(FIRST))
    ranks = sorted(_rank(x.name, hand) for x in letters)
    return function, rank, is_letter, ranks, kind, hand.sp.default_sort_key(factor)


def _product(e: Any, hand: Hand) -> Text:
    """A product: number, constants over constants, and the rest; or all over a denominator that
    moves.
    """
    sp, style = hand.sp, hand.style
    number, rest = e.as_coeff_Mul()
    minus = number < 0
    number = abs(number)
    above: list[Any] = []
    below: list[Any] = []
    for factor in sp.Mul.make_args(rest):
        divides = factor.is_Pow and factor.exp.is_Rational and factor.exp.is_negative
        (below if divides else above).append(1 / factor if divides else factor)
    above = [x for x in above if x != 1]
    constants = not any(x.moves for d in below for x in _letters(d, sp))
    p, q = number.p, number.q
    if decimal_text(p, q):
        p, q = number, 1
    front: list[Text] = []  # what is written before everything else
    if q > 1 and not below:
        front, p, q = [_front(_number(number, hand), hand)], 1, 1
    still = [x for x in above if not any(y.moves for y in _letters(x, sp))]
    moving = [x for x in above if x not in still]
    if constants and still and moving and below:
        # constants over constants, then what moves
        upper = _factors(sp.Rational(p), still, hand)
        part = style.fraction(upper, _factors(sp.Integer(q), below, hand))
        front, above, p, q, below = [*front, _front(part, hand)], moving, 1, 1, []
    if below or q > 1:
        upper = _factors(sp.Rational(p), above, hand)
        lower = _factors(sp.Integer(q), below, hand)
        body = style.fraction(upper, lower)
    else:
        body = _factors(sp.Rational(p), above, hand)
        if front and body.text == "1":
            body = front.pop()
    text = style.product([*(x.text for x in front), held(body, PRODUCT, style.group)])
    level = PRODUCT if front or minus else body.level
    return Text(MINUS + text if minus else text, SUM if minus else level)


def _front(part: Text, hand: Hand) -> Text:
    """A fraction before other factors: in plain text its bar must not reach to them."""
    if part.level == PRODUCT and "/" in part.text:
        return Text(hand.style.group(part.text), ATOM)
    return part


def _factors(number: Any, factors: list[Any], hand: Hand) -> Text:
    """A product without denominators."""
    ordered = sorted(factors, key=lambda x: _place_in_product(x, hand))
    parts = [_text(x, hand) for x in ordered]
    if number != 1 or not parts:
        parts = [_number(number, hand), *parts]
    if len(parts) == 1:
        return parts[0]
    return Text(hand.style.product([held(x, POWER, hand.style.group) for x in parts]), PRODUCT)


def _power(e: Any, hand: Hand) -> Text:
    base, exponent = e.args
    if exponent == hand.sp.Rational(1, 2):
        return hand.style.root(_text(base, hand))
    raised = _text(exponent, hand).text
    if exponent.is_Rational and not exponent.is_Integer:
        raised = f"{exponent.p}/{exponent.q}"
    if base.is_Function and letter_of(base, hand.sp) is None:
        return _call(base, raised, hand)
    return hand.style.power(_text(base, hand), raised)


def _call(e: Any, exponent: str, hand: Hand) -> Text:
    """Functions, conditions, and what there is besides."""
    sp, style, name = hand.sp, hand.style, type(e).__name__
    if isinstance(e, sp.Piecewise):
        branches = [
            (_text(x, hand).text, "" if when == sp.true else _text(when, hand).text)
            for x, when in e.args
        ]
        whole = Text(style.choice(branches), ATOM)
        return style.power(whole, exponent) if exponent else whole
    if name in style.relation:
        left, right = (_text(x, hand).text for x in e.args)
        return Text(f"{left} {style.relation[name]} {right}", SUM)
    if name == "Not":
        return Text(f"{style.words[name]} {style.group(_text(e.args[0], hand).text)}", SUM)
    if name in ("And", "Or"):
        parts = sorted(style.group(_text(x, hand).text) for x in e.args)
        return Text(f" {style.words[name]} ".join(parts), SUM)
    if len(e.args) == 1:
        return style.call(name, _text(e.args[0], hand), exponent)
    listed = ", ".join(_text(x, hand).text for x in e.args)
    return style.call(name, Text(listed, SUM), exponent)

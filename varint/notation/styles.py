"""How fractions, powers and functions are written, in LaTeX and in plain text."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import NamedTuple

from varint.notation.names import SUPERSCRIPTS, latex_name, plain_name

SUM, PRODUCT, POWER, ATOM = range(4)  # how tightly a text holds together

WORD = r"\mathrm"


class Text(NamedTuple):
    """A text and how tightly it holds together."""

    text: str
    level: int


class Style(NamedTuple):
    """What the parts of a formula become.

    Attributes
    ----------
    name : callable
        (name, number of dots) → text.
    decimal : callable
        ``9.81`` or ``6.67e-11`` → text.
    number : callable
        (p, q) → text of a fraction, q > 1; None where it is written as a fraction of terms.
    fraction : callable
        (above, below) → text.
    power : callable
        (base, exponent) → text.
    root : callable
        text → text of its root.
    call : callable
        (function, argument, exponent or "") → text.
    group : callable
        text → text in parentheses.
    product : callable
        list of factors → text.
    choice : callable
        list of (text, condition or "") → text.
    relation : dict
        SymPy's name of a relation → sign.
    words : dict
        Other signs by name.
    """

    name: Callable[[str, int], str]
    decimal: Callable[[str], str]
    number: Callable[[int, int], str | None]
    fraction: Callable[[Text, Text], Text]
    power: Callable[[Text, str], Text]
    root: Callable[[Text], Text]
    call: Callable[[str, Text, str], Text]
    group: Callable[[str], str]
    product: Callable[[list[str]], str]
    choice: Callable[[list[tuple[str, str]]], str]
    relation: dict[str, str]
    words: dict[str, str]


def held(x: Text, level: int, group: Callable[[str], str]) -> str:
    """The text, in parentheses where it holds together less tightly than it must."""
    return x.text if x.level >= level else group(x.text)


def _latex_group(text: str) -> str:
    return rf"\left({text}\right)"


def _latex_decimal(text: str) -> str:
    digits, _, power = text.partition("e")
    return rf"{digits} \cdot 10^{{{int(power)}}}" if power else digits


def _latex_product(factors: list[str]) -> str:
    """Factors side by side; words apart from what stands beside them."""
    text = factors[0]
    for before, factor in pairwise(factors):
        text += r" \, " if WORD in before or factor.startswith(WORD) else " "
        text += factor
    return text


def _latex_power(base: Text, exponent: str) -> Text:
    return Text(f"{held(base, ATOM, _latex_group)}^{{{exponent}}}", POWER)


def _latex_call(function: str, argument: Text, exponent: str) -> Text:
    if function == "Abs":
        whole = Text(rf"\left|{argument.text}\right|", ATOM)
        return _latex_power(whole, exponent) if exponent else whole
    known = LATEX_FUNCTIONS.get(function)
    head = known or rf"\operatorname{{{function}}}"
    head += f"^{{{exponent}}}" if exponent else ""
    simple = known and argument.level == ATOM
    return Text(f"{head} {argument.text}" if simple else head + _latex_group(argument.text), POWER)


def _latex_choice(branches: list[tuple[str, str]]) -> str:
    rows = [
        rf"{text} & \text{{if }} {condition}" if condition else rf"{text} & \text{{otherwise}}"
        for text, condition in branches
    ]
    return r"\begin{cases} " + r" \\ ".join(rows) + r" \end{cases}"


_SAME = "sin cos tan sinh cosh tanh exp log sec csc cot coth"
LATEX_FUNCTIONS = {name: "\\" + name for name in _SAME.split()} | {
    "asin": r"\arcsin",
    "acos": r"\arccos",
    "atan": r"\arctan",
    "Min": r"\min",
    "Max": r"\max",
}

LATEX = Style(
    name=latex_name,
    decimal=_latex_decimal,
    number=lambda p, q: None,
    fraction=lambda above, below: Text(rf"\frac{{{above.text}}}{{{below.text}}}", PRODUCT),
    power=_latex_power,
    root=lambda x: Text(rf"\sqrt{{{x.text}}}", ATOM),
    call=_latex_call,
    group=_latex_group,
    product=_latex_product,
    choice=_latex_choice,
    relation={
        "StrictLessThan": "<",
        "LessThan": r"\le",
        "StrictGreaterThan": ">",
        "GreaterThan": r"\ge",
        "Equality": "=",
        "Unequality": r"\ne",
    },
    words={"And": r"\land", "Or": r"\lor", "Not": r"\lnot", "pi": r"\pi", "oo": r"\infty"},
)


VULGAR = {
    (1, 2): "½",
    (1, 3): "⅓",
    (2, 3): "⅔",
    (1, 4): "¼",
    (3, 4): "¾",
    (1, 6): "⅙",
    (5, 6): "⅚",
    (1, 8): "⅛",
    (3, 8): "⅜",
    (5, 8): "⅝",
    (7, 8): "⅞",
}


def _plain_group(text: str) -> str:
    return f"({text})"


def _plain_power(base: Text, exponent: str) -> Text:
    raised = exponent.translate(SUPERSCRIPTS)
    if any(x not in SUPERSCRIPTS.values() and ord(x) not in SUPERSCRIPTS for x in exponent):
        return Text(f"{held(base, ATOM, _plain_group)}^({exponent})", POWER)
    if exponent.lstrip("-").isdigit():
        return Text(held(base, ATOM, _plain_group) + raised, POWER)
    return Text(f"{held(base, ATOM, _plain_group)}^({exponent})", POWER)


def _plain_call(function: str, argument: Text, exponent: str) -> Text:
    if function == "Abs":
        whole = Text(f"|{argument.text}|", ATOM)
        return _plain_power(whole, exponent) if exponent else whole
    if exponent.isdigit():
        return Text(f"{function}{exponent.translate(SUPERSCRIPTS)}({argument.text})", POWER)
    whole = Text(f"{function}({argument.text})", ATOM)
    return _plain_power(whole, exponent) if exponent else whole


def _plain_choice(branches: list[tuple[str, str]]) -> str:
    parts = [f"{text} if {condition}" if condition else text for text, condition in branches]
    return f"({' else '.join(parts)})"


PLAIN = Style(
    name=plain_name,
    decimal=str,
    number=lambda p, q: VULGAR.get((p, q)),
    fraction=lambda above, below: Text(
        f"{held(above, PRODUCT, _plain_group)}/{held(below, POWER, _plain_group)}", PRODUCT
    ),
    power=_plain_power,
    root=lambda x: Text(f"√{held(x, ATOM, _plain_group)}", POWER),
    call=_plain_call,
    group=_plain_group,
    product=" ".join,
    choice=_plain_choice,
    relation={
        "StrictLessThan": "<",
        "LessThan": "≤",
        "StrictGreaterThan": ">",
        "GreaterThan": "≥",
        "Equality": "=",
        "Unequality": "≠",
    },
    words={"And": "and", "Or": "or", "Not": "not", "pi": "π", "oo": "∞"},
)

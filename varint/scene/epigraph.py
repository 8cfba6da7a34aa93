"""|x| and max(a, b, …) in costs, as symbols that a problem splits into smooth rows.

A cost that grows with s = max(a, b, …) has the same minimum as the smooth problem with an unknown s
and the rows s ≥ a, s ≥ b, … (the epigraph form; Boyd & Vandenberghe, Convex Optimization, §4.1.3).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import casadi as ca

from varint.errors import InputError, parsed_or_refused

LONGEST = 40  # letters of an expression in a name


class Largest(NamedTuple):
    """A symbol that stands for the largest of some expressions."""

    symbol: ca.SX
    arguments: tuple[ca.SX, ...]


# what each symbol stands for, by its hash; the record holds the symbol, so that its hash stays its
# own
_KNOWN: dict[int, Largest] = {}
_SAME: dict[tuple[str, tuple[int, ...]], ca.SX] = {}


def abs(expression: Any) -> ca.SX:
    """|x| in a cost of optimal control, split inside: s ≥ x, s ≥ −x.

    Parameters
    ----------
    expression : SX (k,)
        Of q, v, controls, t and parameters.

    Returns
    -------
    SX (k,)
        Symbols that stand for the absolute values. The cost must grow with them.

    Raises
    ------
    InputError
        If it is no expression, or where it stands in a Lagrangian, a force, a bound, or where the
        cost falls with it.

    Examples
    --------
    >>> import casadi as ca
    >>> import varint as vi
    >>> q, v = vi.coordinates("x")
    >>> force = ca.SX.sym("force")
    >>> cart = vi.System(q, v, v**2 / 2, force=force, control=force)
    >>> least_fuel = vi.optimal_control(
    ...     cart, vi.gauss(1), duration=4, steps=8, cost=vi.abs(force), bounds=[(-1, force, 1)],
    ...     start=dict(q=[0], v=[0]), end=dict(q=[3], v=[0]))
    >>> round(least_fuel.cost, 6)
    2.0
    """
    return ca.vertcat(
        *(_symbol("abs", (x,), (x, -x)) for x in ca.vertsplit(_column("abs", expression)))
    )


def max(*expressions: Any) -> ca.SX:
    """The largest of some expressions in a cost of optimal control, split inside: s ≥ a, s ≥ b, ….

    Parameters
    ----------
    *expressions : SX or float
        Two or more, each one number.

    Returns
    -------
    SX
        A symbol that stands for the largest. The cost must grow with it.

    Raises
    ------
    InputError
        As for `abs`.

    Examples
    --------
    >>> import casadi as ca
    >>> import varint as vi
    >>> power = ca.SX.sym("power")
    >>> vi.max(power, 0)  # what is braked is lost
    SX(max(power, 0))
    """
    columns = [_column("max", x) for x in expressions]
    if len(columns) < 2 or any(x.numel() != 1 for x in columns):
        raise InputError(
            "max takes two or more expressions of one number each, got "
            f"{[x.numel() for x in columns]} numbers"
        )
    return _symbol("max", tuple(columns), tuple(columns))


def _column(what: str, expression: Any) -> ca.SX:
    if isinstance(expression, ca.MX):
        raise InputError(f"{what} takes SX expressions; write it with the system's SX symbols")
    return parsed_or_refused(
        lambda: ca.densify(ca.vec(ca.SX(expression))),
        lambda: f"{what} takes numbers or CasADi SX expressions, got {expression!r}",
    )


def _symbol(what: str, of: tuple[ca.SX, ...], arguments: tuple[ca.SX, ...]) -> ca.SX:
    key = what, tuple(x.element_hash() for x in of)
    if key not in _SAME:
        words = ", ".join(str(x) for x in of)
        words = words if len(words) <= LONGEST else f"{words[:LONGEST]}…"
        symbol = ca.SX.sym(f"{what}({words})")
        _SAME[key] = symbol
        _KNOWN[symbol.element_hash()] = Largest(symbol, arguments)
    return _SAME[key]


def largest_in(*expressions: ca.SX) -> list[Largest]:
    """The symbols of `abs` and `max` in these expressions and in each other, inner ones first."""
    found: dict[int, Largest] = {}

    def visit(expression: ca.SX) -> None:
        for symbol in ca.symvar(expression):
            known = _KNOWN.get(symbol.element_hash())
            if known is not None and symbol.element_hash() not in found:
                for argument in known.arguments:
                    visit(argument)
                found[symbol.element_hash()] = known

    for expression in expressions:
        visit(expression)
    return list(found.values())


def refuse_largest(what: str, expression: ca.SX, allowed: ca.SX) -> None:
    """Where |x| and max(…) cannot be split: they are no smooth functions."""
    split = {x.element_hash() for x in ca.symvar(allowed)}
    found = [
        x.symbol.name() for x in largest_in(expression) if x.symbol.element_hash() not in split
    ]
    if found:
        raise InputError(
            f"{found} in {what}: vi.abs and vi.max belong to the costs of optimal control, where "
            "they are split into smooth rows; a bound |x| <= b is (-b, x, b), and max(x, y) <= b "
            "is (None, x, b), (None, y, b)"
        )


def with_values(symbols: Sequence[Largest], expression: ca.SX) -> ca.SX:
    """The expression with fmax(…) in place of these symbols."""
    for one in reversed(symbols):  # what an inner one is part of is written out first
        value = one.arguments[0]
        for other in one.arguments[1:]:
            value = ca.fmax(value, other)
        expression = ca.substitute(expression, one.symbol, value)
    return expression

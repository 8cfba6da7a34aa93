"""What a function's value, its rate and its curvature in time can be while its arguments move
within intervals: automatic differentiation in interval arithmetic (Moore, Kearfott & Cloud,
Introduction to Interval Analysis, 2009, §9).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import casadi as ca

from varint.codegen.graph import COMMUTATIVE
from varint.errors import VarintError
from varint.integration.events.intervals import (
    HUGE,
    ONE,
    WHOLE,
    ZERO,
    Interval,
    exponential,
    finite_interval,
    hull,
    increasing,
    inverse,
    inverse_of_positive,
    negative,
    plus,
    point,
    root,
    sine,
    sizes,
    square,
    times,
    where,
)
from varint.numerics.operations import operations_of

MOST_PRODUCTS = 64  # largest power by products, which are closer than exp and log, of any sign


class Jet(NamedTuple):
    """Intervals that hold x, dx/dt and d²x/dt²."""

    value: Interval
    rate: Interval
    curvature: Interval


class Chain(NamedTuple):
    """Intervals that hold f(x), f'(x) and f''(x)."""

    value: Interval
    slope: Interval
    bend: Interval


def chain(f: Chain, x: Jet) -> Jet:
    """f(x(t)): f, f' ẋ, f'' ẋ² + f' ẍ."""
    curvature = plus(times(f.bend, square(x.rate)), times(f.slope, x.curvature))
    return Jet(f.value, times(f.slope, x.rate), curvature)


def sum_of(x: Jet, y: Jet) -> Jet:
    return Jet(*(plus(a, b) for a, b in zip(x, y, strict=True)))


def minus(x: Jet) -> Jet:
    return Jet(*map(negative, x))


def product(x: Jet, y: Jet) -> Jet:
    if x is y:
        return chain(Chain(square(x.value), times(point(2.0), x.value), point(2.0)), x)
    rate = plus(times(x.rate, y.value), times(x.value, y.rate))
    mixed = times(point(2.0), times(x.rate, y.rate))
    outer = plus(times(x.curvature, y.value), times(x.value, y.curvature))
    return Jet(times(x.value, y.value), rate, plus(mixed, outer))


def _inverse(x: Jet) -> Jet:
    y = inverse(x.value)
    return chain(Chain(y, negative(square(y)), times(point(2.0), times(y, square(y)))), x)


def _sqrt(x: Jet) -> Jet:
    y = root(x.value)
    slope = times(point(0.5), inverse_of_positive(y))
    bend = times(point(-0.5), times(slope, inverse_of_positive(x.value)))
    return chain(Chain(y, slope, bend), x)


def _exp(x: Jet) -> Jet:
    y = exponential(x.value)
    return chain(Chain(y, y, y), x)


def _log(x: Jet) -> Jet:
    y = finite_interval(
        ca.if_else(x.value.low > 0, ca.log(x.value.low), -HUGE), ca.log(x.value.high)
    )
    slope = inverse_of_positive(x.value)
    return chain(Chain(y, slope, negative(square(slope))), x)


def _sin(x: Jet) -> Jet:
    y = sine(x.value)
    return chain(Chain(y, sine(x.value, math.pi / 2), negative(y)), x)


def _cos(x: Jet) -> Jet:
    y = sine(x.value, math.pi / 2)
    return chain(Chain(y, negative(sine(x.value)), negative(y)), x)


def _atan(x: Jet) -> Jet:
    slope = inverse_of_positive(plus(ONE, square(x.value)))
    bend = times(point(-2.0), times(x.value, square(slope)))
    return chain(Chain(increasing(ca.atan)(x.value), slope, bend), x)


def _tanh(x: Jet) -> Jet:
    y = increasing(ca.tanh)(x.value)
    slope = plus(ONE, negative(square(y)))
    return chain(Chain(y, slope, times(point(-2.0), times(y, slope))), x)


def _fabs(x: Jet) -> Jet:
    up, down = x.value.low >= 0, x.value.high <= 0
    either = Interval(ca.SX(-1.0), ca.SX(1.0))
    slope = where(up, ONE, where(down, point(-1.0), either))
    kink = Interval(ca.SX(0.0), ca.SX(HUGE), True)  # it turns upwards
    bend = where(ca.logic_or(up, down), ZERO, kink)
    return chain(Chain(Interval(*sizes(x.value), x.value.wild), slope, bend), x)


def _fmin(x: Jet, y: Jet) -> Jet:
    return minus(_fmax(minus(x), minus(y)))


def _fmax(x: Jet, y: Jet) -> Jet:
    first, second = x.value.low >= y.value.high, y.value.low >= x.value.high
    low, high = ca.fmax(x.value.low, y.value.low), ca.fmax(x.value.high, y.value.high)
    wild = x.value.wild or y.value.wild
    kink = Interval(hull(x.curvature, y.curvature).low, ca.SX(HUGE), True)  # it turns upwards
    rate = where(first, x.rate, where(second, y.rate, hull(x.rate, y.rate)))
    curvature = where(first, x.curvature, where(second, y.curvature, kink))
    return Jet(Interval(low, high, wild), rate, curvature)


def _steps(f: Callable[[ca.SX], ca.SX]) -> Callable[[Jet], Jet]:
    """A function that grows by jumps."""

    def apply(x: Jet) -> Jet:
        y = increasing(f)(x.value)
        return _jumping(y, y.low >= y.high)

    return apply


def _jumping(value: Interval, certain: ca.SX) -> Jet:
    """A constant if that is certain; else there may be a jump."""
    change = where(certain, ZERO, WHOLE)
    return Jet(value, change, change)


def _less(x: Jet, y: Jet) -> Jet:
    value = Interval(x.value.high < y.value.low, x.value.low < y.value.high)
    return _jumping(value, value.low >= value.high)


def _less_or_equal(x: Jet, y: Jet) -> Jet:
    value = Interval(x.value.high <= y.value.low, x.value.low <= y.value.high)
    return _jumping(value, value.low >= value.high)


def _not(x: Jet) -> Jet:
    value = Interval(ca.logic_and(x.value.low == 0, x.value.high == 0), _may_vanish(x.value))
    return _jumping(value, value.low >= value.high)


def _may_vanish(a: Interval) -> ca.SX:
    return ca.logic_and(a.low <= 0, a.high >= 0)


def _if_else_zero(x: Jet, y: Jet) -> Jet:
    holds = ca.logic_not(_may_vanish(x.value))
    fails = ca.logic_and(x.value.low == 0, x.value.high == 0)
    change = [where(holds, a, where(fails, ZERO, WHOLE)) for a in (y.rate, y.curvature)]
    return Jet(where(holds, y.value, where(fails, ZERO, hull(y.value, ZERO))), *change)


def _pow(x: Jet, y: Jet) -> Jet:
    found = _exp(product(y, _log(x)))
    return Jet(*(where(x.value.low >= 0, a, WHOLE) for a in found))


def _hypot(x: Jet, y: Jet) -> Jet:
    return _sqrt(sum_of(product(x, x), product(y, y)))


def _atan2(y: Jet, x: Jet) -> Jet:
    """Quotients on the sides where they are finite; all around the origin and its cut."""
    right = _atan(product(y, _inverse(x)))
    up = sum_of(_number(math.pi / 2), minus(_atan(product(x, _inverse(y)))))
    down = sum_of(_number(-math.pi), up)
    around = Jet(Interval(ca.SX(-math.pi), ca.SX(math.pi)), WHOLE, WHOLE)
    sides = x.value.low > 0, y.value.low > 0, y.value.high < 0
    found = around
    for side, jet in zip(sides[::-1], (down, up, right), strict=True):
        found = Jet(*(where(side, a, b) for a, b in zip(jet, found, strict=True)))
    return found


def _tan(x: Jet) -> Jet:
    return product(_sin(x), _inverse(_cos(x)))


def _sinh(x: Jet) -> Jet:
    return product(_number(0.5), sum_of(_exp(x), minus(_exp(minus(x)))))


def _cosh(x: Jet) -> Jet:
    return product(_number(0.5), sum_of(_exp(x), _exp(minus(x))))


def _asin(x: Jet) -> Jet:
    return _atan(product(x, _inverse(_sqrt(sum_of(_number(1.0), minus(product(x, x)))))))


def _acos(x: Jet) -> Jet:
    return sum_of(_number(math.pi / 2), minus(_asin(x)))


def _number(x: float) -> Jet:
    return Jet(point(x), ZERO, ZERO)


UNKNOWN = Jet(WHOLE, WHOLE, WHOLE)
OPERATIONS: dict[str, Callable[..., Jet]] = {
    "add": sum_of,
    "sub": lambda x, y: sum_of(x, minus(y)),
    "neg": minus,
    "mul": product,
    "div": lambda x, y: product(x, _inverse(y)),
    "sqrt": _sqrt,
    "exp": _exp,
    "log": _log,
    "sin": _sin,
    "cos": _cos,
    "tan": _tan,
    "atan": _atan,
    "atan2": _atan2,
    "asin": _asin,
    "acos": _acos,
    "sinh": _sinh,
    "cosh": _cosh,
    "log1p": lambda x: _log(sum_of(_number(1.0), x)),
    "expm1": lambda x: sum_of(_exp(x), _number(-1.0)),
    "tanh": _tanh,
    "fabs": _fabs,
    "fmin": _fmin,
    "fmax": _fmax,
    "pow": _pow,
    "hypot": _hypot,
    "sign": _steps(ca.sign),
    "floor": _steps(ca.floor),
    "ceil": _steps(ca.ceil),
    "lt": _less,
    "le": _less_or_equal,
    "not": _not,
    "and": _fmin,
    "or": _fmax,
    "if_else_zero": _if_else_zero,
}


def enclosures(function: ca.Function, arguments: list[list[Jet]]) -> list[Jet]:
    """Jets of the function's first output, entry by entry, for jets of its arguments' entries.

    Operations that are not known here may give anything.
    """
    try:
        operations = operations_of(function)
    except VarintError:
        return [UNKNOWN] * function.numel_out(0)
    jets, known = list[Jet](), dict[tuple, int]()

    def node(name: str, *taken: Any) -> int:
        """Equal ones once: what is squared is seen to be."""
        key = name, *(sorted(taken) if name in COMMUTATIVE else taken)
        if key not in known:
            known[key] = len(jets)
            jets.append(_jet_of(name, [*key[1:]], jets, arguments))
        return known[key]

    zero, at = node("const", 0.0), list[int]()
    for name, *taken in operations.nodes:
        leaf = name in ("const", "input")
        kind, *number = operations.nodes[taken[-1]] if name in ("pow", "constpow") else ("",)
        if kind == "const" and _by_products(*number):
            at.append(_power(node, at[taken[0]], *number))
        else:
            at.append(_plain(node, name, taken if leaf else [at[i] for i in taken]))
    dense = [jets[zero]] * function.numel_out(0)
    for place, i in zip(operations.outputs[0].places, operations.outputs[0].nodes, strict=True):
        dense[place] = jets[at[i]]
    return dense


def _jet_of(name: str, taken: list[Any], jets: list[Jet], arguments: list[list[Jet]]) -> Jet:
    if name == "const":
        return _number(taken[0])
    if name == "input":
        return arguments[taken[0]][taken[1]]
    known = OPERATIONS.get(name)
    return known(*(jets[i] for i in taken)) if known else UNKNOWN


def _plain(node: Callable[..., int], name: str, taken: list[Any]) -> int:
    """An operation in terms of fewer kinds."""
    if name in ("assign", "lift"):
        return taken[0]
    if name == "sq":
        return node("mul", taken[0], taken[0])
    if name == "twice":
        return node("mul", node("const", 2.0), taken[0])
    if name == "inv":
        return node("div", node("const", 1.0), taken[0])
    return node("pow" if name == "constpow" else name, *taken)


def _by_products(exponent: float) -> bool:
    return abs(exponent) <= MOST_PRODUCTS and (2 * exponent).is_integer()


def _power(node: Callable[..., int], base: int, exponent: float) -> int:
    """base^exponent for multiples of 1/2, by repeated squaring."""
    one = node("const", 1.0)
    if exponent < 0:
        return node("div", one, _power(node, base, -exponent))
    factors = [node("sqrt", base)] if exponent % 1 else []
    whole, power, left = one, base, int(exponent)
    while left:
        if left & 1:
            whole = power if whole == one else node("mul", whole, power)
        left >>= 1
        power = node("mul", power, power) if left else power
    factors += [whole] if whole != one else []
    return node("mul", *factors) if len(factors) == 2 else factors[0] if factors else one

"""Operations with steps or kinks as parameters: what is left of an expression is smooth."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import casadi as ca

from varint.numerics.operations import ZERO, has_step, operation

POWERS = frozenset(("sqrt", "pow", "constpow"))
# not defined everywhere; of a power, where its exponent is no whole number
BOUNDED = frozenset(("sqrt", "log", "log1p", "pow", "constpow", "asin", "acos", "acosh", "atanh"))


class Node(NamedTuple):
    """An operation read: its expression, whether it moves (with q, v or t), and its number; equal
    operations of equal nodes are one.
    """

    value: ca.SX
    moves: bool
    number: int


class Switches:
    """The operations of an expression, read one after the other, and the switches found in them.

    `symbols` are the parameters s that stand for steps, `sigma` what they are the signs of, or, if
    they count (`counts`), the whole parts. Angles of atan2 are read with `cuts`. With `kinks` those
    of max, min and \\|x\\| stay in the expression; `bounded` tells whether it has operations that
    are not defined everywhere, as √x, so that no step may go on in a branch beyond its end.
    """

    def __init__(self, moving: ca.SX, cuts: bool, kinks: bool = False):
        self.cuts = cuts
        self.kinks = kinks
        self.bounded = False
        self.moving = {x.element_hash() for x in ca.vertsplit(moving)}
        self.symbols: list[ca.SX] = []
        self.sigma: list[ca.SX] = []
        self.counts: list[bool] = []
        self._known: dict[tuple[Any, ...], Node] = {}
        self._made: list[tuple[str, tuple[Node, ...]]] = []
        self._places: dict[tuple[Any, ...], int] = {}
        self._floors: set[int] = set()  # nodes that are the largest of zero and others

    def given(self, x: ca.SX) -> Node:
        """A symbol, or a number."""
        moves = x.is_symbolic() and x.element_hash() in self.moving
        key = ("symbol", x.element_hash()) if x.is_symbolic() else ("const", float(x))
        return self._kept(key, x, moves, ("const", ()))

    def read(self, name: str, *taken: Node) -> Node:
        """An operation; where it has a step or a kink on the way, the smooth one of its branch."""
        on_way = taken[:1] if name == "if_else_zero" else taken
        inner = (ZERO if x.value.is_zero() else self._made[x.number][0] for x in taken)
        jumps = (name == "atan2" and self.cuts) or has_step(name, *inner)
        if jumps and any(x.moves for x in on_way):
            return SMOOTH[name](self, *taken)
        key = (name, *(x.number for x in taken))
        if key in self._known:
            return self._known[key]
        value = operation(name, *(x.value for x in taken))
        if name in BOUNDED and taken[0].moves:
            exponent = float(taken[1].value) if name == "constpow" else 0.5
            if name in POWERS and taken[0].number in self._floors:  # beyond its branch as well
                value = operation(name, ca.fabs(taken[0].value), *(x.value for x in taken[1:]))
            elif not (name in POWERS and self._positive(taken[0])):
                self.bounded |= exponent != round(exponent)
        return self._kept(key, value, any(x.moves for x in taken), (name, taken))

    def sign(self, a: Node) -> Node:
        """s with s a > 0."""
        return self._sign(a) if a.moves else self.read("sign", a)

    def difference(self, a: Node, b: Node) -> Node:
        """The sign of a − b."""
        return self.sign(self.read("sub", a, b))

    def side(self, a: Node, b: Node) -> Node:
        """The sign of a − b where it decides nothing while that is zero: of a product with zero the
        sign of those of its factors that may be negative.
        """
        if a.value.is_zero():
            return self.read("neg", self.side(b, a))
        name, taken = self._made[a.number]
        if b.value.is_zero() and name == "neg":
            return self.read("neg", self.side(taken[0], b))
        if b.value.is_zero() and name == "mul":
            for x, rest in (taken, taken[::-1]):
                if self._positive(x):
                    return self.side(rest, b)
        return self.difference(a, b)

    def made(self, a: Node) -> tuple[str, tuple[Node, ...]]:
        """Its last operation and what that takes."""
        return self._made[a.number]

    def _positive(self, a: Node) -> bool:
        """Whether it is nowhere negative, as far as its last operations tell."""
        name, taken = self._made[a.number]
        if a.number in self._floors:
            return True
        if name in ("mul", "div", "add", "twice"):
            return all(map(self._positive, taken))
        if name in ("pow", "constpow", "sqrt"):
            return name == "sqrt" or self._positive(taken[0])
        if name == "fmax":
            return any(map(self._positive, taken))
        if a.value.is_constant():
            return float(a.value) >= 0
        return name in ("sq", "exp", "fabs")

    def whole(self, a: Node) -> Node:
        """The whole part, floor(a)."""
        return self._parameter(("whole", a.number), a, True)

    def on(self, s: Node) -> Node:
        """Whether a sign is positive."""
        return self.read("lt", self.number(0.0), s)

    def kink(self, name: str, *taken: Node) -> Node:
        """The operation itself."""
        key = (name, *(x.number for x in taken))
        value = operation(name, *(x.value for x in taken))
        return self._kept(key, value, True, (name, taken))

    def choose(self, on: Node, a: Node, b: Node) -> Node:
        """A where it is on, b elsewhere."""
        first = self.read("if_else_zero", on, a)
        return self.read("add", first, self.read("if_else_zero", self.read("not", on), b))

    def floor(self, largest: Node, *of: Node) -> Node:
        """The largest of some, which is nowhere negative where one of them is not."""
        if any(map(self._positive, of)):
            self._floors.add(largest.number)
        return largest

    def number(self, x: float) -> Node:
        return self.given(ca.SX(x))

    def _sign(self, a: Node) -> Node:
        """Of x − y and y − x there is one switch, of x − 0 and x as well."""
        name, taken = self._made[a.number]
        if name == "neg":
            return self.read("neg", self._sign(taken[0]))
        if name == "sub":
            x, y = taken
            if x.value.is_zero():
                return self.read("neg", self._sign(y))
            if y.value.is_zero():
                return self._sign(x)
            if x.number > y.number:
                return self.read("neg", self._sign(self.read("sub", y, x)))
        return self._parameter(("sign", a.number), a, False)

    def _parameter(self, key: tuple[Any, ...], a: Node, counts: bool) -> Node:
        place = self._places.get(key)
        if place is None:
            place = self._places[key] = len(self.symbols)
            self.symbols.append(ca.SX.sym(f"s{place}"))
            self.sigma.append(a.value)
            self.counts.append(counts)
        return self.given(self.symbols[place])

    def _kept(
        self, key: tuple[Any, ...], value: ca.SX, moves: bool, made: tuple[str, tuple[Node, ...]]
    ) -> Node:
        if key not in self._known:
            self._known[key] = Node(value, moves, len(self._made))
            self._made.append(made)
        return self._known[key]


def _fabs(s: Switches, a: Node) -> Node:
    sign = s.sign(a)
    return s.floor(s.kink("fabs", a) if s.kinks else s.read("mul", sign, a), s.number(0.0))


def _largest(s: Switches, a: Node, b: Node) -> Node:
    on = s.on(s.side(a, b))
    return s.floor(s.kink("fmax", a, b) if s.kinks else s.choose(on, a, b), a, b)


def _least(s: Switches, a: Node, b: Node) -> Node:
    on = s.on(s.side(a, b))
    return s.kink("fmin", a, b) if s.kinks else s.choose(on, b, a)


def _size(s: Switches, a: Node) -> Node:
    return _fabs(s, a) if a.moves else s.read("fabs", a)


def _less(s: Switches, a: Node, b: Node) -> Node:
    return s.on(s.difference(b, a))


def _rounded_to_zero(s: Switches, a: Node, b: Node) -> Node:
    """A − b trunc(a / b): towards zero, one more than the whole part of what is negative."""
    whole = s.whole(s.read("div", a, b))
    whole = s.read("add", whole, s.read("lt", whole, s.number(0.0)))
    return s.read("sub", a, s.read("mul", b, whole))


def _rounded(s: Switches, a: Node, b: Node) -> Node:
    whole = s.whole(s.read("add", s.read("div", a, b), s.number(0.5)))
    return s.read("sub", a, s.read("mul", b, whole))


def _half_turns(s: Switches, angle: Node, shift: float) -> tuple[Node, Node]:
    """The rest of an angle, shifted, beside whole half turns, and the sign, 1 or −1, of these."""
    pi = s.number(math.pi)
    whole = s.whole(s.read("add", s.read("div", angle, pi), s.number(shift)))
    turned = s.read("mul", pi, whole)
    return s.read("sub", angle, turned), s.read("cos", turned)


def _folded_by_sine(s: Switches, a: Node) -> Node:
    """Asin(sin x)."""
    return s.read("mul", *_half_turns(s, s.made(a)[1][0], 0.5))


def _folded_by_cosine(s: Switches, a: Node) -> Node:
    """Acos(cos x): from 0 to π, and back from π to 0."""
    rest, sign = _half_turns(s, s.made(a)[1][0], 0.0)
    back = s.read("mul", s.number(math.pi / 2), s.read("sub", s.number(1.0), sign))
    return s.read("add", back, s.read("mul", sign, rest))


def _folded_by_tangent(s: Switches, a: Node) -> Node:
    """Atan(tan x)."""
    return _half_turns(s, s.made(a)[1][0], 0.5)[0]


def _angle(s: Switches, y: Node, x: Node) -> Node:
    """Atan2(y, x): a right angle towards the side s of the x axis, and the angle from there, whose
    cut is far away. Atan2(sin e, cos e) of one e is that beside whole turns.
    """
    (up, sine), (along, cosine) = (s.made(z) for z in (y, x))
    if up == "sin" and along == "cos" and sine == cosine:
        turns = s.read("div", sine[0], s.number(2 * math.pi))
        whole = s.whole(s.read("add", turns, s.number(0.5)))
        return s.read("sub", sine[0], s.read("mul", s.number(2 * math.pi), whole))
    side = s.sign(y)
    across = s.read("neg", s.read("mul", side, x))
    rest = s.kink("atan2", across, s.read("mul", side, y))
    return s.read("add", s.read("mul", s.number(math.pi / 2), side), rest)


def _both(s: Switches, a: Node, b: Node) -> Node:
    """What moves is zero at instants alone."""
    one = s.number(1.0)
    return s.read("and", *(one if x.moves else x for x in (a, b)))


# what each operation is between two switches; equality holds at instants alone
SMOOTH: dict[str, Any] = {
    "sign": Switches.sign,
    "fabs": _fabs,
    "fmax": _largest,
    "fmin": _least,
    "lt": _less,
    "le": _less,
    "eq": lambda s, a, b: s.number(0.0),
    "ne": lambda s, a, b: s.number(1.0),
    "not": lambda s, a: s.number(0.0),
    "and": _both,
    "or": lambda s, a, b: s.number(1.0),
    "if_else_zero": lambda s, condition, a: a,
    "floor": Switches.whole,
    "ceil": lambda s, a: s.read("add", s.whole(a), s.number(1.0)),
    "fmod": _rounded_to_zero,
    "remainder": _rounded,
    "hypot": lambda s, a, b: _size(s, a if b.value.is_zero() else b),
    "asin": _folded_by_sine,
    "acos": _folded_by_cosine,
    "atan": _folded_by_tangent,
    "atan2": _angle,
    "copysign": lambda s, a, b: s.read("mul", _size(s, a), s.sign(b)),
}

"""Which expressions vanish identically: decided without rounding, by values modulo a prime.

An expression is evaluated at random points of a finite field of P elements. One that is zero by the
rules of algebra is zero there; one that is not vanishes at a point with probability about its
degree/P (Schwartz and Zippel), at all of `POINTS` of them never. Large and small have no meaning
there: neither a well far away nor a term of 1e-30 is overlooked.

Functions keep their rules as follows. With P = 2 Q + 1 and elements g, h of order Q, e^u is g^u and
e^{iu} is h^u, where the exponent is u modulo Q: products of powers, sums of angles and squares of
sines come out right (Gonnet, Determining equivalence of expressions in random polynomial time, STOC
1984). Roots are roots in the field extended by i. The sign of u is +1 for squares and −1 for
others, of which −1 is one, so that piecewise functions show each of their branches at half of the
points, wherever these begin. Of other functions (log, atan, erf …) only that equal arguments give
equal values is known: what needs more is not `decided`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from varint.symmetry.finite_field import (
    Residue,
    add,
    integer_power,
    inverse,
    is_square,
    is_zero,
    negative,
    power_modulo,
    rational,
    residue,
    signs,
    times,
)

Q = 1_073_740_463  # a prime with (Q − 1)/2 free of small factors, so that cube roots exist …
P = 2 * Q + 1  # … and 2 Q + 1 prime, both ≡ 3 (mod 4)
BASES = {"exp": (4, 25), "circle": (9, 49)}  # squares, hence of order Q modulo P
POINTS = 128
ENOUGH = 4  # points at which everything is defined
SEED = 1843  # the year of Hamilton's quaternions

_NAMES = """add sub mul div neg exp log pow constpow sqrt sq twice sin cos tan asin acos atan lt le
    eq ne not and or floor ceil fmod fabs sign copysign if_else_zero erf fmin fmax inv sinh cosh
    tanh asinh acosh atanh atan2 assign lift log1p expm1 hypot remainder"""
NAMES = {getattr(ca, f"OP_{name.upper()}"): name for name in _NAMES.split()}


@dataclass(frozen=True, eq=False)
class Values:
    """Values modulo P at random points, (points, outputs), real parts above imaginary ones.

    `ruled` is false where functions without rules were met: a value that is not zero may then
    still be zero by a rule that is not known here. `decided` is false there and where numbers with
    rounding errors were met, as whose fault a value may be not zero.
    """

    rows: np.ndarray
    ruled: bool
    decided: bool


class Known(NamedTuple):
    """A value modulo P, the same modulo Q for exponents, and its number where it is constant."""

    p: Residue
    q: Residue
    constant: Fraction | None = None


@dataclass(frozen=True, eq=False)
class Evaluated:
    """Arguments and outputs of a function at random points of the finite field."""

    arguments: list[list[Known]]
    outputs: list[list[Known]]
    machine: Machine

    @property
    def values(self) -> Values:
        """The outputs where everything is defined, if possible where all roots are of squares."""
        machine = self.machine
        good = machine.valid & machine.squares
        good = good if good.sum() >= ENOUGH else machine.valid
        columns = [value.p for output in self.outputs for value in output]
        if good.sum() < ENOUGH:
            return Values(np.ones((1, len(columns)), dtype=np.int64), False, False)
        real = np.array([x.a[good] for x in columns]).T
        other = np.array([(x.a * 0 if x.b is None else x.b)[good] for x in columns]).T
        ruled = machine.ruled
        return Values(np.concatenate([real, other]), ruled, ruled and machine.meant)


def evaluate(
    function: ca.Function,
    numbers: Sequence[np.ndarray | None],
    positive: bool = False,
    known: Evaluated | None = None,
) -> Evaluated:
    """An SX function at random points of the finite field.

    Parameters
    ----------
    function : casadi.Function
    numbers : list of array or None
        Values of an argument that is a number; None: any. For the first arguments.
    positive : bool
        The last argument takes positive values only.
    known : Evaluated, optional
        The first arguments are those, and its outputs the further ones.
    """
    machine = copy(known.machine) if known else Machine()
    if known:
        arguments = [*known.arguments, *known.outputs]
    else:
        arguments = []
        for i, given in enumerate(numbers):
            above = positive and i == len(numbers) - 1
            arguments.append(
                [
                    machine.anything(above) if given is None else machine.number(float(given[k]))
                    for k in range(function.nnz_in(i))
                ]
            )
    return Evaluated(arguments, machine.evaluate(function, arguments), machine)


class Machine:
    """Evaluates operations; remembers where they were undefined or ambiguous, and whether all had
    rules.
    """

    def __init__(self) -> None:
        self.rng = np.random.default_rng(SEED)
        self.valid = np.ones(POINTS, dtype=bool)
        self.squares = np.ones(POINTS, dtype=bool)  # where √u √w = √(u w) for all roots so far
        self.ruled = self.meant = True  # functions, and numbers

    def evaluate(self, function: ca.Function, arguments: list[list[Known]]) -> list[list[Known]]:
        """The outputs of a function."""
        zero = self.number(0.0)
        outputs = [[zero] * function.nnz_out(i) for i in range(function.n_out())]
        work: dict[int, Known] = {}
        for k in range(function.n_instructions()):
            code = function.instruction_id(k)
            out, source = function.instruction_output(k), function.instruction_input(k)
            if code == ca.OP_CONST:
                work[out[0]] = self.number(function.instruction_constant(k))
            elif code == ca.OP_INPUT:
                work[out[0]] = arguments[source[0]][source[1]]
            elif code == ca.OP_OUTPUT:
                outputs[out[0]][out[1]] = work[source[0]]
            else:
                name = NAMES.get(code, f"operation {code}")
                work[out[0]] = self.apply(name, [work[i] for i in source])
        return outputs

    def anything(self, positive: bool = False) -> Known:
        """A random value; a square as if positive."""
        draws = ((m, self.rng.integers(1, m, POINTS)) for m in (P, Q))
        p, q = (Residue(x * x % m if positive else x) for m, x in draws)
        return Known(p, q)

    def number(self, x: float) -> Known:
        """A constant."""
        if not np.isfinite(x):
            self.valid = np.zeros(POINTS, dtype=bool)
            return self.fraction(Fraction(0))
        value, meant = rational(x)
        self.meant = self.meant and meant
        return self.fraction(value)

    def fraction(self, x: Fraction) -> Known:
        """A rational constant."""
        p, q = (Residue(np.full(POINTS, residue(x, m), dtype=np.int64)) for m in (P, Q))
        return Known(p, q, x)

    def apply(self, name: str, a: list[Known]) -> Known:
        """One operation."""
        if name in ("assign", "lift"):
            return a[0]
        if name in ("pow", "constpow", "sqrt"):
            exponent = self.fraction(Fraction(1, 2)) if name == "sqrt" else a[1]
            return self._power(a[0], exponent)
        if name in _WRITTEN:
            return _WRITTEN[name](self, *a)
        if name in _PLAIN:
            p, q = (_PLAIN[name](m, *x) for m, x in self._both(a))
            return Known(p, q)
        return self._unknown(name, a)

    def _both(self, a: list[Known]):
        return ((P, [x.p for x in a]), (Q, [x.q for x in a]))

    def inverse(self, x: Known) -> Known:
        """1/x, undefined at 0."""
        self.valid = self.valid & ~is_zero(x.p) & ~is_zero(x.q)
        return Known(inverse(x.p, P), inverse(x.q, Q))

    def sign(self, x: Known) -> Known:
        """±1, with |x| |y| = |x y|."""
        p, q = (Residue(signs(value, m)) for m, value in ((P, x.p), (Q, x.q)))
        return Known(p, q)

    def exponential(self, kind: str, u: Known) -> Known:
        """g^u, with a second base for the part with i."""
        real, turned = BASES[kind]
        power = power_modulo(np.full(POINTS, real), u.q.a, P)
        if u.q.b is not None:
            power = power * power_modulo(np.full(POINTS, turned), u.q.b, P) % P
        return Known(Residue(power), self._hashed(kind, [u.q], Q))

    def _power(self, base: Known, exponent: Known) -> Known:
        e = exponent.constant
        if e is not None and e.denominator == 1:
            whole = Known(
                integer_power(base.p, abs(int(e)), P), integer_power(base.q, abs(int(e)), Q)
            )
            return whole if e >= 0 else self.inverse(whole)
        if e is None:
            if exponent.q.b is not None or base.p.b is not None:
                self.valid = np.zeros(POINTS, dtype=bool)
                return base
            self.valid = self.valid & is_square(base.p.a, P)
            power = Residue(power_modulo(base.p.a, exponent.q.a, P))
            return Known(power, self._hashed("pow", [base.q, exponent.q], Q))
        if e.denominator % 4 == 0:
            return self._unknown(f"power {e}", [base])
        return Known(self._root(base.p, e, P), self._root(base.q, e, Q))

    def _root(self, x: Residue, e: Fraction, m: int) -> Residue:
        """x^e with an odd denominator, or twice an odd one: of ±w, w a square, it is w^e (±1)^e."""
        a, order = x.a, (m - 1) // 2
        if x.b is not None:  # of a + b i where it is not real: other points
            self.valid = self.valid & x.b == 0
        square = is_square(a, m)
        if m == P:
            self.squares = self.squares & square
        power = power_modulo(np.where(square, a, -a % m), residue(e, order), m)
        odd = e.denominator if e.denominator % 2 else e.denominator // 2
        quarter = 2 * e.numerator * odd // e.denominator * pow(odd, -1, 4) % 4
        unit = ((1, 0), (0, 1), (m - 1, 0), (0, m - 1))[quarter]  # (−1)^e = i^{2e}
        return Residue(
            np.where(square, power, power * unit[0] % m),
            np.where(square, 0, power * unit[1] % m) if unit[1] else None,
        )

    def _unknown(self, name: str, a: list[Known]) -> Known:
        self.ruled = False
        p, q = (self._hashed(name, x, m) for m, x in self._both(a))
        return Known(p, q)

    def _hashed(self, name: str, a: list[Residue], m: int) -> Residue:
        """The same for the same arguments, and otherwise at random."""
        mixed = np.full(POINTS, int.from_bytes(name.encode(), "big") % m, dtype=np.int64)
        for part in (x for value in a for x in (value.a, value.b) if x is not None):
            mixed = (mixed * 48_271 + part + 11) % m
            mixed = (mixed * mixed % m * mixed + 7 * mixed + 5) % m
        return Residue(mixed)


def _hyperbolic(kind: str, sign: int):
    """(E ± 1/E)/2 with E = e^u, or for the circle e^{iu}, whose sine has a further 1/i."""

    def value(machine: Machine, u: Known) -> Known:
        e = machine.exponential(kind, u)
        other = machine.inverse(e)
        half = machine.fraction(Fraction(1, 2))
        total = machine.apply("add" if sign > 0 else "sub", [e, other])
        total = machine.apply("mul", [total, half])
        if kind == "circle" and sign < 0:
            turned = Residue(np.zeros_like(total.p.a), -total.p.a % P)
            return Known(turned, machine._hashed("sin", [u.q], Q))
        return total

    return value


def _compose(name: str, *arguments):
    return lambda machine, *a: machine.apply(
        name, [x(machine, *a) if callable(x) else a[x] for x in arguments]
    )


def _number(value: Fraction | int):
    return lambda machine, *a: machine.fraction(Fraction(value))


def _larger(by: int):
    """(a + b ± |a − b|)/2."""

    def value(machine: Machine, a: Known, b: Known) -> Known:
        apart = machine.apply("fabs", [machine.apply("sub", [a, b])])
        total = machine.apply("add" if by > 0 else "sub", [machine.apply("add", [a, b]), apart])
        return machine.apply("mul", [total, machine.fraction(Fraction(1, 2))])

    return value


def _less(machine: Machine, a: Known, b: Known) -> Known:
    """(1 − sign(a − b))/2."""
    one = machine.fraction(Fraction(1))
    rest = machine.apply("sub", [one, machine.sign(machine.apply("sub", [a, b]))])
    return machine.apply("mul", [rest, machine.fraction(Fraction(1, 2))])


_half = _number(Fraction(1, 2))
_PLAIN: dict[str, Callable[..., Residue]] = {
    "add": lambda m, x, y: add(x, y, m),
    "sub": lambda m, x, y: add(x, negative(y, m), m),
    "mul": lambda m, x, y: times(x, y, m),
    "neg": lambda m, x: negative(x, m),
    "sq": lambda m, x: times(x, x, m),
    "twice": lambda m, x: add(x, x, m),
    "if_else_zero": lambda m, x, y: times(x, y, m),
    "and": lambda m, x, y: times(x, y, m),
}
_WRITTEN: dict[str, Callable[..., Any]] = {
    "inv": lambda machine, x: machine.inverse(x),
    "div": lambda machine, x, y: machine.apply("mul", [x, machine.inverse(y)]),
    "sign": lambda machine, x: machine.sign(x),
    "fabs": lambda machine, x: machine.apply("mul", [machine.sign(x), x]),
    "copysign": lambda machine, x, y: machine.apply(
        "mul", [machine.apply("fabs", [x]), machine.sign(y)]
    ),
    "fmax": _larger(1),
    "fmin": _larger(-1),
    "lt": _less,
    "le": _less,
    "not": _compose("sub", _number(1), 0),
    "or": _compose("sub", _compose("add", 0, 1), _compose("mul", 0, 1)),
    "exp": lambda machine, u: machine.exponential("exp", u),
    "expm1": _compose("sub", _compose("exp", 0), _number(1)),
    "cosh": _hyperbolic("exp", 1),
    "sinh": _hyperbolic("exp", -1),
    "tanh": _compose("div", _compose("sinh", 0), _compose("cosh", 0)),
    "cos": _hyperbolic("circle", 1),
    "sin": _hyperbolic("circle", -1),
    "tan": _compose("div", _compose("sin", 0), _compose("cos", 0)),
    "hypot": _compose("sqrt", _compose("add", _compose("sq", 0), _compose("sq", 1))),
}

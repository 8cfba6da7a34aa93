"""Scenes whose motion is linear, x' = A x + b with x = (q, p) and constant A and b: both with twice
the digits of a number, and any power of a step as one map.

Where a scene has stiff parts the slow motion is what is left of large entries of A that cancel:
with rounded ones it would be wrong by their last digits, times all the time that the stiff parts
have. So momenta and forces are evaluated in whole numbers and their quotients. A step by a Gauss
rule is x → R x, where R is the diagonal Padé approximant of exp(h A) (Hairer & Wanner, Solving
Ordinary Differential Equations II, IV.3), and 2ʲ steps are R squared j times.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cache
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from varint.numerics.arrays import call
from varint.numerics.linear_maps import exact_gauss_change, squared
from varint.numerics.pairs import Pair, block, pair_of, part, product, scaled, single, solved, total
from varint.rules.rule import Rule
from varint.scene.memory import per_scene
from varint.scene.system import System

MOST_COORDINATES = 128  # beyond, a sparse solve in every step is cheaper than a full map
MOST_IN_A_STEP = 1.5  # the norm of h A: of longer steps inverses lose digits
NONE = math.inf, math.inf  # rates of masses that are none
KEPT = 2  # flows of other parameters, and powers of other steps

# coefficients of q and v by number, and what is constant under −1
_Form = dict[int, Fraction]
_CONSTANT = -1


@per_scene
def moves_linearly(system: System) -> bool:
    """Whether the motion is linear, of few coordinates, and nothing holds or controls it."""
    return not system.structure.controls and is_linear_and_free(system)


@per_scene
def is_linear_and_free(system: System) -> bool:
    """Whether the same, with controls or without."""
    s = system.structure
    held = s.constraints or s.nonholonomic or s.contacts or s.degenerate
    return (
        not (held or system.rays) and s.linear and s.quadratic_kinetic and s.n <= MOST_COORDINATES
    )


def is_gauss(rule: Rule) -> bool:
    """Whether its steps are diagonal Padé approximants where the motion is linear."""
    return bool(rule.points) and rule.order == 2 * len(rule.nodes) == 2 * rule.degree


@per_scene
def has_powers(system: System, rule: Rule) -> bool:
    """Whether any number of its steps is one map, which stays the same all the time."""
    return moves_linearly(system) and system.structure.autonomous and is_gauss(rule)


class Flow(NamedTuple):
    """A with b as its last column, (2n + 1, 2n + 1), in units (2n + 1,) of q, p and 1."""

    a: Pair
    unit: np.ndarray
    norm: float


@dataclass(eq=False)
class Powers:
    """Rʲ − 1 for j = 1, 2, 4, … in units, as far as they were asked for."""

    unit: np.ndarray
    changes: list[Pair]

    def up_to(self, count: int) -> Sequence[Pair]:
        """So many of them."""
        changes = [*self.changes]  # not in place: other threads may ask, too
        while len(changes) < count:
            changes.append(squared(changes[-1]))
        if len(changes) > len(self.changes):
            self.changes = changes
        return changes[:count]

    def within(self, q: np.ndarray, p: np.ndarray) -> np.ndarray:
        """States (N, n), (N, n) as (N, 2n + 1), in units."""
        return np.hstack((q, p, np.ones((len(q), 1)))) / self.unit

    def states(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """q and p of these."""
        q, p = np.hsplit(x[:, :-1] * self.unit[:-1], 2)
        return np.ascontiguousarray(q), np.ascontiguousarray(p)


def rates(system: System, c: np.ndarray) -> tuple[float, float]:
    """How fast the motion of a scene of `has_powers` can change at most, and what dampers stop,
    1/time: norms of matrices, which are no less than the rates are; infinite where masses are none.
    """
    return _kept(_rates, (c.tobytes(),), system, c)  # type: ignore[no-any-return]


def powers(system: System, rule: Rule, c: np.ndarray, h: float) -> Powers | None:
    """Of steps h of a scene and a rule of `has_powers`; None where steps are too long for it, or
    forces are no sums of multiples.
    """
    key = rule, c.tobytes(), h
    return _kept(_powers, key, system, rule, c, h)  # type: ignore[no-any-return]


def flow(system: System, c: np.ndarray) -> Flow | None:
    """A and b of such a scene; None where its forces are no sums of multiples."""
    return _kept(_flow, (c.tobytes(),), system, c)  # type: ignore[no-any-return]


@per_scene
def _known(system: System, make: Callable[..., Any]) -> dict[tuple, Any]:
    """What was made last for the scene, by what it was made of."""
    return {}


def _kept(make: Callable[..., Any], key: tuple, *arguments: Any) -> Any:
    """Made of the arguments, the scene first, if it was not lately."""
    known = _known(arguments[0], make)
    try:
        return known[key]
    except KeyError:
        found = make(*arguments)
    for other in list(known)[: len(known) + 1 - KEPT]:
        known.pop(other, None)
    known[key] = found
    return found


def _powers(system: System, rule: Rule, c: np.ndarray, h: float) -> Powers | None:
    found = flow(system, c)
    if found is None or not abs(h) * found.norm <= MOST_IN_A_STEP:
        return None
    size = 2.0 ** np.round(np.log2(abs(h)))
    # the rest of h is rounded once more, as the step itself is: in the last of twice the digits
    a = product(scaled(found.a, size), single(h / size * np.eye(len(found.unit))))
    return Powers(found.unit, [exact_gauss_change(a, len(rule.nodes))])


@np.errstate(all="ignore")  # of masses that are none
def _rates(system: System, c: np.ndarray) -> tuple[float, float]:
    n = system.structure.n
    mass, *others = (x.reshape(n, n).T for x in call(_slopes(system), c))
    try:
        springs, dampers = (_norm(np.linalg.solve(mass, x)) for x in others)
    except np.linalg.LinAlgError:
        return NONE
    return _of(springs, dampers)


def rough_rates(system: System, c: np.ndarray) -> tuple[float, float]:
    """No less than `rates`, and some times as much where masses are coupled: in a hundredth of the
    time, where masses are the same as before.
    """
    sizes = call(_sizes(system), c)[0]
    light = _kept(_lightness, (sizes[2:].tobytes(),), system, sizes[2:])
    springs, dampers = sizes[:2].tolist()
    return _of(light * springs, light * dampers)


def _lightness(system: System, mass: np.ndarray) -> float:
    """Norm of M⁻¹."""
    n = system.structure.n
    try:
        return _norm(np.linalg.inv(mass.reshape(n, n)))
    except np.linalg.LinAlgError:
        return math.inf


def _of(springs: float, dampers: float) -> tuple[float, float]:
    """By norms of M⁻¹K and M⁻¹D."""
    if not (0 <= springs < math.inf and 0 <= dampers < math.inf):
        return NONE
    root = math.sqrt(springs)
    return (root if root > dampers else dampers), dampers


def _norm(x: np.ndarray) -> float:
    """No less than any eigenvalue is."""
    size = np.abs(x)
    return float(min(size.sum(axis=0).max(), size.sum(axis=1).max()))


@per_scene
def _slopes(system: System) -> ca.Function:
    """c → M, and derivatives of what accelerates by q and by v, for coordinates whose masses are
    one.
    """
    return ca.Function("slopes", [system.c], [ca.densify(x) for x in _scaled(system)])


@per_scene
def _sizes(system: System) -> ca.Function:
    """c → norms of these derivatives, and M, in one."""
    mass, *others = _scaled(system)
    norms = [ca.norm_inf(ca.sum2(ca.fabs(x))) for x in others]
    return ca.Function("sizes", [system.c], [ca.densify(ca.vertcat(*norms, ca.vec(mass)))])


def _scaled(system: System) -> list[ca.SX]:
    s, mass = system, system.mass_matrix
    by_q = ca.jacobian(s.generalised_force, s.q)
    by_v = ca.jacobian(s.generalised_force, s.v) - ca.jacobian(s.momentum, s.q)
    unit = ca.diag(1 / ca.sqrt(ca.fabs(ca.diag(mass))))
    return [ca.mtimes([unit, x, unit]) for x in (mass, by_q, by_v)]


def _flow(system: System, c: np.ndarray) -> Flow | None:
    n, (fastest, _) = system.structure.n, rates(system, c)
    if not (0 < fastest < np.inf):
        return None
    try:
        forms = _forms(_sums(system), c)
    except (_NoSum, OverflowError, ValueError, ZeroDivisionError):
        return None
    keys = [*range(2 * n), _CONSTANT]
    zero = Fraction(0)
    rows = pair_of([[form.get(k, zero) for k in keys] for form in forms])
    masses, springs = rows.high[:n, n : 2 * n], rows.high[n:, :n]
    # powers of two, with which nothing is rounded: all coordinates move by as much, and as fast
    root = 2.0 ** np.round(np.log2(np.abs(np.diag(masses))) / 2)
    try:
        light = _norm(np.linalg.inv(masses / root / root[:, None]))
    except np.linalg.LinAlgError:
        return None
    stiff = _norm(springs / root / root[:, None])
    speed = 2.0 ** np.round(np.log2(max(fastest / light, np.sqrt(stiff / light))))
    unit_q, unit_p = 1 / root, root * speed
    # velocities are in units of coordinates
    rows = scaled(rows, np.concatenate((unit_q, unit_q, [1.0])))
    rows = scaled(rows, 1 / np.concatenate((root, unit_p))[:, None])
    by_q, by_v, rest = slice(0, n), slice(n, 2 * n), slice(2 * n, None)
    momentum, force = part(rows, slice(0, n)), part(rows, slice(n, None))
    p = single(np.diag(np.full(n, speed)))
    # p = M v + B q + b
    left = [scaled(part(momentum, (slice(None), k)), -1.0) for k in (by_q, rest)]
    mass = part(momentum, (slice(None), by_v))
    velocity = solved(mass, block([[left[0], p, left[1]]]))
    at_rest = [part(force, (slice(None), k)) for k in (by_q, rest)]
    gained = block([[at_rest[0], single(np.zeros((n, n))), at_rest[1]]])
    driven = product(part(force, (slice(None), by_v)), velocity)
    rate = Pair(*(np.vstack(x) for x in zip(velocity, total(gained, driven), strict=True)))
    norm = _norm(rate.high[:, :-1])
    most = np.abs(rate.high[:, -1]).max()
    one = 2.0 ** np.round(np.log2(norm / most)) if most > 0 else 1.0
    unit = np.concatenate((unit_q, unit_p, [one]))
    whole = np.zeros((2, 2 * n + 1, 2 * n + 1))
    whole[:, :-1] = rate
    whole[:, :, -1] *= one
    if not (np.isfinite(whole).all() and np.isfinite(unit).all()):
        return None
    return Flow(Pair(*whole), unit, norm)


@per_scene
def _sums(system: System) -> ca.Function:
    """(q, v, c) → momenta and their rates."""
    s = system
    found = ca.densify(ca.vertcat(s.momentum, s.generalised_force))
    return ca.Function("sums", [ca.vertcat(s.q, s.v), s.c], [found])


class _NoSum(Exception):
    """Something that is no sum of multiples of q and v."""


def _forms(function: ca.Function, c: np.ndarray) -> list[_Form]:
    """The sums of multiples that a function of (q, v) and c adds up, without any rounding but that
    of roots and the like of parameters.
    """
    given = [Fraction(x) for x in c.tolist()]
    work: dict[int, _Form] = {}
    found: list[_Form] = [{} for _ in range(function.numel_out(0))]
    for k in range(function.n_instructions()):
        code = function.instruction_id(k)
        out, source = function.instruction_output(k), function.instruction_input(k)
        if code == ca.OP_CONST:
            work[out[0]] = _constant(Fraction(function.instruction_constant(k)))
        elif code == ca.OP_INPUT:
            which, i = source
            work[out[0]] = _constant(given[i]) if which else {i: Fraction(1)}
        elif code == ca.OP_OUTPUT:
            found[out[1]] = work[source[0]]
        else:
            work[out[0]] = _result(code, [work[i] for i in source])
    return found


def _constant(x: Fraction) -> _Form:
    return {_CONSTANT: x} if x else {}


def _number(form: _Form) -> Fraction | None:
    """What a form is where it is constant."""
    if not form:
        return Fraction(0)
    return form[_CONSTANT] if len(form) == 1 and _CONSTANT in form else None


def _times(form: _Form, factor: Fraction) -> _Form:
    return {k: x * factor for k, x in form.items()} if factor else {}


def _plus(one: _Form, other: _Form) -> _Form:
    few, many = (one, other) if len(one) < len(other) else (other, one)
    found = dict(many)
    for k, x in few.items():
        both = found.pop(k, 0) + x
        if both:
            found[k] = both
    return found


def _result(code: int, operands: list[_Form]) -> _Form:
    """Of an operation."""
    if code == ca.OP_ASSIGN:
        return operands[0]
    if code == ca.OP_ADD:
        return _plus(*operands)
    if code in (ca.OP_NEG, ca.OP_TWICE):
        return _times(operands[0], Fraction(-1 if code == ca.OP_NEG else 2))
    if code == ca.OP_SUB:
        return _plus(operands[0], _times(operands[1], Fraction(-1)))
    numbers = [_number(x) for x in operands]
    if code == ca.OP_MUL and None in numbers and any(x is not None for x in numbers):
        factor = numbers[0] if numbers[0] is not None else numbers[1]
        return _times(operands[numbers.index(None)], factor or Fraction(0))
    if code == ca.OP_DIV and (under := numbers[1]) is not None:
        return _times(operands[0], 1 / under)
    known = [x for x in numbers if x is not None]
    if len(known) < len(numbers):
        raise _NoSum
    if code in (ca.OP_MUL, ca.OP_SQ):
        return _constant(known[0] * known[-1])
    if code == ca.OP_INV:
        return _constant(1 / known[0])
    return _constant(Fraction(float(_single(code, len(known))(*map(float, known)))))


@cache
def _single(code: int, operands: int) -> ca.Function:
    """An operation of numbers."""
    symbols = [ca.SX.sym("a"), ca.SX.sym("b")][:operands]
    value = ca.SX.binary(code, *symbols) if operands == 2 else ca.SX.unary(code, *symbols)
    return ca.Function("single", symbols, [value])

"""How fast a scene moves where it is: the rate ω(q) behind ``time_scale="auto"``.

Small motions about a point of the way obey δa = A δq + B δv with A = ∂a/∂q and B = ∂a/∂v; where A
depends on q alone its size says how short steps must be. The measure tr(A²) of A = −M⁻¹ ∂²V/∂q² is
the sum of the fourth powers of the local frequencies, the same in all linear coordinates, so it has
every linear symmetry of the scene: its square root is the Frobenius norm of A where the masses are
one. A potential is a sum: its terms are taken one by one where each is a function of one linear or
quadratic form (a distance), which costs a few operations a term, and terms that cancel in A do not
then hide how fast each of them varies. Elsewhere it is the whole matrix. The terms' ω² add up: the
fastest sets the pace, and the smoothest way to let it is the most accurate (seven bodies in 84
steps: 7e-12 by the sum of ω², 7e-8 by that of ω⁴).

Where V'' of a function of a linear form passes through zero, its force does not stop to change: the
product of V' and the third derivative has the unit of V''² and stands beside it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import reduce
from operator import or_
from random import Random
from typing import NamedTuple

import casadi as ca
import numpy as np

from varint.discrete.legendre import mass_solve
from varint.errors import VarintError
from varint.numerics.operations import operations_of, values_of
from varint.numerics.places import normal_numbers, uniform_numbers
from varint.scene.memory import per_system
from varint.scene.system import System

# in expressions of the rate: a small one, a parameter of each run
SLOWEST_RATE = ca.SX.sym("slowest rate")
FLAT = 0.25  # of the slowest rate: what a term counts at least
PLACES = 5  # at which an identity is tried
SAME = 1e-9  # relative: an identity holds
DENOMINATOR = 24  # denominator of powers that are written without their round-off


@dataclass(frozen=True, eq=False)
class LocalRate:
    """ω² as an expression of q and the parameters, or why there is none.

    Attributes
    ----------
    square : SX or None
        Of q and c, and of `SLOWEST_RATE` where a root could be one of zero.
    reason : str
        Empty where there is a rate that varies.
    """

    square: ca.SX | None
    reason: str = ""


@per_system
def local_rate(system: System) -> LocalRate:
    """ω(q)² = Σ tr((M⁻¹ ∂²V_k/∂q²)²)^½ − ½ tr B² over the terms V_k of the potential."""
    s = system.structure
    if s.constraints or s.nonholonomic:
        return LocalRate(None, "constraints take part in ∂a/∂q")
    if not s.constant_mass:
        return LocalRate(None, "the mass matrix is not constant, so ∂a/∂q depends on velocities")
    turn = ca.jacobian(system.momentum, system.q)
    if ca.depends_on(turn, ca.vertcat(system.q, system.v)):
        return LocalRate(None, "∂a/∂q depends on velocities (a magnetic field that varies)")
    total = rate_of_potential(system) + gyration(system)
    if not ca.depends_on(total, system.q):
        return LocalRate(total, "∂a/∂q is constant: variable steps would change nothing")
    return LocalRate(total)


@dataclass(frozen=True, eq=False)
class _Graph:
    """A potential as operations: their expressions, and a bit for each coordinate that they use."""

    system: System
    nodes: list[tuple]
    expressions: list[ca.SX]
    used: list[int]


def gyration(system: System) -> ca.SX:
    """−½ tr B², by which charges go round."""
    at_rest = ca.substitute(system.momentum, system.v, ca.SX.zeros(system.structure.n))
    turn = ca.jacobian(at_rest, system.q)
    spin = _inverse(system) @ (turn - turn.T)
    return -ca.trace(spin @ spin) / 2


@per_system
def rate_of_potential(system: System) -> ca.SX:
    """Σ tr((M⁻¹ ∂²V_k/∂q²)²)^½, or of the whole where a term is no function of one form."""
    terms = potential_terms(system)
    if terms is None:
        a = _inverse(system) @ ca.hessian(potential_of(system), system.q)[0]
        return root_of(ca.sum1(ca.vec(a * a.T)), system)
    found, of_distance = ca.SX(0), _like_distances(system, terms)
    powers = _powers(system, [x for x, like in zip(terms, of_distance, strict=True) if like])
    for term, like in zip(terms, of_distance, strict=True):
        found += _of_distance(system, term, *next(powers)) if like else _of_form(system, term)
    return found


@per_system
def potential_terms(system: System) -> list[Term] | None:
    """The terms of the potential; None where one of them is no function of one form."""
    try:
        potential = ca.densify(potential_of(system))
        operations = operations_of(ca.Function("V", [system.q, system.c], [potential]))
    except VarintError:
        return None
    nodes, inverse = operations.nodes, _inverse(system)
    graph = _Graph(system, nodes, values_of(nodes, [system.q, system.c]), _coordinates(nodes))
    found = []
    for factor, root in _terms(graph, operations.outputs[0].nodes[0]):
        term = _term(graph, root, inverse, factor)
        if term is None:
            return None
        found.append(term)
    return found


def potential_of(system: System) -> ca.SX:
    """−V: what the Lagrangian is at rest."""
    return ca.substitute(system.lagrangian, system.v, ca.SX.zeros(system.structure.n))


def _inverse(system: System) -> ca.SX:
    return mass_solve(system.mass_matrix, ca.SX.eye(system.structure.n))


def root_of(fourth: ca.SX, system: System, power: int = 2) -> ca.SX:
    """ω² from ω⁴, or from ω⁸ with the power 4; with slopes where it is zero."""
    if not ca.depends_on(fourth, system.q):
        return fourth ** (1 / power)
    least = (FLAT * SLOWEST_RATE) ** (2 * power)
    found = ca.sqrt(fourth + least)
    return found if power == 2 else ca.sqrt(found)


def _coordinates(nodes: list[tuple]) -> list[int]:
    """A bit for each coordinate that a node depends on."""
    found: list[int] = []
    for name, *operands in nodes:
        if name == "input":
            found.append(1 << operands[1] if operands[0] == 0 else 0)
        else:
            found.append(0 if name == "const" else reduce(or_, (found[i] for i in operands)))
    return found


def _terms(graph: _Graph, root: int) -> list[tuple[ca.SX, int]]:
    """Terms that add up to a node, each with a factor free of q; no sign matters."""
    found, open_nodes, moving = [], [(ca.SX(1), root)], graph.used
    while open_nodes:
        factor, i = open_nodes.pop()
        if not moving[i]:
            continue
        name, *operands = graph.nodes[i]
        if name in ("add", "sub"):
            a, b = operands
            open_nodes += [(factor, a), (factor, b)]
        elif name in ("neg", "assign"):
            open_nodes.append((factor, operands[0]))
        elif name == "twice":
            open_nodes.append((2 * factor, operands[0]))
        elif name == "mul" and not all(moving[j] for j in operands):
            a, b = sorted(operands, key=lambda j: bool(moving[j]))
            open_nodes.append((factor * graph.expressions[a], b))
        elif name == "div" and not moving[operands[1]]:
            open_nodes.append((factor / graph.expressions[operands[1]], operands[0]))
        else:
            found.append((factor, i))
    return found[::-1]


def _forms(graph: _Graph, root: int) -> list[int]:
    """Nodes through which all of q enters a term, the innermost first."""
    found: list[int] = []
    front = {root}
    while front:
        if len(front) == 1:
            found += front
        i = max(front)
        front.remove(i)
        name, *operands = graph.nodes[i]
        if name == "input":
            break
        front |= {j for j in operands if graph.used[j]}
    return found[::-1]


def _in_form(graph: _Graph, root: int, form: int, s: ca.SX) -> ca.SX:
    """A term with a symbol in place of the form through which q enters."""
    known: dict[int, ca.SX] = {form: s}
    inside = {root}
    open_nodes = [root]
    while open_nodes:
        for j in graph.nodes[open_nodes.pop()][1:]:
            if j == form or j in inside:
                continue
            if not graph.used[j]:
                known[j] = graph.expressions[j]
                continue
            inside.add(j)
            open_nodes.append(j)
    if root == form:
        return s
    order = [*known, *sorted(inside)]
    place = {j: k for k, j in enumerate(order)}
    nodes: list[tuple] = [("input", 0, k) for k in range(len(known))]
    for j in sorted(inside):
        name, *operands = graph.nodes[j]
        nodes.append((name, *(place[i] for i in operands)))
    return values_of(nodes, [ca.vertcat(*known.values())])[place[root]]


class Term(NamedTuple):
    """V(s) of a linear or quadratic form s: the term and the form as expressions, which operation
    the form is, the factor of the term, a symbol s and in it V, V', V''; |∇s|², tr a² and tr a of
    a = M⁻¹ ∂²s/∂q², a ∇s·M⁻¹∇s, and whether the form is linear.
    """

    term: ca.SX
    form: ca.SX
    operation: int
    factor: ca.SX
    s: ca.SX
    value: ca.SX
    first: ca.SX
    second: ca.SX
    speed: ca.SX
    size: ca.SX
    trace: ca.SX
    gap: ca.SX
    linear: bool

    def at_form(self, x: ca.SX) -> ca.SX:
        return ca.substitute(x, self.s, self.form)


def _term(graph: _Graph, root: int, inverse: ca.SX, factor: ca.SX) -> Term | None:
    """What the rate of a term is made of; None where it is a function of no single form."""
    system = graph.system
    for i in _forms(graph, root):
        form = graph.expressions[i]
        used = [j for j in range(system.q.numel()) if graph.used[i] >> j & 1]
        q = system.q[used]
        curvature, slope = ca.hessian(form, q)
        if not ca.depends_on(curvature, q):
            break
    else:
        return None
    s, inverse = ca.SX.sym("s"), inverse[used, used]
    value = factor * _in_form(graph, root, i, s)
    first = ca.gradient(value, s)
    second = ca.gradient(first, s)
    ahead = inverse @ slope
    speed = ca.dot(slope, ahead)
    a = inverse @ curvature
    size, trace = ca.sum1(ca.vec(a * a.T)), ca.trace(a)
    about = size, trace, ca.dot(slope, a @ inverse @ slope), curvature.is_zero()
    return Term(graph.expressions[root], form, i, factor, s, value, first, second, speed, *about)


def _of_form(system: System, x: Term) -> ca.SX:
    """tr((M⁻¹ ∂²V/∂q²)²)^½ of any linear or quadratic form."""
    if x.linear:
        beside = x.first * ca.gradient(x.second, x.s)
        if beside.is_zero():
            return ca.fabs(x.at_form(x.second) * x.speed)
        eighth = x.at_form(x.second**4 + beside**2) * x.speed**4
        return root_of(eighth, system, 4)
    one, two = x.at_form(x.first), x.at_form(x.second)
    return root_of(one**2 * x.size + 2 * one * two * x.gap + (two * x.speed) ** 2, system)


def _of_distance(system: System, x: Term, rank: int, power: float | None) -> ca.SX:
    """The same where s = ½ (q − c)ᵀS(q − c) with S M⁻¹ S = share · S."""
    share = x.size / x.trace
    if power is not None:
        bracket = (2 * power - 1) ** 2 + rank - 1
        size = abs(power) * bracket**0.5 * ca.fabs(share * x.factor)
        return size * ca.fabs(x.term / x.form)  # of one sign
    inner = (x.first + 2 * x.s * x.second) ** 2 + (rank - 1) * x.first**2
    return root_of(share**2 * x.at_form(inner), system)


def _parameters(system: System, random: Random) -> np.ndarray:
    """Values near the defaults: what holds for these by chance alone does not count."""
    c = np.asarray(system.default_vector)
    return np.where(c == 0, 1.0, c) * uniform_numbers(random, 0.8, 1.25, len(c))


def _powers(system: System, terms: list[Term]) -> Iterator[tuple[int, float | None]]:
    """Of each term the rank of S, and p where V = A sᵖ; None where it is no power."""
    if not terms:
        return
    ranks = ca.vertcat(*(x.trace**2 / x.size for x in terms))
    found = ca.Function("ranks", [system.c], [ranks])(_parameters(system, Random(2)))
    # the factor of a term drops out
    s, ratios = ca.SX.sym("s"), list[ca.SX]()
    for x in terms:
        both = ca.vertcat(1 + x.s * x.second / x.first, x.s * x.first / x.value)
        ratios.append(ca.substitute(both, x.s, s))
    f = ca.Function("ratios", [s, system.c], [ca.horzcat(*ratios)])
    random = Random(3)
    places = uniform_numbers(random, 0.5, 2.0, PLACES)
    tried = np.array([f(y, _parameters(system, random)).full() for y in places])
    for k, rank in enumerate(found.full().ravel()):
        yield round(float(rank)), _power(tried[:, :, k])


def _power(found: np.ndarray) -> float | None:
    power = found[0, 0]
    if not (np.isfinite(found).all() and (np.abs(found - power) <= SAME * abs(power)).all()):
        return None
    return (
        round(DENOMINATOR * power) / DENOMINATOR
        if _whole_number(DENOMINATOR * power)
        else float(power)
    )


def _whole_number(x: float) -> bool:
    return abs(x - round(x)) <= SAME * max(abs(x), 1.0)


def _like_distances(system: System, terms: list[Term]) -> list[bool]:
    """Which forms are ½ (q − c)ᵀS(q − c) with S M⁻¹ S = share · S, as of every distance: where
    |∇s|² = 2 share s wherever it is looked at.
    """
    quadratic = [x for x in terms if not x.linear]
    if not quadratic:
        return [False] * len(terms)
    speeds = ca.vertcat(*(x.speed for x in quadratic))
    wanted = ca.vertcat(*(2 * (x.size / x.trace) * x.form for x in quadratic))
    f = ca.Function("parts", [system.q, system.c], [ca.densify(speeds), ca.densify(wanted)])
    random, alike = Random(4), np.ones(len(quadratic), dtype=bool)
    for _ in range(PLACES):
        q = normal_numbers(random, system.structure.n)
        one, other = (x.full().ravel() for x in f.call([q, _parameters(system, random)]))
        known = np.isfinite(one) & np.isfinite(other)
        same = np.abs(one - other) <= SAME * np.maximum(np.abs(one), np.abs(other))
        alike &= same | ~known
    each = iter(alike.tolist())
    return [not x.linear and next(each) for x in terms]

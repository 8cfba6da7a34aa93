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
from random import Random

import casadi as ca
import numpy as np

from varint.integration.time_transformation.potential_terms import (
    Term,
    constants_of,
    inverse_mass,
    potential_of,
    potential_terms,
)
from varint.integration.time_transformation.time_signals import signals_of
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
    """ω(q)² = Σ tr((M⁻¹ ∂²V_k/∂q²)²)^½ − ½ tr B² over the terms V_k of the potential, and what
    forces and signals in time add.
    """
    s = system.structure
    if s.constraints or s.nonholonomic:
        return LocalRate(None, "constraints take part in ∂a/∂q")
    if not s.constant_mass:
        return LocalRate(None, "the mass matrix is not constant, so ∂a/∂q depends on velocities")
    turn = ca.jacobian(system.momentum, system.q)
    if ca.depends_on(turn, ca.vertcat(system.q, system.v)):
        return LocalRate(None, "∂a/∂q depends on velocities (a magnetic field that varies)")
    total = rate_of_potential(system) + gyration(system) + rate_of_others(system)
    if not ca.depends_on(total, ca.vertcat(system.q, system.t)):
        return LocalRate(total, "∂a/∂q is constant: variable steps would change nothing")
    return LocalRate(total)


def gyration(system: System) -> ca.SX:
    """−½ tr B², by which charges go round."""
    at_rest = ca.substitute(system.momentum, system.v, ca.SX.zeros(system.structure.n))
    turn = ca.jacobian(at_rest, system.q)
    spin = inverse_mass(system) @ (turn - turn.T)
    return -ca.trace(spin @ spin) / 2


def rate_of_others(system: System) -> ca.SX:
    """Of forces ‖M⁻¹ ∂F/∂q‖ at rest, and ½ ‖M⁻¹ ∂F/∂v‖² where they are linear in v, by norms that
    no linear change of coordinates alters; what else they do with v is no function of q. And the
    square of the rate of signals in time.
    """
    found, beat = ca.SX(0), signals_of(system).rate
    if beat is not None:
        found += beat**2
    if not system.structure.forced:
        return found
    still = ca.SX.zeros(system.structure.n)
    pushed = ca.jacobian(ca.substitute(system.force, system.v, still), system.q)
    damped = ca.jacobian(system.force, system.v)
    if pushed.nnz():
        found += root_of(_square_norm(system, pushed), system)
    if damped.nnz() and not ca.depends_on(damped, system.v):
        found += _square_norm(system, damped) / 2
    return found


def _square_norm(system: System, a: ca.SX) -> ca.SX:
    """tr(M⁻¹ a M⁻¹ aᵀ)."""
    inverse = inverse_mass(system)
    return ca.sum1(ca.vec((inverse @ a) * (a @ inverse)))


@per_system
def rate_of_potential(system: System) -> ca.SX:
    """Σ tr((M⁻¹ ∂²V_k/∂q²)²)^½, or of the whole where a term is no function of one form."""
    terms = potential_terms(system)
    if terms is None:
        a = inverse_mass(system) @ ca.hessian(potential_of(system), system.q)[0]
        return root_of(ca.sum1(ca.vec(a * a.T)), system)
    found, of_distance = ca.SX(0), _like_distances(system, terms)
    powers = _powers(system, [x for x, like in zip(terms, of_distance, strict=True) if like])
    for term, like in zip(terms, of_distance, strict=True):
        found += _of_distance(system, term, *next(powers)) if like else _of_form(system, term)
    return found


def root_of(fourth: ca.SX, system: System, power: int = 2) -> ca.SX:
    """ω² from ω⁴, or from ω⁸ with the power 4; with slopes where it is zero."""
    if not ca.depends_on(fourth, system.q):
        return fourth ** (1 / power)
    least = (FLAT * SLOWEST_RATE) ** (2 * power)
    found = ca.sqrt(fourth + least)
    return found if power == 2 else ca.sqrt(found)


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
    """Values of the constants near the defaults, and some time: what holds for these by chance
    alone does not count.
    """
    c = np.append(system.default_vector, [0.0] * (not system.structure.autonomous))
    return np.where(c == 0, 1.0, c) * uniform_numbers(random, 0.8, 1.25, len(c))


def _powers(system: System, terms: list[Term]) -> Iterator[tuple[int, float | None]]:
    """Of each term the rank of S, and p where V = A sᵖ; None where it is no power."""
    if not terms:
        return
    ranks = ca.vertcat(*(x.trace**2 / x.size for x in terms))
    constants = constants_of(system)
    found = ca.Function("ranks", [constants], [ranks])(_parameters(system, Random(2)))
    # the factor of a term drops out
    s, ratios = ca.SX.sym("s"), list[ca.SX]()
    for x in terms:
        both = ca.vertcat(1 + x.s * x.second / x.first, x.s * x.first / x.value)
        ratios.append(ca.substitute(both, x.s, s))
    f = ca.Function("ratios", [s, constants], [ca.horzcat(*ratios)])
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
    results = [ca.densify(speeds), ca.densify(wanted)]
    f = ca.Function("parts", [system.q, constants_of(system)], results)
    random, alike = Random(4), np.ones(len(quadratic), dtype=bool)
    for _ in range(PLACES):
        q = normal_numbers(random, system.structure.n)
        one, other = (x.full().ravel() for x in f.call([q, _parameters(system, random)]))
        known = np.isfinite(one) & np.isfinite(other)
        same = np.abs(one - other) <= SAME * np.maximum(np.abs(one), np.abs(other))
        alike &= same | ~known
    each = iter(alike.tolist())
    return [not x.linear and next(each) for x in terms]

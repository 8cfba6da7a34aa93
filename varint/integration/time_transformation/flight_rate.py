"""How fast a scene moves where its motion flies: the rate ω(q) of its small motions, and how fast
the way leads to where that is another one.

What comes from afar to a centre of force has hardly any forces to tell of it: steps by their rate
alone leap over the centre. So the distance that is left counts as well, by the time in which it is
passed: ω² + 2T Σ (½ V'_k''/V_k')² |∇s_k|² over the terms V_k(s_k) of the potential whose forces
become the larger the nearer to s_k = 0, (1.5 v/r)² for any power of a distance r; and the same of
the rate at which a charge turns in a magnetic field that varies. With the energy E0 of the start,
2T = 2 (E0 − V(q)) is a function of q: so is the time scale, and all that `time_scale` says holds.
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from varint.discrete.legendre import mass_solve
from varint.integration.time_transformation.local_rate import (
    FLAT,
    SLOWEST_RATE,
    LocalRate,
    gyration,
    rate_of_others,
    rate_of_potential,
    root_of,
)
from varint.integration.time_transformation.metric_rate import metric_rate
from varint.integration.time_transformation.potential_terms import (
    Term,
    constants_of,
    potential_of,
    potential_terms,
)
from varint.integration.work_bound import keeps_energy
from varint.scene.memory import per_system
from varint.scene.system import System

TWICE_KINETIC = ca.SX.sym("twice the kinetic energy")  # of which the rate is an expression, too
INITIAL_ENERGY = ca.SX.sym("initial energy")
# values of a form at which its term is looked at: of all units that anyone takes
SIZES = np.logspace(-30, 30, 301)
CHANGE = 0.5  # of the rate by that of the force: its square is as V'
LEFT = 0.1  # of the potential: a kinetic energy at least where that of the start's level is unsure
POWER = -1.5  # s V''/V' of 1/r, for which any power of a distance is taken
SAME = 1e-9


@per_system
def flight_rate(system: System) -> LocalRate:
    """The square of the rate, of q, c, `SLOWEST_RATE` and `TWICE_KINETIC`."""
    s = system.structure
    if s.constraints or s.nonholonomic or not s.quadratic_kinetic:
        return LocalRate(None, "∂a/∂q depends on more than coordinates")
    if ca.depends_on(system.mass_matrix, system.t):
        return LocalRate(None, "the mass matrix depends on time")
    others = rate_of_others(system)
    if not s.constant_mass:
        change = metric_rate(system)
        if change is None:
            return LocalRate(None, "the mass matrix changes by about as much everywhere")
        a = mass_solve(system.mass_matrix, ca.hessian(potential_of(system), system.q)[0])
        inertial = TWICE_KINETIC * change  # under the root: it is smooth where ∂²V/∂q² vanishes
        whole = ca.sum1(ca.vec(a * a.T)) + inertial**2
        return LocalRate(root_of(whole, system) + gyration(system) + others)
    turn = gyration(system)
    change = _of_terms(system) + _of_gyration(system, turn)
    if change.is_zero():
        return LocalRate(None, "no force becomes larger on the way to a point or in a field")
    return LocalRate(rate_of_potential(system) + turn + TWICE_KINETIC * change + others)


def kinetic_at(system: System) -> ca.SX:
    """2T of q and c on the level of `INITIAL_ENERGY`; roughly where it changes, and positive."""
    here = INITIAL_ENERGY + potential_of(system)
    if keeps_energy(system):
        return 2 * here
    return 2 * ca.sqrt(here**2 + (LEFT * potential_of(system)) ** 2)


def _of_gyration(system: System, turn: ca.SX) -> ca.SX:
    """(½ |∇g|/g)² of g, the square of the rate at which charges turn."""
    if not ca.depends_on(turn, system.q):
        return ca.SX(0)
    slope = ca.gradient(turn, system.q)
    speed = ca.dot(slope, mass_solve(system.mass_matrix, slope))
    return speed / (4 * (turn**2 + (FLAT * SLOWEST_RATE) ** 4))


def _of_terms(system: System) -> ca.SX:
    """Σ (½ V''/V')² |∇s|² of the forms that terms with such forces have."""
    found, terms = ca.SX(0), potential_terms(system)
    if not terms:
        return found
    seen = set()
    for x, change in zip(terms, _changes(system, terms), strict=True):
        if change is None or x.operation in seen:
            continue
        seen.add(x.operation)
        found += (CHANGE * x.at_form(change)) ** 2 * x.speed
    return found


def _changes(system: System, terms: list[Term]) -> list[ca.SX | None]:
    """V''/V' of each term as an expression of its form, where |V'| shrinks with |s| and vanishes
    nowhere: nowhere else does a force become larger on the way to s = 0, and where it vanishes
    there is no rate.
    """
    s = ca.SX.sym("s")
    each = [ca.substitute(ca.vertcat(x.s * x.second / x.first, x.first), x.s, s) for x in terms]
    constants = constants_of(system)
    f = ca.Function("changes", [s, constants], [ca.vertcat(*each)])
    sizes = np.concatenate((-SIZES, SIZES))
    with np.errstate(all="ignore"):
        given = np.append(system.default_vector, [1.0] * (not system.structure.autonomous))
        tried = f(sizes[None], given).full().reshape(len(terms), 2, -1)
    found: list[ca.SX | None] = []
    for x, (y, first) in zip(terms, tried, strict=True):
        there = np.isfinite(y) & (x.linear | (sizes > 0))
        known, pulls = y[there], np.split(np.where(there, np.sign(first), 0.0), 2)
        turns = any(pull.min() < 0 < pull.max() for pull in pulls)
        if turns or not (known.size and (known <= SAME).all() and known.min() < -SAME):
            found.append(None)
        elif np.ptp(known) <= SAME * abs(known[0]):
            found.append(POWER / x.s)
        else:
            found.append(x.second / x.first)
    return found

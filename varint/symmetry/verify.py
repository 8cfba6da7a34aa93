"""Whether a generator is a symmetry of the Lagrangian, and what else in the scene does not share
it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import casadi as ca
import numpy as np

from varint.errors import InputError
from varint.numerics.arrays import over_columns
from varint.scene.restitution import loses_energy
from varint.scene.system import System
from varint.symmetry.identities import Evaluated, Values, evaluate
from varint.symmetry.sampling import Points, Region, at_points, join_points, lively_points, sample
from varint.symmetry.search import exactly, slopes_function

CHECKS = 40  # fresh random points …
CHECKS_OF_LIFE = 400  # … and so many near the places that the scene's constants name
# residual relative to the sum of its terms' absolute values; true symmetries leave 1e-16 to 1e-12
TOLERANCE = 1e-9
# of L: terms that should cancel inside ∂L/∂q leave rounding errors measured against it
LEAST_TERM = 1e-3
ROUNDING = 1e-16
SHOWN = 4  # coordinates of a point in a message
ON_SURFACE = 1e-12
MOST_PROJECTIONS = 50


def variation(system: System, xi: ca.SX, tau: ca.SX) -> ca.SX:
    """δL − d(τL)/dt = ∂L/∂q·ξ + ∂L/∂v·ξ̇ − τ ∂L/∂t."""
    s = system
    change = ca.dot(ca.gradient(s.lagrangian, s.q), xi) + ca.dot(s.momentum, rate(system, xi))
    return change - tau * ca.jacobian(s.lagrangian, s.t)


def rate(system: System, xi: ca.SX) -> ca.SX:
    """d/dt of an expression of q and t."""
    return ca.jtimes(xi, system.q, system.v) + ca.jacobian(xi, system.t)


def balance(system: System, xi: ca.SX, tau: ca.SX, gauge: ca.SX) -> ca.SX:
    """Terms of δL − d(τL + K)/dt; for a symmetry their sum vanishes."""
    s = system
    slopes = (ca.gradient(s.lagrangian, s.q), s.momentum, ca.jacobian(s.lagrangian, s.t))
    return _terms(s, xi, tau, gauge, *slopes)


def _terms(s: System, xi, tau, gauge, by_q: ca.SX, by_v: ca.SX, by_t: ca.SX) -> ca.SX:
    rest = [-tau * by_t, -ca.gradient(gauge, s.q) * s.v, -ca.jacobian(gauge, s.t)]
    return ca.vertcat(by_q * xi, by_v * rate(s, xi), *rest)


def identities(region: Region, expressions: list[ca.SX]) -> Values:
    """Values of the expressions modulo a prime: columns of zeros for those that vanish
    identically.
    """
    function = at_points(region.system, "identity", [ca.vertcat(*expressions)])
    return exactly(region, function).values


def balances(region: Region, generators: list[tuple[ca.SX, ca.SX, ca.SX]]) -> Values:
    """δL − d(τL + K)/dt of generators (ξ, τ, K), modulo a prime: a column of zeros for a symmetry.

    The slopes of L are evaluated once for all of them.
    """
    s = region.system
    slopes = [ca.SX.sym("slope", x) for x in (s.q.numel(), s.q.numel(), 1)]
    left = [ca.sum1(_terms(s, *generator, *slopes)) for generator in generators]
    known = _slopes(region)
    arguments = [s.q, s.v, ca.SX.sym("a", s.q.numel()), s.control, s.t, s.c, *slopes]
    function = ca.Function("balance", arguments, [ca.densify(ca.vertcat(*left))], {"cse": True})
    return evaluate(function, [], known=known).values


@lru_cache(maxsize=4)
def _slopes(region: Region) -> Evaluated:
    return exactly(region, slopes_function(region.system))


def is_balanced(region: Region, xi: ca.SX, tau: ca.SX, gauge: ca.SX) -> bool:
    """Whether δL = d(τL + K)/dt by the rules of algebra."""
    return not balances(region, [(xi, tau, gauge)]).rows.any()


def residual(region: Region, xi: ca.SX, tau: ca.SX, gauge: ca.SX, rng) -> tuple[float, Points]:
    """Largest |δL − d(τL + K)/dt| relative to its terms over random points, and the point where
    it occurs.
    """
    return _worst(region, _balance_function(region.system, xi, tau, gauge), rng)


def _balance_function(s: System, xi: ca.SX, tau: ca.SX, gauge: ca.SX) -> ca.Function:
    """(q, v, a, u, t, c) → what is left of the balance, and the size of its terms."""
    parts = balance(s, xi, tau, gauge)
    least = (
        LEAST_TERM * ca.norm_inf(xi) * (ca.sum1(ca.fabs(s.momentum * s.v)) + ca.fabs(s.lagrangian))
    )
    size = ca.fmax(ca.sum1(ca.fabs(parts)), least)
    return at_points(s, "symmetry", [ca.sum1(parts), size])


@dataclass(frozen=True)
class Proof:
    """How it is known that something vanishes, or what is left of it where it does not."""

    holds: bool
    left: float  # relative to its terms
    tested: str  # in words
    where: str = ""  # the point where most of it is left


IDENTICAL = Proof(True, 0.0, "identically")


def proof(region: Region, xi: ca.SX, tau: ca.SX, gauge: ca.SX, rng) -> Proof:
    """Whether δL = d(τL + K)/dt: by the rules of algebra, or else at sampled points."""
    values = balances(region, [(xi, tau, gauge)])
    if not values.rows.any():
        return IDENTICAL
    return sampled_proof(
        region, _balance_function(region.system, xi, tau, gauge), values.decided, rng
    )


def sampled_proof(region: Region, function: ca.Function, decided: bool, rng) -> Proof:
    """Whether (what is left, size of its terms) vanishes where it was sampled: at points of all
    sizes, and where the scene's own constants say that it lives.

    What algebra has `decided` not to vanish does not, wherever it may live.
    """
    left, where = _worst(region, function, rng)
    lively = lively_points(region, CHECKS_OF_LIFE, rng)
    values = over_columns(function, *lively.columns)
    good = np.isfinite(values[0]).all(axis=1) & np.isfinite(values[1]).all(axis=1)
    count, reach = CHECKS + int(good.sum()), np.abs(where.q).max()
    if good.any():
        ratio, points = _ratio(values[0][good], values[1][good]), lively[good]
        reach = np.abs(points.q).max()
        if ratio.max() > left:
            worst = int(np.argmax(ratio))
            left, where = float(ratio[worst]), points[worst : worst + 1]
    holds = left <= TOLERANCE and not decided
    tested = f"to {max(left, ROUNDING):.0e} at {count} points up to {reach:.0e}"
    pairs = zip(region.system.names[:SHOWN], where.q[0], strict=False)
    return Proof(holds, left, tested, ", ".join(f"{x}={y:.3g}" for x, y in pairs))


def _worst(region: Region, function: ca.Function, rng) -> tuple[float, Points]:
    points, (left, size) = sample(region, function, CHECKS, rng)
    ratio = _ratio(left, size)
    worst = int(np.argmax(ratio))
    return float(ratio[worst]), points[worst : worst + 1]


def _ratio(left: np.ndarray, size: np.ndarray) -> np.ndarray:
    return np.abs(left).max(axis=1) / np.where(size[:, 0] > 0, size[:, 0], 1.0)


def broken_by(region: Region, xi: ca.SX, tau: ca.SX, rng) -> tuple[str, ...]:
    """What in the scene, other than L, does not share the symmetry.

    Forces must do no work along ξ + τ v, non-holonomic reactions none along ξ; constraints and
    contacts must be invariant on their surfaces, and a shift of time needs elastic impacts.
    """
    s, structure = region.system, region.system.structure
    broken = []
    if structure.constraints and not _invariant(region, s.constraint, xi, tau, rng):
        broken.append("constraint")
    if structure.nonholonomic:
        size = _product_size(s.nonholonomic, xi)
        if not _vanishes(region, ca.mtimes(s.nonholonomic, xi), size, rng):
            broken.append("nonholonomic")
    if structure.forced:
        along = xi + tau * s.v
        size = ca.dot(ca.fabs(s.force), ca.fabs(along))
        if not _vanishes(region, ca.dot(s.force, along), size, rng):
            broken.append("force")
    if structure.contacts:
        free = all(
            _invariant(region, s.contact[i], xi, tau, rng) for i in range(structure.contacts)
        )
        if not free or (not tau.is_zero() and loses_energy(s)):
            broken.append("contact")
    return tuple(broken)


def _vanishes(region: Region, work: ca.SX, size: ca.SX, rng) -> bool:
    """Whether work of this size is none."""
    values = identities(region, [work])
    if not values.rows.any():
        return True
    function = at_points(region.system, "work", [work, size])
    return sampled_proof(region, function, values.decided, rng).holds


def _product_size(rows: ca.SX, column: ca.SX) -> ca.SX:
    return ca.sum1(ca.mtimes(ca.fabs(rows), ca.fabs(column)))


def _invariant(region: Region, surface: ca.SX, xi: ca.SX, tau: ca.SX, rng) -> bool:
    """Whether ∂g/∂q ξ − τ ∂g/∂t = 0 where g = 0."""
    s = region.system
    slope, by_t = ca.jacobian(surface, s.q), ca.jacobian(surface, s.t)
    change = ca.mtimes(slope, xi) - tau * by_t
    if not identities(region, [change]).rows.any():
        return True
    size = _product_size(slope, xi) + ca.norm_1(ca.vec(tau * by_t))
    function = at_points(s, "invariance", [surface, slope, change, size])
    points, _ = sample(region, function, CHECKS, rng)
    points = join_points(points, lively_points(region, CHECKS, rng))
    held = project_onto_surface(points, function, surface.numel())
    _, _, left, total = over_columns(function, *held.columns)
    return bool(
        (np.abs(left).max(axis=1) <= TOLERANCE * np.where(total[:, 0] > 0, total[:, 0], 1.0)).all()
    )


def project_onto_surface(points: Points, function: ca.Function, m: int) -> Points:
    """Those of the points that Gauss–Newton steps bring onto the surface g = 0; never none."""
    n = points.q.shape[1]
    q, t = points.q.copy(), points.t
    held = np.zeros(len(q), dtype=bool)
    for _ in range(MOST_PROJECTIONS):
        now, left = Points(q, points.v, points.a, points.u, t, points.c), np.flatnonzero(~held)
        g, slope, *_ = over_columns(function, *now[left].columns)
        good = np.isfinite(g).all(axis=1) & np.isfinite(slope).all(axis=1)
        g, slope = np.where(good[:, None], g, 0.0), np.where(good[:, None], slope, 0.0)
        held[left] = good & (
            np.abs(g).max(axis=1) <= ON_SURFACE * (1 + np.abs(q[left]).max(axis=1))
        )
        rows = slope.reshape(-1, n, m).transpose(0, 2, 1)
        # once more where it is held: free
        q[left] -= np.einsum("snm,sm->sn", np.linalg.pinv(rows, rcond=1e-10), g)
        if held.all():
            break
    now = Points(q, points.v, points.a, points.u, t, points.c)
    if not held.any():
        raise InputError(
            "no point was found where the constraints or contacts hold; give near=q close to one"
        )
    return now[held]

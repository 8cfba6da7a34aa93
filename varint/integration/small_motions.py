"""Frequencies of small motions about a place of the way, as if it were an equilibrium."""

from __future__ import annotations

import math
from functools import lru_cache

import casadi as ca
import numpy as np

from varint.discrete.legendre import (
    first_order_velocity,
    full_inertia,
    mass_solve,
    velocity_function,
)
from varint.numerics.arrays import DEFINITE, call, is_definite, over_columns
from varint.results.trajectory import Trajectory
from varint.scene.memory import per_scene
from varint.scene.system import System

MOST_COORDINATES = 60  # beyond, eigenvalues cost more than what they tell of quick steps,
MOST_AT_ALL = 128  # and of long ones, or of dampers that are stiff
MOST_TURNED = 1e6  # radians: more than any first run is for
REMEMBERED = 256  # of what motions turn by
FASTER = 1.25  # times the frequency at the start: steps that suit that one are lost
FEW = 6  # coordinates whose uncoupled parts are looked for: one or two have a formula


@per_scene
def is_looked_at(system: System) -> bool:
    """Whether eigenvalues tell more of a scene than they cost: beside steps whose inertia is
    factorised in loops they cost little.
    """
    n = system.structure.n
    return n <= MOST_COORDINATES or (n <= MOST_AT_ALL and full_inertia(system))


def angle_turned(duration: float, fastest: float | None) -> float:
    """By how much motions of this frequency turn, for the choice of steps: 0 where it is not
    known.
    """
    turned = float(abs(duration) * (fastest or 0.0))
    if turned < MOST_TURNED:
        return turned
    return MOST_TURNED if math.isfinite(turned) else 0.0


@lru_cache(REMEMBERED)
def angles_turned(duration: float, fastest: float | None, ahead: float) -> tuple[float, float]:
    """`angle_turned` by the fastest motion at the start, and by the one that the first steps are
    for: by what is seen `ahead`, where the start tells of nothing as fast. The same object for the
    same numbers: what was chosen by it need not be chosen anew.
    """
    here = angle_turned(duration, fastest)
    if not ahead:
        return here, here
    there = angle_turned(duration, ahead)
    return here, there if there > FASTER * here else here


def frequencies(motion: Trajectory) -> np.ndarray:
    """Largest frequency ω of small motions about each node, from det(∂²L/∂q² + ω² M) = 0, where
    `turning` counts in ∂²L/∂q².
    """
    if not is_looked_at(motion.system):
        return np.empty(0)
    if motion.system.structure.degenerate:
        return _rates_of_first_order(motion)
    found = []
    for mass, stiffness in zip(*local_matrices(motion), strict=True):
        fastest = frequency(mass, stiffness)
        if fastest is None:
            return np.empty(0)
        if not math.isfinite(fastest):
            break
        found.append(fastest)
    return np.array(found)


def _rates_of_first_order(motion: Trajectory) -> np.ndarray:
    """Largest |λ| of ∂v/∂q of a degenerate scene at each node until one where it is no number."""
    if (function := _first_order_slope(motion.system)) is None:
        return np.empty(0)
    n = motion.system.structure.n
    slopes = over_columns(function, motion.q, motion.t[:, None], motion.c)[0].reshape(-1, n, n)
    bad = np.flatnonzero(~np.isfinite(slopes).all(axis=(1, 2)))
    return np.abs(np.linalg.eigvals(slopes[: bad[0] if bad.size else None])).max(axis=1)


@per_scene
def _first_order_slope(system: System) -> ca.Function | None:
    """(q, t, c) → ∂v/∂q of a degenerate scene, where v is known as an expression."""
    s, v = system, first_order_velocity(system)
    if v is None:
        return None
    slope = ca.densify(ca.jacobian(v, s.q))
    return ca.Function("slope", [s.q, s.t, s.c], [slope], {"cse": True})


def frequency(mass: np.ndarray, stiffness: np.ndarray) -> float | None:
    """Largest ω with det(∂²L/∂q² + ω² M) = 0; not finite where the matrices are not, None where a
    coordinate has no inertia.
    """
    return _frequency(mass.ravel().tolist(), stiffness.ravel().tolist(), len(mass))


def _frequency(m: list[float], k: list[float], n: int) -> float | None:
    """`frequency` of (n, n) matrices, row by row."""
    if not math.isfinite(sum(m) + sum(k)):
        return math.nan
    if n == 1:
        return math.sqrt(abs(k[0] / m[0])) if m[0] > 0 else None
    if n == 2:
        (a, b, c, d), (e, f, g, h) = m, k
        if a <= 0 or d <= 0:
            return None
        if b == 0 == c:
            return _fastest_of_two(e / a, f / a, g / d, h / d)
        volume = a * d - b * c
        if volume > DEFINITE * a * d:
            rows = d * e - b * g, d * f - b * h, a * g - c * e, a * h - c * f
            return _fastest_of_two(*[x / volume for x in rows])
    elif n and min(m[:: n + 1]) <= 0:
        return None
    if not any(k):
        return 0.0
    if n <= FEW and len(parts := _parts(m, k, n)) > 1:
        fastest = 0.0
        for part in parts:
            mine, its = ([x[n * i + j] for i in part for j in part] for x in (m, k))
            found = _frequency(mine, its, len(part))
            if found is None or not math.isfinite(found):
                return found
            fastest = max(fastest, found)
        return fastest
    mass, stiffness = np.array(m).reshape(n, n), np.array(k).reshape(n, n)
    if is_definite(mass):
        square = np.linalg.solve(mass, stiffness)
    else:
        square = np.linalg.pinv(mass, hermitian=True) @ stiffness
    if not np.isfinite(square).all():
        return math.nan
    return math.sqrt(np.abs(np.linalg.eigvals(square)).max())


def _parts(m: list[float], k: list[float], n: int) -> list[list[int]]:
    """The coordinates that neither matrix couples to others, together."""
    left, parts = list(range(n)), []
    while left:
        part = [left.pop(0)]
        for i in part:
            row = n * i
            near = [j for j in left if m[row + j] or k[row + j] or m[n * j + i] or k[n * j + i]]
            part += near
            left = [j for j in left if j not in near]
        parts.append(part)
    return parts


def _fastest_of_two(a: float, b: float, c: float, d: float) -> float:
    """√ of the largest size of an eigenvalue of [[a, b], [c, d]]."""
    mean, half = (a + d) / 2, (a - d) / 2
    apart = half * half + b * c  # `half**2` would raise where it overflows
    if apart < 0:  # a pair of complex numbers
        return math.sqrt(math.hypot(mean, math.sqrt(-apart)))
    return math.sqrt(abs(mean) + math.sqrt(apart))


def small_motions_at_start(
    system: System, q: np.ndarray, p: np.ndarray, t: float, c: np.ndarray
) -> tuple[float | None, np.ndarray]:
    """`frequency` at one state, and the diagonal of M."""
    mass, stiffness = call(local_function_of_momentum(system), q, p, np.array((t,)), c)
    n = system.structure.n
    return frequency_of_columns(mass.tolist(), stiffness.tolist(), n), mass[:: n + 1]


def frequency_of_columns(m: list[float], k: list[float], n: int) -> float | None:
    """`frequency` of (n, n) matrices, column after column."""
    if n == 2:
        m[1], m[2], k[1], k[2] = m[2], m[1], k[2], k[1]
    elif n > 2:
        m, k = ([x for i in range(n) for x in each[i::n]] for each in (m, k))
    return _frequency(m, k, n)


def frequency_at_start(
    system: System, q: np.ndarray, v: np.ndarray, t: float, c: np.ndarray
) -> float | None:
    """`frequency` at one state."""
    mass, stiffness = call(local_function(system), q, v, np.array((t,)), c)
    n = system.structure.n
    return frequency(mass.reshape(n, n).T, stiffness.reshape(n, n).T)


def decay_rates(motion: Trajectory) -> np.ndarray:
    """Largest |γ| at each node with det(∂F/∂v + γ M) = 0: how fast dampers stop what moves."""
    return decay_rates_at(motion.system, motion.q, motion.v, motion.t[:, None], motion.c)


def decay_rates_at(
    system: System, q: np.ndarray, v: np.ndarray, t: np.ndarray, c: np.ndarray
) -> np.ndarray:
    """The same at states (N, n), (N, n), (N, 1); not where they are no numbers."""
    s, n = system.structure, system.structure.n
    if not s.forced or s.degenerate or not is_looked_at(system):
        return np.empty(0)
    mass, damping = (
        x.reshape(-1, n, n).transpose(0, 2, 1)
        for x in over_columns(damping_function(system), q, v, t, c)
    )
    both = zip(mass, damping, strict=True)
    some = [(m, d) for m, d in both if np.isfinite(m).all() and np.isfinite(d).all()]
    found = [np.linalg.eigvals(np.linalg.pinv(m, hermitian=True) @ d) for m, d in some]
    return np.array([np.abs(rates).max() for rates in found])


@per_scene
def damping_function(system: System) -> ca.Function:
    """(q, v, t, c) → M and ∂F/∂v."""
    s = system
    outputs = [ca.densify(s.mass_matrix), ca.densify(ca.jacobian(uncontrolled(s), s.v))]
    return ca.Function("damping", [s.q, s.v, s.t, s.c], outputs, {"cse": True})


def local_matrices(motion: Trajectory) -> tuple[np.ndarray, np.ndarray]:
    """M and ∂(∂L/∂q + F)/∂q, with `turning`, at every node, (N + 1, n, n)."""
    n = motion.system.structure.n
    found = over_columns(
        local_function(motion.system), motion.q, motion.v, motion.t[:, None], motion.c
    )
    mass, stiffness = (x.reshape(-1, n, n).transpose(0, 2, 1) for x in found)
    return mass, stiffness


@per_scene
def local_function(system: System) -> ca.Function:
    """(q, v, t, c) → M and ∂(∂L/∂q + F)/∂q with `turning`."""
    s = system
    generalised_force = ca.gradient(s.lagrangian, s.q) + uncontrolled(s)
    stiffness = ca.jacobian(generalised_force, s.q) + turning(system)
    outputs = [ca.densify(s.mass_matrix), ca.densify(stiffness)]
    # looking for equal operations takes fifty times as long as making the function of all of them
    return ca.Function("local", [s.q, s.v, s.t, s.c], outputs)


def uncontrolled(system: System) -> ca.SX:
    """The force where no controls act."""
    return ca.substitute(system.force, system.control, 0 * system.control)


def turning(system: System) -> ca.SX:
    """−GᵀM⁻¹G with G = ∂p/∂q − (∂p/∂q)ᵀ, what magnetic fields and turning frames are for small
    motions: those of M a = −G v, by which a charge goes round, have the same frequencies as those
    of M a = −GᵀM⁻¹G q. Zero where the mass is not constant, whose G is of the coordinates, too.
    """
    n, s = system.structure.n, system.structure
    if s.separable or s.degenerate or not s.constant_mass:
        return ca.SX(n, n)
    slopes = ca.jacobian(system.momentum, system.q)
    gyroscopic = slopes - slopes.T
    return -ca.mtimes(gyroscopic.T, mass_solve(system.mass_matrix, gyroscopic))


@per_scene
def local_function_of_momentum(system: System) -> ca.Function:
    """(q, p, t, c) → the same."""
    return by_momentum(system, local_function(system))


def by_momentum(system: System, function: ca.Function) -> ca.Function:
    """(q, p, t, c) → what a function of (q, v, t, c) is there."""
    n, velocity = system.structure.n, velocity_function(system)
    symbol = ca.SX.sym if velocity.is_a("SXFunction") else ca.MX.sym
    sizes = (n, n, 1, system.c.numel())
    q, p, t, c = (symbol(x, k) for x, k in zip("qptc", sizes, strict=True))
    found = function.call([q, velocity(q, p, t, c), t, c])
    return ca.Function(function.name(), [q, p, t, c], found)

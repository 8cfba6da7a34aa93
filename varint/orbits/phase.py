"""Phase space along an orbit: tangents of the manifold, units, integrals, the symplectic form."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from varint.discrete.constraints import every_row_function, position_rows, tangent_function
from varint.discrete.legendre import velocity_function
from varint.discrete.projection import project_configuration
from varint.errors import InputError
from varint.numerics.arrays import call
from varint.scene.memory import per_system
from varint.scene.system import System, parameters_by_name
from varint.sensitivities.start import (
    momentum_function,
    momentum_slopes,
    slopes_of,
    state_function,
)
from varint.symmetry.noether import symmetries
from varint.symmetry.symmetry import Symmetry

DEPENDENT = 1e-7  # relative: singular values of gradients of integrals that say nothing new
VANISHING = 1e-10  # of the largest gradient: an integral that has none here
INDEPENDENT = 1e-9  # relative: singular values of independent rows of the constraints
STILL = 1e-3  # of the largest range: that of a coordinate that hardly moves


@dataclass(frozen=True, eq=False)
class Units:
    """What coordinates and momenta are measured by: q by `length` (n,), p by action / length, so
    that the symplectic form of the scaled state is that of the state, divided by the action.
    """

    length: np.ndarray
    action: float

    @property
    def scale(self) -> np.ndarray:
        """What (q, p) are divided by, (2n,)."""
        return np.concatenate([self.length, self.action / self.length])


def units_of(x: np.ndarray) -> Units:
    """Units from the ranges of q and p along a motion, (N, 2n)."""
    n = x.shape[1] // 2
    wide = np.ptp(x, axis=0)
    size = np.where(wide > 0, wide, np.abs(x).max(axis=0))
    q, p = size[:n], size[n:]
    largest = q.max(initial=0.0)
    length = np.where(q > STILL * largest, q, largest) if largest > 0 else np.ones(n)
    action = float((length * p).max(initial=0.0))
    return Units(length, action if action > 0 else 1.0)


@dataclass(frozen=True, eq=False)
class Integrals:
    """What is conserved: expressions of q, v and the parameters, the energy first if it is one.

    Attributes
    ----------
    names : tuple of str
    energy : bool
        Whether the energy is the first of them.
    values, slopes : Function
        (q, p, t, c) → the values; → their derivatives with respect to (q, p), c and t.
    """

    names: tuple[str, ...]
    energy: bool
    values: ca.Function
    slopes: ca.Function

    def at(self, x: np.ndarray, c: np.ndarray) -> np.ndarray:
        """Values at one state."""
        n = len(x) // 2
        return call(self.values, x[:n], x[n:], np.zeros(1), c)[0]

    def gradients(self, x: np.ndarray, c: np.ndarray) -> np.ndarray:
        """Rows ∂J/∂(q, p) at one state, (k, 2n)."""
        n = len(x) // 2
        flat = call(self.slopes, x[:n], x[n:], np.zeros(1), c)[0]
        return flat.reshape(2 * n, len(self.names)).T

    def by_parameters(self, x: np.ndarray, c: np.ndarray) -> np.ndarray:
        """∂J/∂c at one state, (k, C)."""
        n = len(x) // 2
        flat = call(self.slopes, x[:n], x[n:], np.zeros(1), c)[1]
        return flat.reshape(len(c), len(self.names)).T


def integrals(
    system: System, c: np.ndarray, near: np.ndarray, given: Sequence[Symmetry] | None
) -> Integrals:
    """The energy of an autonomous scene without forces, and what its other symmetries conserve."""
    if given is None:
        return _found(system, c.tobytes(), tuple(float(x) for x in near))
    if not all(isinstance(x, Symmetry) and x.system is system for x in given):
        raise InputError("symmetries= takes those of this system, from symmetries() or noether()")
    return _integrals(system, given)


@per_system
def _found(system: System, c: bytes, near: tuple[float, ...]) -> Integrals:
    names = system.defaults
    values = np.frombuffer(c)
    if not names:
        return _integrals(system, tuple(symmetries(system, near=near)))
    there = parameters_by_name(system, values)
    return _integrals(system, tuple(symmetries(system, params=there, near=near)))


def _integrals(system: System, found: Sequence[Symmetry]) -> Integrals:
    s, known = system, conserved_energy(system)
    kept = [x for x in found if x.conserved and not ca.depends_on(x.quantity, s.t)]
    kept = [x for x in kept if not (x.xi.is_zero() and known)]
    names = ["energy"] * known + [x.name for x in kept]
    column = ca.vertcat(ca.SX(0, 1), *([s.energy] if known else []), *(x.quantity for x in kept))
    return Integrals(tuple(names), known, state_function(s, column), slopes_of(s, column))


def conserved_energy(system: System) -> bool:
    """Whether the energy is an integral: nothing depends on time, and no force acts."""
    s = system.structure
    return s.autonomous and not s.forced


@dataclass(frozen=True, eq=False)
class Frame:
    """The tangent space of the phase space at one state, in an orthonormal basis of scaled states.

    Attributes
    ----------
    into : ndarray (2n, d)
        From the basis to (δq, δp).
    onto : ndarray (d, 2n)
        From (δq, δp) to the basis.
    form : ndarray (d, d)
        The symplectic form Ω there, uᵀΩw.
    """

    into: np.ndarray
    onto: np.ndarray
    form: np.ndarray


def frame(system: System, x: np.ndarray, t: float, c: np.ndarray, units: Units) -> Frame:
    """The tangent space at a state (q, p)."""
    n, scale = len(x) // 2, units.scale
    basis = np.eye(2 * n)
    if system.structure.velocity_rows:
        basis = np.linalg.qr(_tangents(system, x, t, c) / scale[:, None])[0]
    form = basis[:n].T @ basis[n:]
    return Frame(scale[:, None] * basis, basis.T / scale, form - form.T)


def _tangents(system: System, x: np.ndarray, t: float, c: np.ndarray) -> np.ndarray:
    """(δq, δp) with G δq = 0, W δv + ∂(W v)/∂q δq = 0, columns."""
    n, at = len(x) // 2, np.array([t])
    q, p = x[:n], x[n:]
    v = call(velocity_function(system), q, p, at, c)[0]
    flat = call(_row_slopes(system), q, v, at, c)[0]
    rows = flat.reshape(2 * n, -1).T
    size = np.linalg.norm(rows, axis=1, keepdims=True)
    _, values, right = np.linalg.svd(rows / np.where(size > 0, size, 1.0))
    free = right[int((values > INDEPENDENT * values.max(initial=0.0)).sum()) :].T
    by_q, by_v = (y.reshape(n, n).T for y in call(momentum_slopes(system), q, v, at, c)[:2])
    return np.vstack([free[:n], by_q @ free[:n] + by_v @ free[n:]])


@per_system
def _row_slopes(system: System) -> ca.Function:
    """(q, v, t, c) → ∂(g, W v + w)/∂(q, v), dense."""
    s = system
    rows = ca.vertcat(s.constraint, every_row_function(s)(s.q, s.v, s.t, s.c)[0])
    slopes = ca.jacobian(rows, ca.vertcat(s.q, s.v))
    return ca.Function("row_slopes", [s.q, s.v, s.t, s.c], [ca.densify(slopes)])


def on_manifold(system: System, x: np.ndarray, t: float, c: np.ndarray) -> np.ndarray:
    """The state (q, p) that keeps the constraints, near x."""
    s = system.structure
    if not s.velocity_rows:
        return x
    q, p = x[: s.n], x[s.n :]
    if s.constraints and np.abs(position_rows(system, q, t, c)[0]).max() > 0:
        q = project_configuration(system, q, np.zeros(s.n), t, c)
    return np.concatenate([q, p + call(tangent_function(system), q, p, np.array([t]), c)[1]])


def independent(rows: np.ndarray) -> np.ndarray:
    """An orthonormal basis of the span of rows (k, d), each brought to length one before."""
    size = np.linalg.norm(rows, axis=1)
    rows = rows[size > 0] / size[size > 0, None]
    if not len(rows):
        return rows
    _, values, right = np.linalg.svd(rows, full_matrices=False)
    return right[values > DEPENDENT * values[0]]


def hamiltonian_fields(form: np.ndarray, gradients: np.ndarray) -> np.ndarray:
    """Rows X_J with ω(X_J, ·) = dJ, of rows dJ."""
    return np.linalg.solve(form.T, gradients.T).T


def velocity_at(system: System, x: np.ndarray, t: float, c: np.ndarray) -> np.ndarray:
    """v of a state (q, p)."""
    n = len(x) // 2
    return call(velocity_function(system), x[:n], x[n:], np.array([t]), c)[0]


@per_system
def _energy(system: System) -> ca.Function:
    return state_function(system, system.energy)


def energy_at(system: System, x: np.ndarray, t: float, c: np.ndarray) -> float:
    """Energy of a state (q, p)."""
    n = len(x) // 2
    return float(call(_energy(system), x[:n], x[n:], np.array([t]), c)[0][0])


def state_of(system: System, q: np.ndarray, v: np.ndarray, t: float, c: np.ndarray) -> np.ndarray:
    """(q, p) of (q, v), on the manifold."""
    p = call(momentum_function(system), q, v, np.array([t]), c)[0]
    return on_manifold(system, np.concatenate([q, p]), t, c)

"""The mass matrix ∂²L/∂v², and whether every direction that may move has inertia."""

from __future__ import annotations

import casadi as ca
import numpy as np

from varint.errors import InputError
from varint.numerics.arrays import call, is_definite
from varint.scene.memory import per_scene
from varint.scene.system import System

# smallest eigenvalue of the mass matrix, scaled to a unit diagonal, of a direction with inertia
SINGULAR = 1e-13


@per_scene
def mass_function(system: System) -> ca.Function:
    """(q, v, t, c) → ∂²L/∂v², dense."""
    s = system
    return ca.Function("mass", [s.q, s.v, s.t, s.c], [ca.densify(s.mass_matrix)])


def mass_at(system: System, q: np.ndarray, v: np.ndarray, t: float, c: np.ndarray) -> np.ndarray:
    """∂²L/∂v² at one state, (n, n)."""
    n = system.structure.n
    return call(mass_function(system), q, v, np.array([t]), c)[0].reshape(n, n).T


def inertia_roots(mass: np.ndarray) -> np.ndarray:
    """Square roots of the inertia of each coordinate, (…, n, n) → (…, n); what has none counts as
    the largest.
    """
    root = np.sqrt(np.abs(np.einsum("...ii->...i", mass)))
    largest = root.max(axis=-1, keepdims=True, initial=0.0)
    return np.where(root > 0, root, np.where(largest > 0, largest, 1.0))


def scaled_mass(mass: np.ndarray) -> np.ndarray:
    """The mass matrix in units in which its diagonal is one, (…, n, n)."""
    root = inertia_roots(mass)
    return mass / (root[..., :, None] * root[..., None, :])


def lacks_inertia(masses: np.ndarray) -> np.ndarray:
    """Which of many mass matrices (N, n, n) are singular, (N,)."""
    return np.abs(np.linalg.eigvalsh(scaled_mass(masses))).min(axis=1) <= SINGULAR


def check_inertia(system: System, mass: np.ndarray, rows: np.ndarray | None = None) -> None:
    """Does every direction that the velocity rows W (m, n) leave free have inertia?

    Raises
    ------
    InputError
        Naming the coordinates of a direction without.
    """
    if is_definite(mass):
        return
    root = inertia_roots(mass)
    free = np.eye(len(mass))
    if rows is not None:
        free = np.linalg.qr((rows / root).T, mode="complete")[0][:, len(rows) :].T
    values, vectors = np.linalg.eigh(free @ scaled_mass(mass) @ free.T)
    if not len(values) or np.abs(values).min() > SINGULAR:
        return
    part = np.abs(vectors[:, np.abs(values).argmin()] @ free)
    weak = [name for name, x in zip(system.names, part, strict=True) if x > 0.1 * part.max()]
    massless = [name for name, row in zip(system.names, mass, strict=True) if not row.any()]
    here = [name for name in massless if _varies(system, name)]
    if rows is None and any(ca.depends_on(_own_mass(system, name), system.v) for name in here):
        raise InputError(
            f"the mass ∂²L/∂v² of {here} is zero at the start velocities: there p = ∂L/∂v does not "
            "tell the velocity; start with another one, or add a term v² to the kinetic energy"
        )
    if rows is None and here:
        raise InputError(
            f"the mass of {here} is zero at the start, though not everywhere: the coordinates are "
            "singular there, as spherical ones are at the poles; start beside that place, or use "
            "other coordinates"
        )
    if rows is None and massless:
        raise InputError(
            f"the mass of {massless} is zero at the start: what has no mass is a test particle, "
            "moved by the others and moving none of them; write its mass as a parameter m and take "
            "massless_limit(system, m), or give it the kinetic energy v²/2 of a unit mass, leave "
            "it out of the potential, and add the field at its place as force="
        )
    if rows is None:
        raise InputError(
            "the mass matrix ∂²L/∂v² is singular at the start: the Lagrangian gives no inertia to "
            f"(a combination of) {weak}; use other coordinates or another start"
        )
    raise InputError(
        "the mass matrix ∂²L/∂v² is singular along the constraints at the start: (a combination "
        f"of) {weak} may move but has no inertia; add its kinetic energy, or a constraint that "
        "holds it"
    )


def _varies(system: System, name: str) -> bool:
    """Whether a coordinate's own entry of the mass matrix depends on where the scene is."""
    return ca.depends_on(_own_mass(system, name), ca.vertcat(system.q, system.v, system.t))


def _own_mass(system: System, name: str) -> ca.SX:
    i = system.names.index(name)
    return system.mass_matrix[i, i]

"""The space of small displacements (δq, δp) that keep to the constraints, in coordinates in which
the symplectic form is J and lengths are told.

With constraints g(q) = 0 and Z an orthonormal basis of the kernel of ∂g/∂q, δq = Z y_q, and y_p =
Zᵀ δp: then δq₁·δp₂ − δq₂·δp₁ = y_q₁·y_p₂ − y_q₂·y_p₁, for δq = Z Zᵀ δq. What δp has along the
reactions follows from the hidden constraint.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from varint.discrete.constraints import tangent_function
from varint.numerics.arrays import call
from varint.results.trajectory import Trajectory
from varint.scene.memory import per_system
from varint.scene.system import System

DEPENDENT = 1e-9  # of the largest singular value: rows that follow from the others


@dataclass(frozen=True, eq=False)
class TangentSpace:
    """Displacements of a scene; `sizes` (n,) are σ with δq/σ and σ δp of like lengths.

    Attributes
    ----------
    scene : System
    sizes : ndarray (n,)
    c : ndarray
        Parameter values.
    """

    scene: System
    sizes: np.ndarray
    c: np.ndarray

    def maps(self, x: np.ndarray, t: float) -> tuple[np.ndarray, np.ndarray]:
        """At x = (q, p): displacements of coordinates y, (2n, 2d), and y of displacements."""
        n = len(self.sizes)
        basis, correction = np.eye(n), np.zeros((n, 2 * n))
        if self.scene.structure.constraints:
            q, p = x[:n].copy(), x[n:].copy()
            at = q, p, np.array([t]), self.c
            slope = call(_row_slope(self.scene), x[:n].copy(), np.array([t]), self.c)[0]
            slope = slope.reshape(n, -1).T
            _, values, across = np.linalg.svd(slope * self.sizes)
            basis = across[int((values > DEPENDENT * values[0]).sum()) :].T
            correction = call(_correction_slope(self.scene), *at)[0].reshape(2 * n, n).T
        d = basis.shape[1]
        out, back = np.zeros((2 * n, 2 * d)), np.zeros((2 * d, 2 * n))
        out[:n, :d] = self.sizes[:, None] * basis
        out[n:, d:] = basis / self.sizes[:, None]
        out[n:] += correction @ out
        back[:d, :n], back[d:, n:] = basis.T / self.sizes, basis.T * self.sizes
        return out, back

    def lengths(self, tangents: np.ndarray) -> np.ndarray:
        """Lengths of displacements (…, 2n, m), (…, m): (δq/σ)² + (σ δp)²."""
        units = np.concatenate([1 / self.sizes, self.sizes])
        scaled = units[:, None] * tangents
        return np.sqrt(np.einsum("...im,...im->...m", scaled, scaled))


@per_system
def _row_slope(system: System) -> ca.Function:
    """(q, t, c) → ∂g/∂q."""
    s = system
    return ca.Function("slope", [s.q, s.t, s.c], [ca.densify(ca.jacobian(s.constraint, s.q))])


@per_system
def _correction_slope(system: System) -> ca.Function:
    """(q, p, t, c) → ∂Δp/∂(q, p) of the Δp that brings p back to the hidden constraint."""
    sizes = (system.structure.n, system.structure.n, 1, system.c.numel())
    q, p, t, c = (ca.MX.sym(name, size) for name, size in zip("qptc", sizes, strict=True))
    change = tangent_function(system)(q, p, t, c)[1]
    slope = ca.densify(ca.jacobian(change, ca.vertcat(q, p)))
    return ca.Function("correction_slope", [q, p, t, c], [slope])


def tangent_space(motion: Trajectory, scene: System) -> TangentSpace:
    """The displacements of a motion; σ² is the range of a coordinate over that of its momentum, as
    the kept nodes have them.
    """
    ranges = [_ranges(x) for x in (motion.q, motion.p)]
    return TangentSpace(scene, np.sqrt(ranges[0] / ranges[1]), motion.c)


def _ranges(x: np.ndarray) -> np.ndarray:
    """How far each column goes, or lies from zero; the middle one of all for those that do
    neither.
    """
    rows = np.ascontiguousarray(x.T)  # many nodes of few coordinates: faster than along columns
    high, low = rows.max(axis=1), rows.min(axis=1)
    found = np.maximum(high - low, np.maximum(high, -low))
    known = found[found > 0]
    return np.where(found > 0, found, np.median(known) if len(known) else 1.0)


def random_frame(d: int, seed: int) -> np.ndarray:
    """Columns (2d, 2d) that are orthonormal and symplectic, [[Re U, −Im U], [Im U, Re U]] with a
    unitary U.
    """
    rng = np.random.default_rng(seed)
    u = np.linalg.qr(rng.standard_normal((d, d)) + 1j * rng.standard_normal((d, d)))[0]
    return np.block([[u.real, -u.imag], [u.imag, u.real]])

"""The verb for Floquet multipliers."""

from __future__ import annotations

from varint.errors import InputError
from varint.orbits.multipliers import Floquet
from varint.orbits.orbit import Orbit


def floquet(orbit: Orbit) -> Floquet:
    """Multipliers of a periodic orbit, eigenvalues of Φ = ∂x(T)/∂x(0) on the reduced phase space.

    The monodromy matrix is the product of the derivatives of the run's own steps, so ΦᵀΩΦ = Ω to
    round-off. The integrals of the scene (energy, momenta of symmetries) make multipliers 1 in
    Jordan blocks, which rounding would split by its root; their vectors are known, so they are
    divided out.

    Parameters
    ----------
    orbit : Orbit
        From `periodic` or a `Family`.

    Returns
    -------
    Floquet
        Prints its verdict and a table.

    References
    ----------
    Meyer & Offin, Introduction to Hamiltonian Dynamical Systems and the N-Body Problem, 3rd ed.,
    chapter 8; Yakubovich & Starzhinskii, Linear Differential Equations with Periodic Coefficients,
    III (Krein signatures).

    Examples
    --------
    >>> import numpy as np
    >>> import varint as vi
    >>> q, v = vi.coordinates("x", "y")
    >>> springs = vi.System(q, v, (v.T @ v - q[0] ** 2 - 2 * q[1] ** 2) / 2)
    >>> along_x = vi.orbits.periodic(springs, ([1.0, 0.0], [0.0, 0.0]), period=6.28, energy=0.5)
    >>> of = vi.orbits.floquet(along_x)
    >>> of.trivial, bool(abs(of.indices[0] - np.cos(2 * np.pi * 2**0.5)) < 1e-12)
    (2, True)
    """
    if not isinstance(orbit, Orbit):
        raise InputError(f"floquet takes an Orbit, from periodic(), got {type(orbit).__name__}")
    return orbit.floquet

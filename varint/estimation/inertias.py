"""Inertias that stay physical: the kinetic energy of every motion remains positive."""

from __future__ import annotations

import casadi as ca
import numpy as np

from varint.numerics.arrays import over_columns
from varint.scene.memory import per_system
from varint.scene.system import System

SAMPLES = 8  # states around a start at which the kinetic energy is looked at
ROUNDING = 1e-12  # relative: eigenvalues below are zero


@per_system
def inertia_function(system: System) -> ca.Function:
    """(q, v, t, c) → M = ∂²L/∂v²."""
    s = system
    mass = ca.densify(ca.jacobian(s.momentum, s.v))
    return ca.Function("inertia", [s.q, s.v, s.t, s.c], [mass], {"cse": True})


def is_positive(system: System, x: np.ndarray, t: np.ndarray, c: np.ndarray) -> bool:
    """Whether M is positive definite at all states (q, v), (T, 2n)."""
    n = system.structure.n
    flat = over_columns(inertia_function(system), x[:, :n], x[:, n:], t[:, None], c)[0]
    if not np.isfinite(flat).all():
        return False
    values = np.linalg.eigvalsh(_symmetric(flat.reshape(len(x), n, n)))
    return bool((values[:, 0] > ROUNDING * values[:, -1]).all())


def grows_with(system: System, c: np.ndarray, places: np.ndarray, start: np.ndarray) -> np.ndarray:
    """Which of the parameters are masses or moments of inertia: M is linear in one of them and
    grows with it at all states, as with a mass and not with a length.
    """
    s, n = system, system.structure.n
    mass, rng = ca.vec(ca.densify(ca.jacobian(s.momentum, s.v))), np.random.default_rng(0)
    x = start + np.maximum(np.abs(start), 1.0) * rng.uniform(-1, 1, (SAMPLES, 2 * n))
    slopes = ca.Function("slopes", [s.q, s.v, s.t, s.c], [ca.densify(ca.jacobian(mass, s.c))])
    flat = over_columns(slopes, x[:, :n], x[:, n:], np.zeros((SAMPLES, 1)), c)[0]
    grown = np.zeros(len(places), dtype=bool)
    for k, place in enumerate(places):
        linear = not ca.which_depends(mass, s.c[int(place)], 2, False)[0]
        slope = _symmetric(flat.reshape(SAMPLES, -1, n, n)[:, place])
        if linear and np.isfinite(slope).all():
            values = np.linalg.eigvalsh(slope)
            size = np.abs(values).max()
            grown[k] = size > 0 and values.min() >= -ROUNDING * size
    return grown


def _symmetric(a: np.ndarray) -> np.ndarray:
    return (a + a.transpose(0, 2, 1)) / 2

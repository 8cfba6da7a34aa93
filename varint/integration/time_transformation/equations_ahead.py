"""The equations that a rough look ahead of a motion follows.

Over forces and explicit time the time is one more coordinate, and in place of its velocity stands
the energy that they have given: what is left of the energy without it stays.
"""

from __future__ import annotations

from typing import NamedTuple

import casadi as ca
import numpy as np

from varint.discrete.legendre import mass_solve
from varint.integration.work_bound import keeps_energy
from varint.scene.memory import per_system
from varint.scene.system import System


class Equations(NamedTuple):
    """Coordinates and velocities, (N,) each, their rates, and the energy that stays."""

    q: ca.SX
    v: ca.SX
    rates: tuple[ca.SX, ca.SX]
    energy: ca.SX


@per_system
def equations_ahead(system: System) -> Equations:
    """Those of a scene without constraints."""
    s = system
    push = s.generalised_force - ca.jtimes(s.momentum, s.q, s.v)
    if keeps_energy(system):
        return Equations(s.q, s.v, (s.v, mass_solve(s.mass_matrix, push)), s.energy)
    given = ca.SX.sym("given")
    gained = mass_solve(s.mass_matrix, push - ca.jacobian(s.momentum, s.t))
    power = ca.dot(s.force, s.v) - ca.jacobian(s.lagrangian, s.t)
    rates = ca.vertcat(s.v, 1), ca.vertcat(gained, power)
    return Equations(ca.vertcat(s.q, s.t), ca.vertcat(s.v, given), rates, s.energy - given)


def ahead_from(
    system: System, q: np.ndarray, v: np.ndarray, t: np.ndarray | float
) -> tuple[np.ndarray, np.ndarray]:
    """Coordinates and velocities (…, n) of a scene at times (…), as its equations have them."""
    if keeps_energy(system):
        return q, v
    t = np.broadcast_to(t, q.shape[:-1])[..., None]
    return np.concatenate((q, t), axis=-1), np.concatenate((v, np.zeros_like(t)), axis=-1)

"""How fast the mass matrix changes on the way: the rate of scenes in polar and other coordinates
whose metric varies.

Inertial forces of such scenes are of second degree in the velocities, M⁻¹ ∂M/∂q v², and no ∂a/∂q
of coordinates alone tells of them. On the level of the start's energy the speed is known: of all
velocities of the kinetic energy T a way through the places where M changes takes the time 1/ω,

    ω² = ½ 2T Σ_ij (M⁻¹)_ij tr(M⁻¹ ∂M/∂q_i M⁻¹ ∂M/∂q_j),

which no linear change of coordinates alters. For M = diag(m, m r²) it is 2 v²/r²: the small motions
of r about a circle that is passed with the speed v have ω² = 3 v²/r², and fewer steps do.
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from varint.discrete.legendre import mass_solve
from varint.integration.error_scale import angles
from varint.scene.memory import per_system
from varint.scene.system import System

SHARE = 0.5  # of the sum: ¾ is the rate about a circle; of eight scenes most take least time so
MOST_COORDINATES = 6  # beyond, the sum has more operations than the scene
# where M is that of angles alone, it is looked at all over: how many places, and how many times the
# middle rate the largest one is where steps that follow it may repay
PLACES, VARIES = 64, 4.0


@per_system
def metric_rate(system: System) -> ca.SX | None:
    """ω² over twice the kinetic energy, of q and c; None where the mass matrix changes by about as
    much everywhere, or has too many coordinates.
    """
    s = system.structure
    if s.constant_mass or s.n > MOST_COORDINATES:
        return None
    inverse = mass_solve(system.mass_matrix, ca.SX.eye(s.n))
    entries = ca.vec(system.mass_matrix)
    changes = [
        inverse @ ca.reshape(ca.jacobian(entries, system.q[i]), s.n, s.n) for i in range(s.n)
    ]
    total = ca.SX(0)
    for i, one in enumerate(changes):
        for j, other in enumerate(changes):
            total += inverse[i, j] * ca.sum1(ca.vec(one * other.T))
    rate = SHARE * ca.cse(total)
    return rate if _varies(system, rate) else None


def _varies(system: System, rate: ca.SX) -> bool:
    """Whether steps that follow the rate may repay: always where it depends on more than angles."""
    turning = angles(system)
    others = system.q[[i for i in range(system.structure.n) if not turning[i]]]
    if ca.depends_on(rate, others):
        return True
    f = ca.Function("rate", [system.q, system.c], [rate])
    q = np.random.default_rng(0).uniform(0, 2 * np.pi, (system.structure.n, PLACES))
    with np.errstate(all="ignore"):
        found = np.sqrt(f(q, system.default_vector).full().ravel())
    found = found[np.isfinite(found)]
    return bool(found.size and found.max() > VARIES * np.median(found))

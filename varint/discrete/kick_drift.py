"""Force and velocity of a scene that is stepped by kick and drift: separable, with constant
mass.
"""

from __future__ import annotations

import casadi as ca

from varint.discrete.lagrangian import point_function
from varint.discrete.legendre import mass_solve
from varint.scene.memory import per_scene
from varint.scene.system import System


@per_scene
def kick_function(system: System) -> ca.Function:
    """(q, u, t, c) → ∂L/∂q + F, which velocities do not enter."""
    s = system
    _, _, gradient, force = point_function(s)(s.q, ca.SX.zeros(s.v.shape), s.control, s.t, s.c)
    return ca.Function(
        "kick", [s.q, s.control, s.t, s.c], [ca.densify(gradient + force)], {"cse": True}
    )


@per_scene
def drift_function(system: System) -> ca.Function:
    """(p, c) → v = M⁻¹ (p − ∂L/∂v(v = 0))."""
    s = system
    p = ca.SX.sym("p", s.structure.n)
    offset = ca.substitute(s.momentum, s.v, ca.SX.zeros(s.v.shape))
    v = mass_solve(s.mass_matrix, p - offset)
    return ca.Function("drift", [p, s.c], [ca.densify(v)], {"cse": True})

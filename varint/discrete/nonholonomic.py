"""Non-holonomic rows A(q, t) v = 0 on one step of degree 1, by Lagrange–d'Alembert, symmetric in
time (order 2): reactions ½h A(q0)ᵀν at the start and ½h A(q1)ᵀν' at the end, the rows for the mean
velocity of the step and at its ends.
"""

from __future__ import annotations

import casadi as ca

from varint.discrete.lagrangian import Interval
from varint.scene.memory import per_system
from varint.scene.system import System


@per_system
def slip_function(system: System) -> ca.Function:
    """(q, t, c) → A, (k, n)."""
    return ca.Function("A", [system.q, system.t, system.c], [system.nonholonomic])


def half_reaction(system: System, q: ca.SX, t: ca.SX, c: ca.SX, h: ca.SX, nu: ca.SX) -> ca.SX:
    """½h A(q)ᵀν, the impulse (n,) at one end of a step."""
    return h / 2 * ca.mtimes(slip_function(system)(q, t, c).T, nu)


def slips(system: System, one: Interval) -> ca.SX:
    """Σ_i b_i A(q_i) v_i at the quadrature nodes of a step, (k,); empty without such rows."""
    if not system.structure.nonholonomic:
        return ca.SX(0, 1)
    at, nodes = slip_function(system), one.q_nodes.shape[1]
    return sum(
        ca.mtimes(at(one.q_nodes[:, i], one.t_nodes[i], one.c), one.v_nodes[:, i]) / nodes
        for i in range(nodes)
    )

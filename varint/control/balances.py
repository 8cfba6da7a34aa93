"""What a controlled motion gains and what its forces give: the balances of energy and of
momenta.
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from varint.control.piecewise import Piecewise
from varint.errors import InputError
from varint.numerics.arrays import over_columns
from varint.results.trajectory import Trajectory
from varint.symmetry.noether import symmetries

CROSSES = 1e-9  # a symmetry of the Lagrangian that leaves the constraints is none of the scene


def _along(motion: Trajectory, path: Piecewise, expression: ca.SX) -> np.ndarray:
    """h b_i × the expression at every quadrature node of every step, (N, r, size)."""
    s, rule = motion.system, motion.rule
    h = motion.duration * np.diff(path.mesh)
    nodes = np.array(rule.nodes)
    q = np.einsum("ij,kjn->kin", rule.basis, path.values)
    v = np.einsum("ij,kjn->kin", rule.slopes, path.values) / h[:, None, None]
    t = motion.t[0] + motion.duration * path.mesh[:-1, None] + h[:, None] * nodes
    u = np.broadcast_to(motion.u, (len(h), len(nodes), motion.u.shape[2]))
    f = ca.Function("along", [s.q, s.v, s.control, s.t, s.c], [ca.densify(expression)])
    n, k = q.shape[2], u.shape[2]
    values = over_columns(
        f, q.reshape(-1, n), v.reshape(-1, n), u.reshape(-1, k), t.reshape(-1, 1), motion.c
    )[0]
    return (
        values.reshape(len(h), len(nodes), -1) * h[:, None, None] * np.array(rule.weights)[:, None]
    )


def energy_balance(motion: Trajectory, path: Piecewise) -> tuple[float, float]:
    """H_N − H_0 and ∫ (F·v − ∂L/∂t) dt by the rule's quadrature: they agree to the rule's order."""
    s = motion.system
    power = ca.dot(s.force, s.v) - ca.gradient(s.lagrangian, s.t)
    return float(motion.energy[-1] - motion.energy[0]), float(_along(motion, path, power).sum())


def momentum_balance(motion: Trajectory, path: Piecewise) -> list[tuple[str, float, float]]:
    """(name, J_N − J_0, ∫ F·ξ dt) of every symmetry ξ(q) of the Lagrangian, J = p·ξ.

    Equal to round-off where ξ is affine in q, as translations and rotations are (forced Noether
    theorem): the rule keeps those momentum maps exactly.
    """
    s, found = motion.system, []
    try:
        known = symmetries(s, params=motion.parameters, near=motion.q[len(motion) // 2])
    except InputError:  # not finite somewhere near the path: nothing can be said
        return []
    for symmetry in known:
        along = [ca.jtimes(s.constraint, s.q, symmetry.xi), ca.mtimes(s.nonholonomic, symmetry.xi)]
        crossing = ca.vertcat(*along)
        fits = (
            symmetry.tau.is_zero()
            and symmetry.gauge.is_zero()
            and not ca.depends_on(symmetry.xi, ca.vertcat(s.v, s.t))
        )
        if not fits or np.abs(_along(motion, path, crossing)).max(initial=0.0) > CROSSES:
            continue
        vector = ca.Function("xi", [s.q, s.c], [ca.densify(symmetry.xi)])
        at_ends = over_columns(vector, motion.q[[0, -1]], motion.c)[0]
        before, after = (motion.p[[0, -1]] * at_ends).sum(axis=1)
        impulse = _along(motion, path, ca.dot(s.force, symmetry.xi)).sum()
        found.append((symmetry.name, float(after - before), float(impulse)))
    return found

"""What a solution achieves and keeps, in words and numbers."""

from __future__ import annotations

import casadi as ca
import numpy as np

from varint.arrays import over_columns
from varint.control.replay import defect, replay
from varint.control.solution import ControlSolution
from varint.errors import InputError
from varint.symmetry import symmetries
from varint.trajectory import Trajectory

CROSSES = 1e-9  # a symmetry of the Lagrangian that leaves the constraints is none of the scene


def report(motion: Trajectory, solution: ControlSolution) -> str:
    """Status, cost, violation, replay defect, balance of energy and of momenta, active bounds."""
    s = solution
    lines = [
        f"optimal control by {motion.rule}, {len(s.mesh) - 1} steps, duration {motion.duration:.12g}",
        f"  status               {s.status} after {s.iterations} iterations",
        f"  cost                 {s.cost:.12g}"
        + (f" of {s.total_cost:.12g}" if abs(s.total_cost - s.cost) > 1e-12 * abs(s.cost) else ""),
        f"  constraint violation {s.violation:.1e}",
        f"  replay defect        {defect(motion, replay(motion, solution)):.1e}",
        f"  time                 {s.timings['build']:.3f} s to build, {s.timings['solve']:.3f} s to solve",
    ]
    gained, work = energy_balance(motion, solution)
    lines.append(f"  energy               gained {gained:.9g}, work of the forces {work:.9g}")
    for name, change, impulse in momentum_balance(motion, solution):
        lines.append(f"  {name}: momentum gained {change:.9g}, impulse of the force {impulse:.9g}")
    for bound, times in s.active.items():
        lines.append(f"  active               {bound}: {len(times)} times, {times[0]:.4g} … {times[-1]:.4g}")
    return "\n".join(lines)


def _along(motion: Trajectory, solution: ControlSolution, expression: ca.SX) -> np.ndarray:
    """h b_i × the expression at every quadrature node of every step, (N, r, size)."""
    s, rule = motion.system, motion.rule
    h = motion.duration * np.diff(solution.mesh)
    nodes = np.array(rule.nodes)
    q = np.einsum("ij,kjn->kin", rule.basis, solution.q.values)
    v = np.einsum("ij,kjn->kin", rule.slopes, solution.q.values) / h[:, None, None]
    t = motion.t[0] + motion.duration * solution.mesh[:-1, None] + h[:, None] * nodes
    u = np.broadcast_to(motion.u, (len(h), len(nodes), motion.u.shape[2]))
    f = ca.Function("along", [s.q, s.v, s.control, s.t, s.c], [ca.densify(expression)])
    n, k = q.shape[2], u.shape[2]
    values = over_columns(f, q.reshape(-1, n), v.reshape(-1, n), u.reshape(-1, k), t.reshape(-1, 1), motion.c)[0]
    return values.reshape(len(h), len(nodes), -1) * h[:, None, None] * np.array(rule.weights)[:, None]


def energy_balance(motion: Trajectory, solution: ControlSolution) -> tuple[float, float]:
    """H_N − H_0 and ∫ (F·v − ∂L/∂t) dt by the rule's quadrature: they agree to the rule's order."""
    s = motion.system
    power = ca.dot(s.force, s.v) - ca.gradient(s.lagrangian, s.t)
    return float(motion.energy[-1] - motion.energy[0]), float(_along(motion, solution, power).sum())


def momentum_balance(motion: Trajectory, solution: ControlSolution) -> list[tuple[str, float, float]]:
    """(name, J_N − J_0, ∫ F·ξ dt) of every symmetry ξ(q) of the Lagrangian, J = p·ξ.

    Equal to round-off where ξ is affine in q, as translations and rotations are (forced Noether theorem): the rule
    keeps those momentum maps exactly.
    """
    s, found = motion.system, []
    try:
        known = symmetries(s, params=motion.parameters, near=motion.q[len(motion) // 2])
    except InputError:  # not finite somewhere near the path: nothing can be said
        return []
    for one in known:
        crossing = ca.jtimes(s.constraint, s.q, one.xi)
        fits = one.tau.is_zero() and one.gauge.is_zero() and not ca.depends_on(one.xi, ca.vertcat(s.v, s.t))
        if not fits or np.abs(_along(motion, solution, crossing)).max(initial=0.0) > CROSSES:
            continue
        vector = ca.Function("xi", [s.q, s.c], [ca.densify(one.xi)])
        at_ends = over_columns(vector, motion.q[[0, -1]], motion.c)[0]
        before, after = (motion.p[[0, -1]] * at_ends).sum(axis=1)
        impulse = _along(motion, solution, ca.dot(s.force, one.xi)).sum()
        found.append((one.name, float(after - before), float(impulse)))
    return found

"""What a solution achieves and keeps, in words and numbers."""

from __future__ import annotations

import casadi as ca
import numpy as np

from varint.arrays import over_columns
from varint.control.replay import defect, replay
from varint.control.solution import ControlSolution
from varint.trajectory import Trajectory


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
        lines.append(f"  momentum of {name:<9}gained {change:.9g}, impulse of the force {impulse:.9g}")
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
    """(name, p_N − p_0, ∫ F dt) of every cyclic coordinate: equal to round-off (forced Noether theorem)."""
    s = motion.system
    cyclic = [] if s.structure.constraints else s.structure.cyclic
    if not cyclic:
        return []
    impulse = _along(motion, solution, s.force).sum(axis=(0, 1))
    return [(s.names[i], float(motion.p[-1, i] - motion.p[0, i]), float(impulse[i])) for i in cyclic]

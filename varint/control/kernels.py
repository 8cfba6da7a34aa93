"""The terms of a discrete optimal control problem as expressions: one interval, its two ends.

With t = t_0 + s T at the start of the step and h = w T (s, w: fractions of the duration T) the
interval's share of the cost is h Σ_i b_i cost(q, v, u, t)(c_i), by the nodes and weights of L_d and
of the discrete forces, so that discretising and dualising commute (Ober-Blöbaum, Junge, Marsden
2011, §4; Campos, Ober-Blöbaum, Trélat 2015).
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from varint.control.phase import CheckedPhase
from varint.discrete.lagrangian import constraint_function, interval


@dataclass(frozen=True, eq=False)
class Shared:
    """Symbols that all terms of a phase share: start time, duration, parameters."""

    t0: ca.SX
    duration: ca.SX
    c: ca.SX

    @property
    def column(self) -> ca.SX:
        """All of them as one column."""
        return ca.vertcat(self.t0, self.duration, self.c)


def shared_symbols(phase: CheckedPhase) -> Shared:
    """New symbols for start time, duration and parameters."""
    return Shared(ca.SX.sym("t0"), ca.SX.sym("T"), ca.SX.sym("c", phase.system.c.numel()))


@dataclass(frozen=True, eq=False)
class IntervalTerm:
    """One interval: `stage` = [q_k, λ_k, u, inner points, inner λ], then q_{k+1}; s, w; shares
    by kind of row.
    """

    stage: ca.SX
    q1: ca.SX
    mesh: ca.SX
    cost: ca.SX
    p_minus: ca.SX
    p_plus: ca.SX
    inner: ca.SX
    gaps: ca.SX
    nodes: ca.SX
    points: ca.SX


def interval_term(phase: CheckedPhase, shared: Shared) -> IntervalTerm:
    """Cost, momenta and rows of one interval in terms of positions (not increments), times and
    controls.
    """
    step, system = interval(phase.system, phase.rule), phase.system
    (n, degree), r = step.dq.shape, len(phase.rule.nodes)
    q0, q1, inner = ca.SX.sym("q0", n), ca.SX.sym("q1", n), ca.SX.sym("Q", n, degree - 1)
    u = ca.SX.sym("u", system.structure.controls, phase.samples)
    # of q1: counted in the next interval
    lam = ca.SX.sym("lam", system.structure.constraints, degree)
    mesh = ca.SX.sym("mesh", 2)
    h = mesh[1] * shared.duration
    own = [step.q0, step.dq, step.u, step.lam, step.t, step.h, step.c]
    given = [
        q0,
        ca.horzcat(inner, q1) - ca.repmat(q0, 1, degree),
        u if phase.samples == r else ca.repmat(u, 1, r),
        ca.horzcat(lam, ca.SX.zeros(lam.shape[0], 1)),
        shared.t0 + mesh[0] * shared.duration,
        h,
        shared.c,
    ]
    wanted = [
        step.p_minus,
        step.p_plus,
        step.inner,
        step.gaps,
        step.q_nodes,
        step.v_nodes,
        step.t_nodes,
    ]
    made = ca.Function("interval", own, wanted, {"cse": True})(*given)
    p_minus, p_plus, rows, gaps, q_nodes, v_nodes, t_nodes = made
    s, bounds = system, phase.bounds
    along = ca.Function("along", [s.q, s.v, s.control, s.t, s.c], [phase.cost, bounds.at_nodes])
    cost, nodes = ca.SX(0), [ca.SX(0, 1)]
    for i in range(r):
        value, node_rows = along(q_nodes[:, i], v_nodes[:, i], given[2][:, i], t_nodes[i], shared.c)
        cost += h * phase.rule.weights[i] * value
        nodes.append(node_rows)
    at_points = ca.Function("held", [s.q, s.t, s.c], [bounds.at_points])
    points = ca.horzcat(inner, q1)
    point_rows = [
        at_points(points[:, j], given[4] + h * phase.rule.points[j + 1], shared.c)
        for j in range(degree)
    ]
    stage = [q0, lam[:, 0], ca.vec(u), ca.vec(inner), ca.vec(lam[:, 1:])]
    return IntervalTerm(
        stage=ca.vertcat(*stage),
        q1=q1,
        mesh=mesh,
        cost=cost,
        p_minus=ca.densify(p_minus),
        p_plus=ca.densify(p_plus),
        inner=ca.vec(ca.densify(rows)),
        gaps=ca.vec(gaps),
        nodes=ca.vertcat(*nodes),
        points=ca.vertcat(*point_rows),
    )


@dataclass(frozen=True, eq=False)
class EndTerm:
    """One end: q, v and (at the end of the phase) λ_N; `momentum` = ∂L/∂v − reaction of the last
    half weight.
    """

    q: ca.SX
    v: ca.SX
    lam: ca.SX
    mesh: ca.SX
    cost: ca.SX
    momentum: ca.SX
    gap: ca.SX
    hidden: ca.SX
    rows: ca.SX
    points: ca.SX


def end_term(phase: CheckedPhase, shared: Shared, last: bool) -> EndTerm:
    """Momentum, constraints, conditions and terminal cost at the first or the last node."""
    s, n = phase.system, phase.system.structure.n
    q, v, lam = (
        ca.SX.sym("q", n),
        ca.SX.sym("v", n),
        ca.SX.sym("lam", s.structure.constraints if last else 0),
    )
    mesh, t = ca.SX.sym("mesh", 2), shared.t0 + (shared.duration if last else 0)
    end = phase.end if last else phase.start
    velocity_row = ca.jtimes(s.constraint, s.q, s.v) + ca.jacobian(s.constraint, s.t)
    at = ca.Function(
        "end",
        [s.q, s.v, s.t, s.c],
        [s.momentum, s.constraint, velocity_row, end.rows, phase.bounds.at_points, phase.terminal],
    )
    momentum, gap, hidden, rows, points, terminal = at(q, v, t, shared.c)
    if last and lam.numel():
        _, slope = constraint_function(s)(q, t, shared.c)
        momentum -= mesh[1] * shared.duration * phase.rule.weights[-1] * ca.mtimes(slope.T, lam)
    return EndTerm(
        q=q,
        v=v,
        lam=lam,
        mesh=mesh,
        cost=terminal if last else ca.SX(0),
        momentum=ca.densify(momentum),
        gap=gap,
        hidden=ca.densify(hidden),
        rows=rows,
        points=points,
    )

"""The terms of a discrete optimal control problem as expressions: one interval, its two ends.

With t = t_0 + s T at the start of the step and h = w T (s, w: fractions of the duration T) the
interval's share of the cost is h Σ_i b_i cost(q, v, u, t)(c_i), by the nodes and weights of L_d and
of the discrete forces, so that discretising and dualising commute (Ober-Blöbaum, Junge, Marsden
2011, §4; Campos, Ober-Blöbaum, Trélat 2015).
"""

from __future__ import annotations

from typing import NamedTuple

import casadi as ca

from varint.control.phase import CheckedPhase
from varint.discrete.constraints import velocity_rows
from varint.discrete.lagrangian import constraint_function, interval
from varint.discrete.nonholonomic import half_reaction, slips


class Shared(NamedTuple):
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


class IntervalTerm(NamedTuple):
    """One interval: `stage` = [q_k, λ_k, z_k, u, inner points, inner λ, slacks], then `after` =
    [q_{k+1}, u_{k+1} where it matters]; s, w; shares by kind of row. λ_k: of the constraints, then
    of the non-holonomic rows, whose slips follow the gaps.
    """

    stage: ca.SX
    after: ca.SX
    q1: ca.SX
    mesh: ca.SX
    cost: ca.SX
    p_minus: ca.SX
    p_plus: ca.SX
    inner: ca.SX
    gaps: ca.SX
    nodes: ca.SX
    points: ca.SX
    steps: ca.SX
    state_inner: ca.SX
    state_gain: ca.SX
    states: ca.SX
    integrals: ca.SX

    @property
    def shares(self) -> ca.SX:
        """All shares of rows, in the order of `Rows.of_intervals`."""
        return ca.vertcat(
            -self.p_minus,
            self.inner,
            self.gaps,
            self.nodes,
            self.points,
            self.steps,
            self.state_inner,
            -self.states,
            self.state_gain,
            self.integrals,
            self.p_plus,
        )


def interval_term(phase: CheckedPhase, shared: Shared) -> IntervalTerm:
    """Cost, momenta and rows of one interval in terms of positions (not increments), times and
    controls.
    """
    step, system, rule = interval(phase.system, phase.rule), phase.system, phase.rule
    (n, degree), r = step.dq.shape, len(rule.nodes)
    q0, q1, inner = ca.SX.sym("q0", n), ca.SX.sym("q1", n), ca.SX.sym("Q", n, degree - 1)
    u = ca.SX.sym("u", system.structure.controls, phase.samples)
    u1 = ca.SX.sym("u1", phase.closing_controls)
    # of q1: counted in the next interval
    lam = ca.SX.sym("lam", system.structure.constraints, degree)
    nu = ca.SX.sym("nu", system.structure.nonholonomic)
    z = ca.SX.sym("z", len(phase.states.index))
    slack = ca.SX.sym("slack", phase.slacks.count, r)
    mesh = ca.SX.sym("mesh", 2)
    h = mesh[1] * shared.duration
    controls = _controls_at_nodes(phase, u, u1)
    slopes = [(u1[int(i)] - u[int(i), 0]) / h for i in phase.rates.index]
    rates = ca.vertcat(ca.SX(0, 1), *slopes)
    own = [step.q0, step.dq, step.u, step.lam, step.t, step.h, step.c]
    given = [
        q0,
        ca.horzcat(inner, q1) - ca.repmat(q0, 1, degree),
        controls,
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
        slips(system, step),
    ]
    made = ca.Function("interval", own, wanted)(*given)
    p_minus, p_plus, rows, gaps, q_nodes, v_nodes, t_nodes, slip = made
    if nu.numel():
        p_minus -= half_reaction(system, q0, given[4], shared.c, h, nu)
    s, bounds, states = system, phase.bounds, phase.states
    along = ca.Function(
        "along",
        [s.q, s.v, s.control, phase.slacks.symbols, phase.rates.symbols, s.t, s.c],
        [
            phase.cost,
            ca.vertcat(bounds.at_nodes, phase.slacks.rows),
            phase.integrals.rows,
            states.rates,
        ],
    )
    each, weights = [ca.repmat(x, 1, r) for x in (rates, shared.c)], ca.DM(rule.weights)
    values, rows_at_nodes, integrands, flow = along.map(r)(
        q_nodes, v_nodes, controls, slack, each[0], t_nodes, each[1]
    )
    flows = h * ca.densify(flow)
    at_points = ca.Function("held", [s.q, s.t, s.c], [bounds.at_points]).map(degree)
    point_rows = at_points(
        ca.horzcat(inner, q1),
        given[4] + h * ca.DM(rule.points[1:]).T,
        ca.repmat(shared.c, 1, degree),
    )
    at_steps = ca.Function("steps", [phase.rates.symbols, s.c], [bounds.at_steps])
    chosen = ca.vertcat(ca.SX(0, r), *(controls[int(i), :] for i in states.index))
    state_inner = chosen - ca.repmat(z, 1, r) - ca.mtimes(flows, ca.DM(rule.collocation).T)
    stage = [q0, lam[:, 0], nu, z, ca.vec(u), ca.vec(inner), ca.vec(lam[:, 1:]), ca.vec(slack)]
    return IntervalTerm(
        stage=ca.vertcat(*stage),
        after=ca.vertcat(q1, u1),
        q1=q1,
        mesh=mesh,
        cost=h * ca.mtimes(values, weights),
        p_minus=ca.densify(p_minus),
        p_plus=ca.densify(p_plus),
        inner=ca.vec(ca.densify(rows)),
        gaps=ca.vertcat(ca.vec(gaps), slip),
        nodes=ca.vec(rows_at_nodes),
        points=ca.vec(point_rows),
        steps=ca.densify(at_steps(rates, shared.c)),
        state_inner=ca.densify(ca.vec(state_inner)),
        state_gain=z + ca.mtimes(flows, weights),
        states=z,
        integrals=ca.densify(h * ca.mtimes(integrands, weights)),
    )


def _controls_at_nodes(phase: CheckedPhase, u: ca.SX, u1: ca.SX) -> ca.SX:
    """The controls at the quadrature nodes, (k, r)."""
    nodes = phase.rule.nodes
    if phase.linear:
        return ca.horzcat(*(u + c * (u1 - u) for c in nodes))
    return u if phase.samples == len(nodes) else ca.repmat(u, 1, len(nodes))


class EndTerm(NamedTuple):
    """One end: q, v, states and (at the end of the phase) λ_N and slacks; `momentum` = ∂L/∂v −
    reaction of the last half weight.
    """

    q: ca.SX
    v: ca.SX
    states: ca.SX
    lam: ca.SX
    slack: ca.SX
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
        ca.SX.sym("lam", s.structure.velocity_rows if last else 0),
    )
    mesh, t = ca.SX.sym("mesh", 2), shared.t0 + (shared.duration if last else 0)
    end = phase.end if last else phase.start
    z, own = ca.SX.sym("z", len(phase.states.index)), phase.end_slacks
    slack = ca.SX.sym("slack", own.count if last else 0)
    end_rows = ca.vertcat(end.rows, own.rows) if last else end.rows
    at = ca.Function(
        "end",
        [s.q, s.v, phase.states.symbols(s), own.symbols if last else slack, s.t, s.c],
        [
            s.momentum,
            s.constraint,
            velocity_rows(s),
            end_rows,
            phase.bounds.at_points,
            phase.terminal if last else ca.SX(0),
        ],
    )
    momentum, gap, hidden, rows, points, terminal = at(q, v, z, slack, t, shared.c)
    if last and lam.numel():
        h, m = mesh[1] * shared.duration, s.structure.constraints
        own, nu = ca.vertsplit(lam, [0, m, lam.numel()])
        _, slope = constraint_function(s)(q, t, shared.c)
        momentum -= h * phase.rule.weights[-1] * ca.mtimes(slope.T, own)
        momentum -= half_reaction(s, q, t, shared.c, h, nu)
    return EndTerm(
        q=q,
        v=v,
        states=z,
        lam=lam,
        slack=slack,
        mesh=mesh,
        cost=terminal,
        momentum=ca.densify(momentum),
        gap=gap,
        hidden=ca.densify(hidden),
        rows=rows,
        points=points,
    )

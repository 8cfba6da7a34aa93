"""Discrete mechanics on one step: discrete Lagrangian, discrete forces, Legendre transforms, inner
rows.

With control points Q_0 … Q_d of the step (Q_0 = q0, Q_d = q1) the discrete Lagrangian is

    L_d = h Σ_i b_i L(q(c_i h), v(c_i h), t + c_i h) + h Σ_j w_j λ_j·g(Q_j),   q(τ h) = Σ_j ℓ_j(τ)
    Q_j,

and the row of control point j is ``e_j = ∂L_d/∂Q_j + f_j`` with the discrete force f_j = h Σ_i b_i
ℓ_j(c_i) F_i. The forced discrete Legendre transforms are p⁻ = −e_0 and p⁺ = e_d; the inner rows e_1
… e_{d−1} vanish (Marsden & West, Acta Numerica 2001, §1.5, 3.2; Ober-Blöbaum & Saake 2015).
Everything is written in the increments Q_j − q0: they keep the digits that the difference of two
positions would lose. All verbs of varint are built on this one record.
"""

from __future__ import annotations

from typing import NamedTuple

import casadi as ca

from varint.discrete.suitability import require_discretisable
from varint.rules.rule import Rule
from varint.scene.memory import per_scene, per_system
from varint.scene.system import System


class Interval(NamedTuple):
    """One step of the discretised scene as SX expressions of its own symbols.

    Attributes
    ----------
    q0 : SX (n,)
        Start of the step.
    dq : SX (n, d)
        Increments Q_j − q0 of the control points j = 1 … d; the last is q1 − q0.
    u : SX (k, r)
        Controls at the r quadrature nodes.
    lam : SX (m, d + 1)
        Multipliers of the holonomic constraints at the control points.
    t, h, c : SX
        Time at the start of the step, step size, parameter vector.
    action : SX
        L_d, with the constraint terms λ·g.
    total : SX (n,)
        Σ_j e_j = h Σ_i b_i (∂L/∂q + F)_i + reactions: what the momentum gains in the step.
    rows : SX (n, d)
        e_1 … e_d.
    gaps : SX (m, d)
        g at the control points 1 … d.
    q_nodes, v_nodes : SX (n, r)
        Path and velocity at the quadrature nodes.
    t_nodes : SX (1, r)
        Times of the quadrature nodes.
    """

    q0: ca.SX
    dq: ca.SX
    u: ca.SX
    lam: ca.SX
    t: ca.SX
    h: ca.SX
    c: ca.SX
    action: ca.SX
    total: ca.SX
    rows: ca.SX
    gaps: ca.SX
    q_nodes: ca.SX
    v_nodes: ca.SX
    t_nodes: ca.SX

    @property
    def p_minus(self) -> ca.SX:
        """Forced discrete Legendre transform at the start, p⁻ = −D1 L_d − f⁻, (n,)."""
        return ca.sum2(self.rows) - self.total

    @property
    def p_plus(self) -> ca.SX:
        """Forced discrete Legendre transform at the end, p⁺ = D2 L_d + f⁺, (n,)."""
        return self.rows[:, -1]

    @property
    def inner(self) -> ca.SX:
        """Rows of the inner control points, (n, d − 1); zero along a discrete path."""
        return self.rows[:, :-1]


@per_scene
def point_function(system: System) -> ca.Function:
    """(q, v, u, t, c) → (L, ∂L/∂v, ∂L/∂q, F), the mechanics at one point of a path."""
    s = system
    gradient = ca.gradient(s.lagrangian, s.q)
    outputs = [s.lagrangian, s.momentum, gradient, s.force]
    return ca.Function("point", [s.q, s.v, s.control, s.t, s.c], outputs, {"cse": True})


@per_scene
def energy_function(system: System) -> ca.Function:
    """(q, v, t, c) → H."""
    return ca.Function(
        "energy",
        [system.q, system.v, system.t, system.c],
        [ca.densify(system.energy)],
        {"cse": True},
    )


@per_scene
def constraint_function(system: System) -> ca.Function:
    """(q, t, c) → (g, G) with G = ∂g/∂q of the holonomic constraints."""
    s = system
    return ca.Function(
        "constraint", [s.q, s.t, s.c], [s.constraint, ca.jacobian(s.constraint, s.q)]
    )


@per_system
def interval(system: System, rule: Rule) -> Interval:
    """Discrete mechanics of `system` by `rule` on one step.

    Returns
    -------
    Interval

    Raises
    ------
    InputError
        If the rule cannot discretise the scene: a composition needs a separable Lagrangian with
        constant mass, constraints need a Lobatto rule.
    """
    require_discretisable(system, rule)
    return _galerkin(system, rule) if rule.points else _composition(system, rule)


def _symbols(system: System, degree: int, nodes: int):
    s = system.structure
    q0, dq = ca.SX.sym("q0", s.n), ca.SX.sym("dq", s.n, degree)
    u, lam = ca.SX.sym("u", s.controls, nodes), ca.SX.sym("lam", s.constraints, degree + 1)
    return q0, dq, u, lam, ca.SX.sym("t"), ca.SX.sym("h")


def _galerkin(system: System, rule: Rule) -> Interval:
    degree, r = rule.degree, len(rule.nodes)
    q0, dq, u, lam, t, h = _symbols(system, degree, r)
    point, c = point_function(system), system.c
    basis, slopes, b = ca.DM(rule.basis[:, 1:]), ca.DM(rule.slopes[:, 1:]), rule.weights
    q_nodes = ca.repmat(q0, 1, r) + ca.mtimes(dq, basis.T)
    v_nodes = ca.mtimes(dq, slopes.T) / h
    t_nodes = t + h * ca.DM(rule.nodes).T
    action, total, rows = 0, ca.SX.zeros(q0.shape), ca.SX.zeros(dq.shape)
    for i in range(r):
        value, momentum, gradient, force = point(
            q_nodes[:, i], v_nodes[:, i], u[:, i], t_nodes[i], c
        )
        generalised_force = ca.densify(h * b[i] * (gradient + force))
        action += h * b[i] * value
        total += generalised_force
        rows += ca.mtimes(generalised_force, basis[i, :]) + ca.mtimes(
            ca.densify(b[i] * momentum), slopes[i, :]
        )
    gaps = []
    if lam.numel():
        for j in range(degree + 1):
            q_j = q0 + dq[:, j - 1] if j else q0
            g, slope = constraint_function(system)(q_j, t + h * rule.points[j], c)
            reaction = h * b[j] * ca.mtimes(slope.T, lam[:, j])
            action += h * b[j] * ca.dot(lam[:, j], g)
            total += reaction
            if j:
                rows[:, j - 1] += reaction
                gaps.append(g)
    return Interval(
        q0,
        dq,
        u,
        lam,
        t,
        h,
        c,
        action,
        total,
        rows,
        ca.horzcat(*gaps) if gaps else ca.SX(0, degree),
        q_nodes,
        v_nodes,
        t_nodes,
    )


def _composition(system: System, rule: Rule) -> Interval:
    """Product of discrete Lagrangians, Σ a_j h T(Δ_j/(a_j h)) − Σ b_i h V(Q_i); inner points:
    the drifts' ends.
    """
    degree, r = len(rule.drifts), len(rule.kicks)
    q0, dq, u, lam, t, h = _symbols(system, degree, r)
    point, c = point_function(system), system.c
    rest = ca.DM.zeros(q0.shape)
    q_nodes = ca.horzcat(q0, ca.repmat(q0, 1, degree) + dq)
    t_nodes = t + h * ca.DM(rule.nodes).T
    before = ca.horzcat(ca.SX.zeros(q0.shape), dq[:, :-1])
    drift = (dq - before) / (h * ca.repmat(ca.DM(rule.drifts).T, q0.numel(), 1))
    momenta = ca.horzcat(*(point(q0, drift[:, j], u[:, 0], t, c)[1] for j in range(degree)))
    action, total, rows = 0, ca.SX.zeros(q0.shape), ca.densify(momenta)
    rows[:, :-1] -= momenta[:, 1:]
    for j, a in enumerate(rule.drifts):
        action += (
            a * h * (point(q0, drift[:, j], u[:, 0], t, c)[0] - point(q0, rest, u[:, 0], t, c)[0])
        )
    for i, b in enumerate(rule.kicks):
        value, _, gradient, force = point(q_nodes[:, i], rest, u[:, i], t_nodes[i], c)
        generalised_force = ca.densify(h * b * (gradient + force))
        action += h * b * value
        total += generalised_force
        if i:
            rows[:, i - 1] += generalised_force
    ends = ca.horzcat(drift[:, 0], drift, drift[:, -1])
    v_nodes = (ends[:, :-1] + ends[:, 1:]) / 2
    return Interval(
        q0, dq, u, lam, t, h, c, action, total, rows, ca.SX(0, degree), q_nodes, v_nodes, t_nodes
    )

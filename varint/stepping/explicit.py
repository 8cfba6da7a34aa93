"""Kick and drift: explicit steps of separable Lagrangians with constant mass. No equation is solved."""

from __future__ import annotations

import casadi as ca

from varint.discrete import point_function, require_explicit
from varint.legendre import mass_solve
from varint.rules import Rule
from varint.stepping.stepper import Stepper, compensated, zeros
from varint.system import System, per_system


@per_system
def explicit_stepper(system: System, rule: Rule) -> Stepper:
    """Stepper for p ← p + b_i h F(q, t), q ← q + a_i h M⁻¹ p in turn (Hairer–Lubich–Wanner II.5).

    The force at the end of a step is kept for the first kick of the next one; with controls, which jump there, it is
    evaluated anew.
    """
    require_explicit(system, rule)
    s, n = system, system.structure.n
    keeps = not s.structure.controls
    kick, drift = kick_function(system), drift_function(system)
    q, cq, p, cp = (ca.SX.sym(name, n) for name in ("q", "cq", "p", "cp"))
    force = ca.SX.sym("force", n if keeps else 0)
    worst, t, h = (ca.SX.sym(name) for name in ("worst", "t", "h"))
    scale = ca.SX.sym("scale", 2 * n)
    u = ca.SX.sym("u", s.structure.controls, len(rule.kicks))
    before = ca.vertcat(q, cq, p, cp, force, worst)
    q_start, drifts = q, []
    f = force if keeps else kick(q, u[:, 0], t, s.c)
    for i, b in enumerate(rule.kicks):
        if i:
            q, cq = compensated(q, cq, drift(p, s.c) * (rule.drifts[i - 1] * h), h)
            f = kick(q, u[:, i], t + rule.nodes[i] * h, s.c)
            drifts.append(q - q_start)
        p, cp = compensated(p, cp, f * (b * h), h)
    after = ca.vertcat(q, cq, p, cp, f if keeps else force, worst)
    inputs = [before, ca.vec(u), t, h, s.c, scale]
    step, path = ca.Function("kick_drift", inputs, [after]), ca.Function("path", inputs, [ca.vertcat(*drifts)])
    q, p = ca.SX.sym("q", n), ca.SX.sym("p", n)
    first = kick(q, u[:, 0], t, s.c) if keeps else zeros(0)
    x0 = ca.vertcat(q, zeros(n), p, zeros(n), first, 0)
    return Stepper(step, ca.Function("start", [q, p, ca.vec(u), t, h, s.c], [x0]), path)


@per_system
def kick_function(system: System) -> ca.Function:
    """(q, u, t, c) → ∂L/∂q + F, which velocities do not enter."""
    s = system
    _, _, gradient, force = point_function(s)(s.q, ca.SX.zeros(s.v.shape), s.control, s.t, s.c)
    return ca.Function("kick", [s.q, s.control, s.t, s.c], [ca.densify(gradient + force)], {"cse": True})


@per_system
def drift_function(system: System) -> ca.Function:
    """(p, c) → v = M⁻¹ (p − ∂L/∂v(v = 0))."""
    s = system
    p = ca.SX.sym("p", s.structure.n)
    offset = ca.substitute(s.momentum, s.v, ca.SX.zeros(s.v.shape))
    v = mass_solve(s.mass_matrix, p - offset)
    return ca.Function("drift", [p, s.c], [ca.densify(v)], {"cse": True})

"""Kick and drift: explicit steps of separable Lagrangians with constant mass. No equation is
solved.
"""

from __future__ import annotations

import casadi as ca

from varint.discrete.kick_drift import drift_function, kick_function
from varint.integration.steppers.stepper import (
    Method,
    Stepper,
    compensated_sum,
    first_state,
    state_symbols,
    zeros,
)
from varint.rules.rule import Rule
from varint.scene.memory import per_system
from varint.scene.system import System


@per_system
def explicit_stepper(system: System, rule: Rule) -> Stepper:
    """Stepper for p ← p + b_i h F(q, t), q ← q + a_i h M⁻¹ p in turn (Hairer–Lubich–Wanner II.5).

    The force at the end of a step is kept for the first kick of the next one; with controls, which
    jump there, it is evaluated anew.
    """
    s, n = system, system.structure.n
    keeps = not s.structure.controls
    kick, drift = kick_function(system), drift_function(system)
    before = state_symbols(n, n if keeps else 0)
    q, cq, p, cp, force, *_ = before
    t, h, scale = ca.SX.sym("t"), ca.SX.sym("h"), ca.SX.sym("scale", 2 * n)
    u = ca.SX.sym("u", s.structure.controls, len(rule.kicks))
    drifts = []
    f = force if keeps else kick(q, u[:, 0], t, s.c)
    for i, b in enumerate(rule.kicks):
        if i:
            q, cq = compensated_sum(q, cq, drift(p, s.c) * (rule.drifts[i - 1] * h), h)
            f = kick(q, u[:, i], t + rule.nodes[i] * h, s.c)
            drifts.append(q - before.q)
        p, cp = compensated_sum(p, cp, f * (b * h), h)
    after = before._replace(q=q, q_rest=cq, p=p, p_rest=cp, memory=f if keeps else force)
    inputs = [before.vector, ca.vec(u), t, h, s.c, scale]
    step, path = (
        ca.Function("kick_drift", inputs, [after.vector]),
        ca.Function("path", inputs, [ca.vertcat(*drifts)]),
    )
    q, p = ca.SX.sym("q", n), ca.SX.sym("p", n)
    x0 = first_state(q, p, kick(q, u[:, 0], t, s.c) if keeps else zeros(0))
    return Stepper(step, ca.Function("start", [q, p, ca.vec(u), t, h, s.c], [x0]), path)


def _runs(system: System, rule: Rule) -> tuple[str, ...]:
    controlled = bool(system.structure.controls)
    evaluations = len(rule.kicks) - (0 if controlled else 1)
    kept = ": controls jump from step to step" if controlled else ", kept from step to step"
    return (f"{evaluations} force evaluation{'s' * (evaluations > 1)} a step{kept}",)


def _skips(system: System, rule: Rule) -> tuple[str, ...]:
    skipped = ("root finding: L = ½ vᵀMv − V(q, t) with constant M",)
    return (*skipped, "matrix solves: M is diagonal") if system.structure.diagonal_mass else skipped


EXPLICIT = Method(
    name="kick and drift",
    applies=lambda system, rule: bool(rule.kicks) and system.structure.explicit,
    runs=_runs,
    skips=_skips,
    build=explicit_stepper,
)

"""Constraints on a separable scene with constant mass by the trapezoidal rule: only the multipliers
are unknown.

q1 = q0 + h M⁻¹(p0 + ½h (F0 + G0ᵀλ)) with g(q1) = 0, then p1 with G1 v1 = −∂g/∂t: SHAKE and RATTLE
(Andersen 1983; Leimkuhler & Skeel 1994; Hairer, Lubich & Wanner VII.1). The m × m matrices G M⁻¹Gᵀ
are banded for chains.
"""

from __future__ import annotations

import casadi as ca

from varint.discrete.constrained_equations import size_function
from varint.discrete.equations import Equations
from varint.discrete.kick_drift import kick_function
from varint.discrete.lagrangian import constraint_function
from varint.discrete.shake_equations import (
    eliminates_path,
    projection_function,
    shake_equations,
)
from varint.integration.steppers.newton import NEVER, iterations, newton
from varint.integration.steppers.stepper import (
    Method,
    State,
    Stepper,
    compensated_sum,
    first_state,
    state_parts,
    state_size,
    sum_function,
)
from varint.rules.rule import Rule
from varint.scene.memory import per_system
from varint.scene.system import System


@per_system
def rattle_stepper(system: System, rule: Rule) -> Stepper:
    """Stepper by the multipliers alone; the same discrete motion as `constrained_stepper`."""
    s, n, m = system, system.structure.n, system.structure.constraints
    e = shake_equations(s)
    solve, travel = _shake(e)
    kick, project = kick_function(s), projection_function(s)
    x, scale = ca.MX.sym("x", state_size(n, n + m)), ca.MX.sym("scale", 2 * n)
    u, t, h, c = (
        ca.MX.sym(name, k)
        for name, k in zip("uthc", (2 * s.structure.controls, 1, 1, s.c.numel()), strict=True)
    )
    q0, cq0, p0, cp0, memory, count, worst = state_parts(x, n)
    kept, guess = ca.vertsplit(memory, [0, n, n + m])
    u0, u1 = ca.vertsplit(u, [0, s.structure.controls, 2 * s.structure.controls])
    force = kick(q0, u0, t, c) if s.structure.controls else kept
    size = size_function(s)(q0, t, h, c, scale)
    unit = ca.vertsplit(size, [0, n, n + m, 2 * (n + m)])[1]
    kicked = p0 + h / 2 * force
    lam, more = ca.vertsplit(
        solve(ca.vertcat(guess / unit, 0), q0, kicked, t, h, c, size), [0, m, m + 1]
    )
    lam = lam * unit
    q1, cq1, gain, increment, gap = travel(lam, q0, cq0, kicked, t, h, c, size)
    after = ca.densify(kick(q1, u1, t + h, c))  # CasADi drops zeros that a scene without forces has
    gain = gain + h / 2 * (force + after)
    reaction = project(q1, p0 + gain, t + h, c)
    p1, cp1 = sum_function(n)(p0, cp0, gain + reaction, h)
    inputs = [x, u, t, h, c, scale]
    done = count + iterations(more), ca.fmax(worst, gap)
    state = State(q1, cq1, p1, cp1, ca.vertcat(after, lam), *done)
    step = ca.Function("rattle", inputs, [state.vector])
    impulse = h / 2 * ca.mtimes(constraint_function(s)(q0, t, c)[1].T, lam)
    reactions = ca.Function("reactions", inputs, [ca.horzcat(impulse, reaction)])
    return Stepper(step, _start(s), ca.Function("path", inputs, [increment]), reactions)


def _shake(e: Equations) -> tuple[ca.Function, ca.Function]:
    """The root finder for the multipliers, and what follows from them: q1, the momentum gain so
    far, the size of g.
    """
    arguments = [e.q, e.p, e.t, e.h, e.c, e.sizes]
    # G M⁻¹Gᵀ of a chain is tridiagonal: no zero is filled, sparse QR is safe and fast at any length
    solve = newton(
        "newton", ca.Function("gaps", [e.y, *arguments], [e.scaled], {"cse": True}), large=NEVER
    )
    cq = ca.SX.sym("cq", e.q.numel())
    q1, cq1 = compensated_sum(e.q, cq, e.increment, e.h)
    outputs = [q1, cq1, e.gain, e.increment, ca.norm_inf(e.remains)]
    return solve, ca.Function("travel", [e.y, e.q, cq, *arguments[1:]], outputs, {"cse": True})


def _start(system: System) -> ca.Function:
    s, n = system, system.structure.n
    q, p, t, h = ca.SX.sym("q", n), ca.SX.sym("p", n), ca.SX.sym("t"), ca.SX.sym("h")
    u = ca.SX.sym("u", 2 * s.structure.controls)
    force = ca.densify(kick_function(s)(q, u[: s.structure.controls], t, s.c))
    x = first_state(q, p, ca.vertcat(force, ca.SX.zeros(s.structure.constraints)))
    return ca.Function("start", [q, p, u, t, h, s.c], [x])


RATTLE = Method(
    name="SHAKE and RATTLE",
    applies=lambda system, rule: (
        bool(system.structure.constraints) and eliminates_path(system, rule)
    ),
    runs=lambda system, rule: (
        f"Newton's method for {system.structure.constraints} multipliers, banded for chains "
        "(SHAKE)",
        "projection of the momentum onto the hidden constraint at the end of the step (RATTLE)",
        "1 force evaluation a step"
        + ("" if system.structure.controls else ", kept from step to step"),
    ),
    skips=lambda system, rule: (
        "unknown positions: eliminated, L = ½ vᵀMv − V(q, t) with constant M",
    ),
    build=rattle_stepper,
)

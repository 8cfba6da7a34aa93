"""The derivatives of single steps, of many at once: where a run is too short to compile its loops,
or there is no compiler.
"""

from __future__ import annotations

import casadi as ca

from varint.discrete.constrained_equations import CORRECTION_FLOOR
from varint.discrete.step_map import StepMap, path_guess, running, step_map
from varint.rules.rule import Rule
from varint.scene.memory import per_system
from varint.scene.system import System

ITERATIONS = 6  # of Newton's method from the path through both ends: its error, squared each time


@per_system
def linear_step(system: System, rule: Rule) -> ca.Function:
    """(x, x', v, v', t, h, u, c) → Φ = ∂x'/∂x, B = ∂x'/∂e, the last correction of the unknowns.

    e = (c, h, t, u) with the controls of all nodes. With a loss, of `lossy_step`, also its sum over
    the step and its derivatives with respect to x and e.
    """
    return _linear_step(system, rule, None)


@per_system
def lossy_step(system: System, rule: Rule, density: str) -> ca.Function:
    """`linear_step` with three more outputs: ∫ ℓ dt over the step by the rule's weights, and its
    derivatives with respect to x and e. `density` is the function (q, v, t, u, c) → ℓ, serialised.
    """
    return _linear_step(system, rule, ca.Function.deserialize(density))


@per_system
def operations(system: System, rule: Rule) -> tuple[int, int]:
    """Operations of a step with all its derivatives, those of its factorisations included, and the
    statements of its parts written out once.
    """
    s = step_map(system, rule)
    slopes, solve = (_derivatives(s, ca.SX(0))[name] for name in ("slopes", "solve"))
    once, again = slopes.n_instructions(), solve.n_instructions()
    n, unknowns = s.q.numel(), s.y.numel()
    nonzeros = solve.nnz_out(1)
    factors = nonzeros * unknowns // 3 + nonzeros * (2 * n + s.outside.numel())
    turn = once + (ITERATIONS + 1) * (again + factors)
    return len(s.parts) * turn, 2 * (once + again)


def _linear_step(system: System, rule: Rule, density: ca.Function | None) -> ca.Function:
    s, n = step_map(system, rule), system.structure.n
    nodes, k = len(rule.nodes), system.structure.controls
    value = ca.SX(0) if density is None else running(s, density)
    derivatives = _derivatives(s, value)
    sizes = (2 * n, 2 * n, n, n, 1, 1, nodes * k, s.c.numel())
    inputs = [ca.MX.sym(f"a{i}", size) for i, size in enumerate(sizes)]
    x, x1, v, v1, t, h, u, c = inputs
    outer = s.c.numel() + 2
    state, of_x, of_e = x, ca.MX.eye(2 * n), ca.MX(2 * n, outer + nodes * k)
    loss, loss_x, loss_e, worst = ca.MX(0), ca.MX(1, 2 * n), ca.MX(1, outer + nodes * k), ca.MX(0)
    for r in range(len(s.parts)):
        q, p = ca.vertsplit(state, n)
        width = s.u.numel()
        mine = u[r * width : (r + 1) * width] if width else ca.MX(0, 1)
        arguments = [q, p, t, mine, ca.MX(s.parts[r]), c, h]
        y, worst = unknowns(s, arguments, x, x1, v, v1, h)
        fx, fe, gy, gx, ge, ly, lx, le, amount, after = derivatives["slopes"](y, *arguments)
        if s.y.numel():
            fy = derivatives["solve"](y, *arguments)[1]
            inner = ca.solve(fy, ca.densify(ca.horzcat(fx, fe)), "csparse")
            gx, ge = gx - gy @ inner[:, : 2 * n], ge - gy @ inner[:, 2 * n :]
            lx, le = lx - ly @ inner[:, : 2 * n], le - ly @ inner[:, 2 * n :]
        places = [*range(outer), *range(outer + r * width, outer + (r + 1) * width)]
        spread = ca.DM.eye(outer + nodes * k)[places, :]
        loss, loss_x = loss + amount, loss_x + lx @ of_x
        loss_e = loss_e + lx @ of_e + le @ spread
        of_x, of_e, state = gx @ of_x, gx @ of_e + ge @ spread, after
    outputs = [of_x, of_e, worst]
    if density is not None:
        outputs += [loss, loss_x.T, loss_e.T]
    return ca.Function("linear_step", inputs, [ca.densify(a) for a in outputs])


def _derivatives(s: StepMap, value: ca.SX) -> dict[str, ca.Function]:
    inputs = [s.y, s.q, s.p, s.t, s.u, s.part, s.c, s.h]
    slopes = [
        ca.jacobian(s.left, s.state),
        ca.jacobian(s.left, s.outside),
        ca.jacobian(s.after, s.y),
        ca.jacobian(s.after, s.state),
        ca.jacobian(s.after, s.outside),
        *(ca.jacobian(value, x) for x in (s.y, s.state, s.outside)),
        value,
        s.after,
    ]
    solve = [s.left, ca.jacobian(s.left, s.y)]
    return {
        "slopes": ca.Function("slopes", inputs, slopes, {"cse": True}),
        "solve": ca.Function("solve", inputs, solve, {"cse": True}),
    }


def unknowns(
    s: StepMap, arguments: list[ca.MX], x: ca.MX, x1: ca.MX, v: ca.MX, v1: ca.MX, h: ca.MX
) -> tuple[ca.MX, ca.MX]:
    """The unknowns of a step whose ends are known, and their last relative correction."""
    if not s.y.numel():
        return ca.MX(0, 1), ca.MX(0)
    n, mean, y = s.q.numel(), (x1[: s.q.numel()] - x[: s.q.numel()]) / h, _guess(s, x, x1, v, v1, h)
    solve = _derivatives(s, ca.SX(0))["solve"]
    worst = ca.MX(0)
    fast = ca.norm_inf(mean) + ca.norm_inf(v) + ca.norm_inf(v1)
    far = CORRECTION_FLOOR * ca.norm_inf(x[:n]) / ca.fabs(h)
    for count in range(ITERATIONS):
        left, slope = solve(y, *arguments)
        change = ca.solve(slope, left, "csparse")
        y = y - change
        moved = change[: n * len(s.points)]
        if not count:  # what forces alone would make of a body at rest, which may be held
            rows = range(moved.numel())
            far += ca.norm_inf(left[rows] / (ca.sum2(ca.fabs(slope[rows, rows])) + 1e-300))
        worst = ca.norm_inf(moved) / (fast + far + 1e-300)
    return y, worst


def _guess(s: StepMap, x: ca.MX, x1: ca.MX, v: ca.MX, v1: ca.MX, h: ca.MX) -> ca.MX:
    """The unknowns of a step as the path through both of its ends has them."""
    n, table = s.q.numel(), path_guess(s.points)
    mean = (x1[:n] - x[:n]) / h
    path = [a * mean + b * v + d * v1 for a, b, d in table.tolist()]
    others = s.y.numel() - n * len(path) - s.ends
    ends = [v1, ca.MX.zeros(s.ends - n)] if s.ends else []
    return ca.vertcat(*path, ca.MX.zeros(others), *ends)


@per_system
def equations_at_guess(system: System, rule: Rule) -> ca.Function:
    """(x, x', v, v', t, h, u, c) → F and the nonzeros of F_y where Newton's method begins, of the
    first part of a step: whether it is numbers that are missing or an inverse.
    """
    s, n = step_map(system, rule), system.structure.n
    width = len(rule.nodes) * system.structure.controls
    sizes = (2 * n, 2 * n, n, n, 1, 1, width, s.c.numel())
    inputs = [ca.MX.sym(f"a{i}", size) for i, size in enumerate(sizes)]
    x, x1, v, v1, t, h, u, c = inputs
    y = _guess(s, x, x1, v, v1, h) if s.y.numel() else ca.MX(0, 1)
    q, p = ca.vertsplit(x, n)
    arguments = [q, p, t, u[: s.u.numel()], ca.MX(s.parts[0]), c, h]
    left, slope = _derivatives(s, ca.SX(0))["solve"](y, *arguments)
    return ca.Function("equations", inputs, [ca.densify(left), ca.densify(slope)])

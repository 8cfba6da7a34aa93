"""One step as a map that its equations give implicitly: what derivatives of runs are made of.

A step takes the state x = (q, p) to x' = G(x, y, e), where the unknowns y solve F(x, y, e) = 0 and
e are the parameters, the step, the time and the controls. By the implicit function theorem

    dx' = (G_x − G_y F_y⁻¹ F_x) dx + (G_e − G_y F_y⁻¹ F_e) de

(Marsden & West 2001, §1.5, for the map; Hairer, Lubich & Wanner VI.4 for its derivative). Explicit
steps have no unknowns; they are a sequence of such maps, one a kick and the drift behind it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from varint.discrete.composed import base_of, shares
from varint.discrete.constrained_equations import constrained_equations
from varint.discrete.constraints import velocity_rows
from varint.discrete.equations import Equations, implicit_equations
from varint.discrete.kick_drift import drift_function, kick_function
from varint.discrete.lagrangian import Interval, interval
from varint.rules.rule import Rule
from varint.scene.memory import per_system
from varint.scene.system import System


@dataclass(frozen=True, eq=False)
class StepMap:
    """A step, or one of the parts that it is a sequence of, as SX expressions of its own symbols.

    Attributes
    ----------
    q, p : SX (n,)
        State before.
    y : SX
        Unknowns: mean velocities (Q_j − q0)/h, multipliers, then velocity and multipliers at the
        end; none of an explicit step.
    u, t, h, c : SX
        Controls of this part (k·r, column by column), time and size of the step, parameters.
    part : SX
        What tells the parts of a step apart, numbers that `parts` has in its rows.
    left : SX
        F, as many as unknowns.
    after : SX (2n,)
        G.
    parts : ndarray (parts, numbers)
        One row a part.
    points : tuple of float
        Control points behind the first; the first len(points)·n unknowns are the mean velocities.
    ends : int
        So many of the last unknowns belong to the end of the step: n velocities, then multipliers.
    weight : SX (r,)
        Weights of the quadrature nodes of this part, in units of time.
    q_nodes, v_nodes : SX (n, r)
        Path and velocity there.
    t_nodes : SX (1, r)
        Times there.
    """

    q: ca.SX
    p: ca.SX
    y: ca.SX
    u: ca.SX
    t: ca.SX
    h: ca.SX
    c: ca.SX
    part: ca.SX
    left: ca.SX
    after: ca.SX
    parts: np.ndarray
    points: tuple[float, ...]
    ends: int
    weight: ca.SX
    q_nodes: ca.SX
    v_nodes: ca.SX
    t_nodes: ca.SX

    @property
    def state(self) -> ca.SX:
        """x = (q, p)."""
        return ca.vertcat(self.q, self.p)

    @property
    def outside(self) -> ca.SX:
        """e = (c, h, t, u): what is no state."""
        return ca.vertcat(self.c, self.h, self.t, self.u)

    @property
    def inputs(self) -> list[ca.SX]:
        """Symbols but for what stays the same all the time, c and h."""
        return [self.y, self.q, self.p, self.t, self.u, self.part]


@per_system
def step_map(system: System, rule: Rule) -> StepMap:
    """The map of one step of `system` by `rule`, without contacts.

    Returns
    -------
    StepMap
    """
    s = system.structure
    if s.explicit and rule.kicks:
        return _kick_and_drift(system, rule)
    if base := base_of(system, rule):
        return _in_parts(step_map(system, base), shares(system, rule))
    one = interval(system, rule)
    if s.constraints or s.nonholonomic:
        return _held(system, rule, one, constrained_equations(system, rule))
    return _free(rule, one, implicit_equations(system, rule))


def running(step: StepMap, density: ca.Function) -> ca.SX:
    """h Σ_i b_i ℓ(q_i, v_i, t_i, u_i): a function (q, v, t, u, c) → ℓ summed with the rule's
    weights over this part of a step.
    """
    k = density.numel_in(3)
    total = ca.SX(0)
    for i in range(step.weight.numel()):
        u = step.u[i * k : (i + 1) * k] if k else ca.SX(0, 1)
        total += step.weight[i] * density(
            step.q_nodes[:, i], step.v_nodes[:, i], step.t_nodes[i], u, step.c
        )
    return total


def _kick_and_drift(system: System, rule: Rule) -> StepMap:
    """p' = p + b h F(q, t + c h), then q' = q + a h M⁻¹ p'; `part` is (b, a, c)."""
    n, k = system.structure.n, system.structure.controls
    q, p, u, t, h = (
        ca.SX.sym(name, size) for name, size in zip("qputh", (n, n, k, 1, 1), strict=True)
    )
    part, drift = ca.SX.sym("part", 3), drift_function(system)
    kick, along, node = ca.vertsplit(part)
    time = t + node * h
    gained = p + kick * h * kick_function(system)(q, u, time, system.c)
    speed = drift(gained, system.c)
    moved = q + along * h * speed
    nodes = np.array([0.0, *np.cumsum(rule.drifts)])
    return StepMap(
        q,
        p,
        ca.SX(0, 1),
        u,
        t,
        h,
        system.c,
        part,
        ca.SX(0, 1),
        ca.densify(ca.vertcat(moved, gained)),
        np.column_stack([rule.kicks, [*rule.drifts, 0.0], nodes]),
        (),
        0,
        kick * h,
        q,
        (drift(p, system.c) + speed) / 2,
        time,
    )


def _in_parts(one: StepMap, parts: list[tuple[float, float]]) -> StepMap:
    """`part` is (γ, where it begins), both in units of h."""
    part = ca.SX.sym("part", 2)
    share, begun = ca.vertsplit(part)
    given = [one.left, one.after, one.weight, one.q_nodes, one.v_nodes, one.t_nodes]
    found = ca.substitute(given, [one.t, one.h], [one.t + begun * one.h, share * one.h])
    names = "left", "after", "weight", "q_nodes", "v_nodes", "t_nodes"
    changed = dict(zip(names, found, strict=True))
    return replace(one, part=part, parts=np.array(parts), **changed)


def _free(rule: Rule, one: Interval, e: Equations) -> StepMap:
    after = ca.vertcat(e.q + e.increment, e.p + e.gain)
    return _of_equations(rule, one, e, e.y, e.left, after, 0)


def _held(system: System, rule: Rule, one: Interval, e: Equations) -> StepMap:
    """With the projection at the end, ∂L/∂v(q1, v) + Wᵀμ = p0 + gain and W v + w = 0, for v, μ."""
    s, n = system, system.structure.n
    rows = velocity_rows(s)
    slope = ca.jacobian(rows, s.v)
    v, mu, reached = ca.SX.sym("v", n), ca.SX.sym("mu", rows.numel()), e.p + e.gain
    at_end = ca.Function(
        "at_end",
        [s.q, s.v, s.t, s.c],
        [s.momentum, rows, slope],
        {"cse": True},
    )
    q1 = e.q + e.increment
    momentum, closing, slope = at_end(q1, v, e.t + e.h, e.c)
    reaction = ca.mtimes(slope.T, mu)
    left = ca.vertcat(e.left, momentum + reaction - reached, closing)
    after = ca.vertcat(q1, reached - reaction)
    return _of_equations(rule, one, e, ca.vertcat(e.y, v, mu), left, after, n + rows.numel())


def _of_equations(
    rule: Rule, one: Interval, e: Equations, y: ca.SX, left: ca.SX, after: ca.SX, ends: int
) -> StepMap:
    n, d = one.dq.shape
    z = ca.reshape(e.y[: n * d], n, d)
    q_nodes, v_nodes = ca.substitute([one.q_nodes, one.v_nodes], [one.dq], [one.h * z])
    return StepMap(
        e.q,
        e.p,
        y,
        e.u,
        e.t,
        e.h,
        e.c,
        ca.SX(0, 1),
        ca.densify(left),
        ca.densify(after),
        np.empty((1, 0)),
        rule.points[1:],
        ends,
        one.h * ca.DM(rule.weights),
        q_nodes,
        v_nodes,
        one.t_nodes,
    )


def path_guess(points: tuple[float, ...]) -> np.ndarray:
    """Cubic Hermite: z_j = a_j (q1 − q0)/h + b_j v0 + c_j v1 for each control point, rows (a, b,
    c); exact at the end.
    """
    tau = np.array(points)
    return np.column_stack([tau**2 * (3 - 2 * tau), tau * (1 - tau) ** 2, tau**2 * (tau - 1)])

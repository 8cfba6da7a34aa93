"""From the solver's numbers back to mechanics: trajectories, costates, active bounds."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from varint.arrays import over_columns
from varint.control.leg import Leg
from varint.control.nlp import Outcome
from varint.control.phase import Checked
from varint.control.piecewise import Piecewise
from varint.control.problem import Problem
from varint.stepping.step_function import action_function, step_function
from varint.trajectory import Trajectory

ACTIVE = 1e-6  # of a range: this close to its bound a quantity is at it


class Costates(NamedTuple):
    """Derivatives of the optimal cost-to-go with respect to q (at constant p) and p, at every node, (N + 1, n) each.

    `p` are the multipliers μ_k of the rows p⁺_{k−1} − p⁻_k = 0 (at the ends ∂L/∂v(q_0, v_0) − p⁻_0 and
    p⁺_{N−1} − ∂L/∂v(q_N, v_N)) in the Lagrangian cost + μ·row.
    """

    q: np.ndarray
    p: np.ndarray


@dataclass(frozen=True, eq=False)
class ControlSolution:
    """What belongs to an optimal control beside its trajectory.

    Attributes
    ----------
    cost : float
        Cost of this phase, terminal cost included.
    total_cost : float
        Cost of all phases.
    q, u, costate : Piecewise
        Path, controls and costate of p as functions of the fraction of the duration.
    mesh : ndarray (N + 1,)
        Ends of the steps as fractions of the duration.
    v_ends : ndarray (2, n)
        Velocities at the two ends.
    costates : Costates
        Costates at the nodes.
    active : mapping
        Bounds that are met with equality, and the times where they are.
    status, success, violation, iterations, history, timings
        How the solver ended and got there; the largest violation of any condition; cost, violation and optimality
        after each iteration; seconds to build and to solve.
    phase : Checked
        The problem this solves.
    outcome, problem
        The solver's own numbers, from which a further solve starts warm.
    """

    cost: float
    total_cost: float
    q: Piecewise
    u: Piecewise
    costate: Piecewise
    mesh: np.ndarray
    v_ends: np.ndarray
    costates: Costates
    active: Mapping[str, np.ndarray]
    status: str
    success: bool
    violation: float
    history: Mapping[str, list[float]]
    timings: Mapping[str, float]
    phase: Checked
    outcome: Outcome
    problem: Problem

    @property
    def iterations(self) -> int:
        """Iterations of the solver."""
        return max(len(self.history.get("cost", ())) - 1, 0)


def trajectories(problem: Problem, outcome: Outcome) -> list[Trajectory]:
    """One trajectory a phase."""
    return [_trajectory(problem, outcome, one) for one in problem.legs]


def _trajectory(problem: Problem, outcome: Outcome, one: Leg) -> Trajectory:
    phase, slots, x = one.phase, one.slots, outcome.x
    count, rule, system = phase.steps, phase.rule, phase.system
    data = one.data[2 * count :]
    t0, duration, *c = np.where(slots.shared >= 0, x[slots.shared], data)
    c = np.array(c)
    uniform = np.array_equal(phase.mesh, np.arange(count + 1) / count)
    k = np.arange(count + 1)
    t = t0 + duration / count * k if uniform else t0 + duration * phase.mesh
    points, u = control_points(x, one), x[slots.u]
    p, terms = _momenta_and_terms(one, outcome)
    solution = ControlSolution(
        cost=float(terms["cost"].sum() + terms["terminal"]),
        total_cost=outcome.cost,
        q=Piecewise(phase.mesh, np.array(rule.points), points),
        u=Piecewise(phase.mesh, np.array(rule.nodes) if phase.samples > 1 else np.array([0.5]), u),
        costate=Piecewise(phase.mesh, np.array(rule.points), _costate_points(one, outcome)),
        mesh=phase.mesh,
        v_ends=x[slots.v],
        costates=Costates(terms["costate_q"], outcome.lam_g[one.rows.momentum]),
        active=MappingProxyType(_active(one, outcome, problem, t0, duration)),
        status=outcome.status,
        success=outcome.success,
        violation=outcome.violation,
        history=MappingProxyType(outcome.history),
        timings=MappingProxyType({"build": problem.seconds, "solve": outcome.seconds}),
        phase=phase,
        outcome=outcome,
        problem=problem,
    )
    return Trajectory(
        system=system, rule=rule, t=t, q=x[slots.q], p=p, h=float(duration / count) if uniform else np.diff(t),
        k=k, u=u, c=c, functions=lambda: (step_function(system, rule), action_function(system, rule)),
        multipliers=x[slots.lam] if slots.lam.size else None,
        stats=MappingProxyType({"plan": f"optimal control by {rule}", "steps": count, "seconds": outcome.seconds}),
        solution=solution,
    )  # fmt: skip


def control_points(x: np.ndarray, one: Leg) -> np.ndarray:
    """Positions at the control points of every step, (N, d + 1, n)."""
    slots = one.slots
    return np.concatenate([x[slots.q[:-1]][:, None], x[slots.inner], x[slots.q[1:]][:, None]], axis=1)


def _costate_points(one: Leg, outcome: Outcome) -> np.ndarray:
    """μ at the control points: multipliers of momentum matching at nodes, of the inner rows between them."""
    rows, count, n = one.rows, one.phase.steps, one.phase.system.structure.n
    mu = outcome.lam_g[rows.momentum]
    inner = outcome.lam_g[rows.inner].reshape(count, -1, n)
    return np.concatenate([mu[:-1, None], inner, mu[1:, None]], axis=1)


def _momenta_and_terms(one: Leg, outcome: Outcome) -> tuple[np.ndarray, dict[str, Any]]:
    """Momenta at the nodes from the discrete Legendre transforms; cost of every interval; costates of q."""
    phase, slots, rows, x = one.phase, one.slots, one.rows, outcome.x
    count, term = phase.steps, one.interval
    shares = ca.vertcat(-term.p_minus, term.inner, term.gaps, term.nodes, term.points, term.p_plus)
    mu = ca.SX.sym("mu", shares.numel())
    slope = ca.gradient(term.cost + ca.dot(mu, shares), ca.vertcat(term.stage, term.q1))
    n = term.q1.numel()
    values = ca.Function(
        "terms",
        [term.stage, term.q1, term.mesh, one.shared.column, mu],
        [term.p_minus, term.p_plus, ca.densify(term.cost), ca.densify(slope[:n]), ca.densify(slope[-n:])],
        {"cse": True},
    )
    stages = x[slots.q[:-1, :1] + np.arange(term.stage.numel())]
    mesh = np.column_stack([phase.mesh[:-1], np.diff(phase.mesh)])
    shared = np.where(slots.shared >= 0, x[slots.shared], one.data[2 * count :])
    index = np.hstack([rows.momentum[:-1], rows.inner, rows.gaps, rows.nodes, rows.points, rows.momentum[1:]])
    lam = np.append(outcome.lam_g, 0.0)[index]
    p_minus, p_plus, cost, at_start, at_end = over_columns(values, stages, x[slots.q[1:]], mesh, shared, lam)
    s = phase.system
    at = ca.Function("terminal", [s.q, s.v, s.t, s.c], [phase.terminal, s.momentum])
    terminal, p_end = at(x[slots.q[-1]], x[slots.v[1]], shared[0] + shared[1], shared[2:])
    p = np.vstack([p_minus, p_plus[-1:]])
    if s.structure.constraints:
        p = _projected(one, p, x[slots.q], shared)
        p[-1] = np.array(p_end).ravel()
    return p, {
        "cost": cost[:, 0],
        "terminal": float(terminal),
        "costate_q": np.vstack([at_start, -at_end[-1:]]),
    }


def _projected(one: Leg, p: np.ndarray, q: np.ndarray, shared: np.ndarray) -> np.ndarray:
    """Momenta with G ∂H/∂p + ∂g/∂t = 0 by adding Gᵀν: the hidden constraint (theory of RATTLE)."""
    s = one.phase.system
    n, m = s.structure.n, s.structure.constraints
    raw = ca.SX.sym("p", n)
    G = ca.jacobian(s.constraint, s.q)
    offset = ca.substitute(s.momentum, s.v, ca.SX.zeros(n))
    kkt = ca.vertcat(ca.horzcat(s.mass_matrix, -G.T), ca.horzcat(G, ca.SX(m, m)))
    found = ca.solve(ca.densify(kkt), ca.vertcat(raw - offset, -ca.jacobian(s.constraint, s.t)))
    f = ca.Function("project", [s.q, raw, s.t, s.c], [raw + ca.mtimes(G.T, found[n:])])
    t = shared[0] + shared[1] * one.phase.mesh
    return over_columns(f, q, p, t[:, None], shared[2:])[0]


def _active(one: Leg, outcome: Outcome, problem: Problem, t0: float, duration: float) -> dict[str, np.ndarray]:
    """Times at which each bound along the path is met with equality."""
    phase, slots, rule = one.phase, one.slots, one.phase.rule
    s, mesh, steps = phase.system, phase.mesh, np.diff(phase.mesh)
    points = mesh[:-1, None] + steps[:, None] * np.array(rule.points)
    nodes = mesh[:-1, None] + steps[:, None] * np.array(rule.nodes)
    q = control_points(outcome.x, one)
    found: dict[str, np.ndarray] = {}
    u = outcome.x[slots.u]
    at_u = nodes if phase.samples > 1 else mesh[:-1, None] + steps[:, None] / 2
    g = np.array(problem.program.value(outcome.x, problem.p)[1]).ravel()
    held_nodes = g[one.rows.nodes].reshape(phase.steps, len(rule.nodes), -1)
    at_points = phase.bounds.at_points.numel()
    rows = one.rows.points.reshape(phase.steps, rule.degree, -1) if at_points else np.zeros((phase.steps, 0, 0), int)
    held_points = np.where(rows < 0, np.nan, g[rows]) if at_points else np.zeros((phase.steps, 0, 0))
    kinds = [
        (s.names, q, points, phase.bounds.q),
        (s.control_names, u, at_u, phase.bounds.u),
        (_texts(phase.bounds.at_nodes), held_nodes, nodes, (phase.bounds.nodes_low, phase.bounds.nodes_high)),
        (
            _texts(phase.bounds.at_points),
            held_points,
            points[:, 1:],
            (phase.bounds.points_low, phase.bounds.points_high),
        ),
    ]
    for names, values, at, (low, high) in kinds:
        for i, name in enumerate(names):
            for sign, bound in ((">=", low[i]), ("<=", high[i])):
                if np.isfinite(bound):
                    close = np.abs(values[..., i] - bound) <= ACTIVE * max(1.0, abs(bound))
                    if close.any():
                        found[f"{name} {sign} {bound:g}"] = np.unique(t0 + duration * at[close])
    return found


def _texts(expressions: ca.SX) -> list[str]:
    return [str(x) for x in ca.vertsplit(expressions)] if expressions.numel() else []

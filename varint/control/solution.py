"""From the solver's numbers back to mechanics: trajectories, costates, active bounds."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
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
from varint.manifold import tangent_function
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
class Origin:
    """A phase, the program it is part of, and what the solver returned."""

    leg: Leg
    problem: Problem
    outcome: Outcome

    @property
    def phase(self) -> Checked:
        """The phase as the user gave it, checked."""
        return self.leg.phase


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
    status, success, violation, iterations, history, timings
        How the solver ended and got there; the largest violation of any condition; cost, violation and optimality
        after each iteration; seconds to build and to solve.
    origin : Origin or None
        The problem and the solver's own numbers, from which a further solve starts warm; None after loading a file.
    kept : mapping
        What a file held of `active`.
    """

    cost: float
    total_cost: float
    q: Piecewise
    u: Piecewise
    costate: Piecewise
    mesh: np.ndarray
    v_ends: np.ndarray
    costates: Costates
    status: str
    success: bool
    violation: float
    iterations: int
    history: Mapping[str, list[float]]
    timings: Mapping[str, float]
    origin: Origin | None = None
    kept: Mapping[str, np.ndarray] = field(default_factory=dict)

    def __repr__(self) -> str:
        return f"ControlSolution(cost {self.cost:.9g}, {self.status}, {self.iterations} iterations)"

    @cached_property
    def active(self) -> dict[str, np.ndarray]:
        """Bounds along the path that are met with equality, and the times where they are."""
        return dict(self.kept) if self.origin is None else _active(self.origin)


def trajectories(problem: Problem, outcome: Outcome, data: np.ndarray | None = None) -> list[Trajectory]:
    """One trajectory a phase; `data`: the program's constants where they are not the problem's own."""
    constants = problem.p if data is None else data
    return [_trajectory(problem, outcome, one, constants[one.first_datum :]) for one in problem.legs]


def _trajectory(problem: Problem, outcome: Outcome, one: Leg, constants: np.ndarray) -> Trajectory:
    phase, slots, x = one.phase, one.slots, outcome.x
    count, rule, system = phase.steps, phase.rule, phase.system
    shared = np.where(slots.shared >= 0, x[slots.shared], constants[2 * count : len(one.data)])
    t0, duration, c = float(shared[0]), float(shared[1]), shared[2:]
    uniform = np.array_equal(phase.mesh, np.arange(count + 1) / count)
    k = np.arange(count + 1)
    t = t0 + duration / count * k if uniform else t0 + duration * phase.mesh
    points, u = control_points(x, one), x[slots.u]
    p, terms = _momenta_and_terms(one, outcome, shared)
    solution = ControlSolution(
        cost=float(terms["cost"].sum() + terms["terminal"]),
        total_cost=outcome.cost,
        q=Piecewise(phase.mesh, np.array(rule.points), points),
        u=Piecewise(phase.mesh, np.array(rule.nodes) if phase.samples > 1 else np.array([0.5]), u),
        costate=Piecewise(phase.mesh, np.array(rule.points), _costate_points(one, outcome)),
        mesh=phase.mesh,
        v_ends=x[slots.v],
        costates=Costates(terms["costate_q"], outcome.lam_g[one.rows.momentum]),
        status=outcome.status,
        success=outcome.success,
        violation=outcome.violation,
        iterations=outcome.iterations,
        history=MappingProxyType(outcome.history),
        timings=MappingProxyType({"build": problem.seconds, "solve": outcome.seconds}),
        origin=Origin(one, problem, outcome),
    )
    return Trajectory(
        system=system,
        rule=rule,
        t=t, q=x[slots.q], p=p, h=duration / count,
        sizes=None if uniform else duration * np.diff(phase.mesh),
        k=k, u=u, c=c,
        functions=lambda scene=system: (step_function(scene, rule), action_function(scene, rule)),
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


def _momenta_and_terms(one: Leg, outcome: Outcome, shared: np.ndarray) -> tuple[np.ndarray, dict[str, Any]]:
    """Momenta at the nodes from the discrete Legendre transforms; cost of every interval; costates of q."""
    phase, slots, rows, x = one.phase, one.slots, one.rows, outcome.x
    term = one.interval
    stages = x[slots.q[:-1, :1] + np.arange(term.stage.numel())]
    mesh = np.column_stack([phase.mesh[:-1], np.diff(phase.mesh)])
    index = np.hstack([rows.momentum[:-1], rows.inner, rows.gaps, rows.nodes, rows.points, rows.momentum[1:]])
    lam = np.append(outcome.lam_g, 0.0)[index]
    p_minus, p_plus, cost, at_start, at_end = over_columns(
        one.values_function, stages, x[slots.q[1:]], mesh, shared, lam
    )
    at_end_of = one.terminal_function(x[slots.q[-1]], x[slots.v[1]], shared[0] + shared[1], shared[2:])
    terminal, p_end = (np.array(y).ravel() for y in at_end_of)
    p = np.vstack([p_minus, p_plus[-1:]])
    if phase.system.structure.constraints:
        t = shared[0] + shared[1] * phase.mesh
        p = p + over_columns(tangent_function(phase.system), x[slots.q], p, t[:, None], shared[2:])[1]
        p[-1] = p_end
    return p, {
        "cost": cost[:, 0],
        "terminal": float(terminal[0]),
        "costate_q": np.vstack([at_start, -at_end[-1:]]),
    }


def _active(origin: Origin) -> dict[str, np.ndarray]:
    """Times at which each bound along the path is met with equality."""
    one, outcome, problem = origin.leg, origin.outcome, origin.problem
    phase, slots, rule = one.phase, one.slots, one.phase.rule
    s, mesh, steps = phase.system, phase.mesh, np.diff(phase.mesh)
    shared = np.where(slots.shared >= 0, outcome.x[slots.shared], one.data[2 * phase.steps :])
    t0, duration = float(shared[0]), float(shared[1])
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
    kinds: list[tuple] = [
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


PIECES = ("q", "u", "costate")
PLAIN = ("cost", "total_cost", "status", "success", "violation", "iterations")


def stored(solution: ControlSolution) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """What a file keeps of a solution: numbers and words, and arrays."""
    header = {name: getattr(solution, name) for name in PLAIN}
    header |= {"history": dict(solution.history), "timings": dict(solution.timings), "active": list(solution.active)}
    arrays = {
        "mesh": solution.mesh,
        "v_ends": solution.v_ends,
        "mu_q": solution.costates.q,
        "mu_p": solution.costates.p,
    }
    for name in PIECES:
        piece = getattr(solution, name)
        arrays |= {f"{name}_points": piece.points, f"{name}_values": piece.values}
    return header, arrays | {f"active_{i}": times for i, times in enumerate(solution.active.values())}


def restored(header: Mapping[str, Any], arrays: Mapping[str, np.ndarray]) -> ControlSolution:
    """A solution from what `stored` kept; a further solve can start from its path and controls."""
    mesh = arrays["mesh"]
    pieces: dict[str, Any] = {
        name: Piecewise(mesh, arrays[f"{name}_points"], arrays[f"{name}_values"]) for name in PIECES
    }
    return ControlSolution(
        **{name: header[name] for name in PLAIN},
        **pieces,
        mesh=mesh,
        v_ends=arrays["v_ends"],
        costates=Costates(arrays["mu_q"], arrays["mu_p"]),
        history=MappingProxyType(header["history"]),
        timings=MappingProxyType(header["timings"]),
        kept={name: arrays[f"active_{i}"] for i, name in enumerate(header["active"])},
    )

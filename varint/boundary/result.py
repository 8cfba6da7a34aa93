"""From the iterate of a boundary value problem to a Trajectory."""

from __future__ import annotations

from time import perf_counter
from types import MappingProxyType
from typing import Any

import casadi as ca
import numpy as np

from varint.arrays import over_columns
from varint.boundary.newton import Outcome, equilibrated_solver
from varint.boundary.stationary import Iterate, Problem, interval_rows
from varint.manifold import tangent_function
from varint.stepping.step_function import action_function, step_function
from varint.system import System, per_system
from varint.trajectory import Trajectory

CONJUGATE = 1e6  # times the free particle's answer of p to q_end: the end is conjugate to the start to six digits


def path_of(problem: Problem, outcome: Outcome, began: float) -> Trajectory:
    """The trajectory of an outcome of Newton's method."""
    stats = {
        "plan": f"{problem.rule}: Newton's method for the whole path, {problem.equations.rows.numel_in(0)} unknowns",
        "steps": problem.steps,
        "status": outcome.status,
        "iterations": outcome.iterations,
        "residual": outcome.residual,
        "seconds": perf_counter() - began,
    }
    return trajectory(problem, outcome.iterate, stats)


def trajectory(problem: Problem, iterate: Iterate, stats: dict[str, Any], solution: Any = None) -> Trajectory:
    """Nodes and momenta of an iterate: p_k = p⁻ of the step that begins there, at the end p⁺ of the last one."""
    system, rule = problem.system, problem.rule
    k = np.arange(problem.steps + 1)
    t = problem.t0 + iterate.duration / problem.steps * k
    p_minus, p_plus, _ = over_columns(ends_function(system, rule), *interval_data(problem, iterate))
    q = np.concatenate([iterate.starts, iterate.end[None]])
    p = np.concatenate([p_minus, p_plus[-1:]])
    if system.structure.constraints:
        p = p + over_columns(tangent_function(system), q, p, t[:, None], problem.c)[1]
    return Trajectory(
        system=system,
        rule=rule,
        t=t,
        q=q,
        p=p,
        h=iterate.duration / problem.steps,
        k=k,
        u=problem.u.reshape(problem.steps, len(rule.nodes), -1),
        c=problem.c,
        functions=lambda: (step_function(system, rule), action_function(system, rule)),
        closure=problem.closure,
        stats=MappingProxyType(stats),
        solution=solution,
    )


def interval_data(problem: Problem, iterate: Iterate) -> list[np.ndarray]:
    """Arguments of `interval_rows`, one row an interval."""
    steps, d, _ = iterate.increments.shape
    h = iterate.duration / steps
    window = np.arange(steps)[:, None] * d + np.arange(d + 1)
    return [
        iterate.starts, iterate.increments.reshape(steps, -1), iterate.multipliers[window].reshape(steps, -1),
        problem.u, problem.c, (problem.t0 + h * np.arange(steps))[:, None], np.array([h]),
    ]  # fmt: skip


@per_system
def ends_function(system: System, rule) -> ca.Function:
    """Arguments of `interval_rows` → (p⁻, p⁺, action)."""
    n = system.structure.n
    kernel = interval_rows(system, rule)
    inputs = [ca.SX.sym("a", kernel.numel_in(i)) for i in range(kernel.n_in())]
    rows, action = kernel(*inputs)
    last = rows.numel() - n - system.structure.constraints
    return ca.Function("ends", inputs, [-rows[:n], rows[last : last + n], action], {"cse": True})


def conjugate_ends(problem: Problem, outcome: Outcome, path: Trajectory) -> bool:
    """Whether the fixed ends are conjugate to each other: no path joins them, or a whole family does."""
    if problem.closure is not None or problem.energy is not None or problem.system.structure.constraints:
        return False
    n = problem.system.structure.n
    _, slope = problem.equations.derivatives(problem, outcome.iterate)
    size = slope.shape[0]
    moved = np.eye(size, n, n - size)  # the end moved along each coordinate
    answer = equilibrated_solver(slope)(moved)[-2 * n : -n]
    mass = np.array(mass_function(problem.system)(path.q[0], path.v[0], problem.t0, problem.c))
    return not np.abs(answer).max() <= CONJUGATE * np.abs(mass).max() / path.duration


@per_system
def mass_function(system: System) -> ca.Function:
    """(q, v, t, c) → M."""
    return ca.Function("mass", [system.q, system.v, system.t, system.c], [ca.densify(system.mass_matrix)])

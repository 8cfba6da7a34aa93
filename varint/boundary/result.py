"""From the iterate of a boundary value problem to a Trajectory."""

from __future__ import annotations

from collections.abc import Callable
from time import perf_counter
from types import MappingProxyType
from typing import Any

import casadi as ca
import numpy as np

from varint.boundary.iterate import Iterate
from varint.boundary.newton import RESIDUAL_LIMIT, NewtonResult, equilibrated_solver
from varint.boundary.stationary import BoundaryValueProblem, momenta_and_action
from varint.discrete.constraints import tangent_function
from varint.discrete.lagrangian import constraint_function
from varint.integration.many_steps import steps_again
from varint.numerics.arrays import over_columns
from varint.results.records import with_own_action
from varint.results.trajectory import Trajectory
from varint.scene.memory import per_system
from varint.scene.system import System

STALLED = 1e3  # the same where Newton's method stalls although nothing is left unbalanced
RANK = 1e-9  # of the largest singular value
# times the free particle's answer of p to q_end: the end is conjugate to the start to six digits
CONJUGATE = 1e6


def path_of(
    problem: BoundaryValueProblem, outcome: NewtonResult, error: float, began: float
) -> Trajectory:
    """The trajectory of an outcome of Newton's method."""
    stats = {
        "plan": (
            f"{problem.rule}: Newton's method for the whole path, "
            f"{problem.equations.rows.numel_in(0)} unknowns"
        ),
        "steps": problem.steps,
        "status": outcome.status,
        "iterations": outcome.iterations,
        "residual": outcome.residual,
        "error_estimate": error,
        "seconds": perf_counter() - began,
    }
    return trajectory_of(problem, outcome.iterate, stats)


def trajectory_of(
    problem: BoundaryValueProblem,
    iterate: Iterate,
    stats: dict[str, Any],
    solution: Any = None,
    dense_output: Callable[[Trajectory, np.ndarray], Trajectory] | None = None,
) -> Trajectory:
    """Nodes, momenta and action of an iterate."""
    system, rule, mean = problem.system, problem.rule, iterate.duration / problem.steps
    q, p, action = along_path(problem, iterate)
    path = Trajectory(
        system=system,
        rule=rule,
        t=problem.t0 + mean * problem.grid,
        q=q,
        p=p,
        h=mean,
        origin=problem.t0,
        k=np.arange(problem.steps + 1),
        u=problem.u.reshape(problem.steps, len(rule.nodes), -1),
        c=problem.c,
        functions=steps_again(rule),
        closure=problem.closure,
        stats=MappingProxyType(stats),
        solution=solution,
        dense_output=dense_output,
        sizes=None if problem.equal_steps else mean * problem.sizes,
    )
    # the sum over the path itself: stepping from node to node again would know nothing of bounds,
    # and where momentum hardly depends on velocity it would lose digits that the path has
    return with_own_action(path, action)


def along_path(
    problem: BoundaryValueProblem, iterate: Iterate
) -> tuple[np.ndarray, np.ndarray, float]:
    """q and p at the nodes, and the action."""
    p, action = momenta_and_action(problem, iterate)
    q = np.concatenate([iterate.starts, iterate.end[None]])
    if problem.system.structure.constraints:
        t = problem.t0 + iterate.duration / problem.steps * problem.grid
        p = p + over_columns(tangent_function(problem.system), q, p, t[:, None], problem.c)[1]
    return q, p, action


def conjugate_ends(problem: BoundaryValueProblem, outcome: NewtonResult, path: Trajectory) -> bool:
    """Whether the fixed ends are conjugate to each other: no path joins them, or a whole family
    does.

    The momentum at the start then answers to a shift of the end without bound; with constraints
    both within the tangent spaces.
    """
    stationary = outcome.solved or outcome.residual <= RESIDUAL_LIMIT
    if problem.ends is None or problem.energy is not None:
        return False
    if not (stationary or problem.system.structure.linear):
        return False
    n = problem.system.structure.n
    _, slope = problem.equations.derivatives(problem, outcome.iterate)
    moved = np.zeros((slope.shape[0], n))
    moved[-n:] = np.eye(n)  # the end moved along each coordinate
    along_start, along_end = (tangent_basis(path, k) for k in (0, -1))
    answer = equilibrated_solver(slope)(moved @ along_end)[-2 * n : -n]
    mass = np.array(mass_function(problem.system)(path.q[0], path.v[0], problem.t0, problem.c))
    most = (CONJUGATE if outcome.solved else STALLED) * np.abs(mass).max() / path.duration
    return not np.abs(along_start.T @ answer).max() <= most


def tangent_basis(path: Trajectory, node: int) -> np.ndarray:
    """Directions that the constraints allow at a node, (n, n − rank), of length one."""
    n = path.q.shape[1]
    if not path.system.structure.constraints:
        return np.eye(n)
    _, slope = constraint_function(path.system)(path.q[node], path.t[node], path.c)
    _, sizes, directions = np.linalg.svd(np.array(ca.densify(slope)))
    rank = int((sizes > RANK * sizes.max()).sum())
    return directions[rank:].T


@per_system
def mass_function(system: System) -> ca.Function:
    """(q, v, t, c) → M."""
    return ca.Function(
        "mass", [system.q, system.v, system.t, system.c], [ca.densify(system.mass_matrix)]
    )

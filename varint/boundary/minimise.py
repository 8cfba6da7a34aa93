"""Paths of least action under inequalities, by Ipopt with exact derivatives.

The action is minimised over all control points. A path that meets an obstacle leans on it: there
the momentum changes by more than the equations of motion allow, and the multiplier of the bound
says by how much.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from decimal import Decimal
from time import perf_counter
from typing import Any

import casadi as ca
import numpy as np

from varint.boundary.divided_steps import split_steps
from varint.boundary.iterate import Iterate, iterate_through
from varint.boundary.least_action_program import (
    Layout,
    least_action_program,
    program_layout,
)
from varint.boundary.least_action_scales import path_scales
from varint.boundary.newton import coordinate_ranges
from varint.boundary.result import trajectory_of
from varint.boundary.stationary import BoundaryValueProblem, momenta_and_action
from varint.errors import InputError, SolverError
from varint.nlp.arrangement import plain_order
from varint.nlp.bounds import PathBounds, path_bounds
from varint.nlp.kkt import activity
from varint.nlp.options import WORDS
from varint.nlp.solver import SolverResult, build_solver
from varint.numerics.arrays import over_columns
from varint.results.leaning import at_times
from varint.results.trajectory import Trajectory
from varint.rules.polynomials import interpolatory_weights

VIOLATION = 1e-8  # of a bound or row in units of the path: Ipopt was asked for less
# of the largest multiplier: smaller ones are what the interior point method leaves everywhere
TOUCH = 1e-6


@dataclass(frozen=True, eq=False)
class ActiveBounds:
    """Where a path of least action leans on its bounds.

    Attributes
    ----------
    bounds : tuple of str
        The bounded expressions.
    t : ndarray (K,)
        Times of all control points.
    points : ndarray (K, n)
        The control points themselves, those of every step through which its polynomial leads.
    values, multipliers : ndarray (K, b)
        Value of each expression, and how fast the least action grows with its bound, per unit of
        time and bound: positive where the path leans on the lower bound, negative on the upper one.
    status : str
        Ipopt's word for how it ended.
    """

    bounds: tuple[str, ...]
    t: np.ndarray
    points: np.ndarray
    values: np.ndarray
    multipliers: np.ndarray
    status: str

    @property
    def touches(self) -> np.ndarray:
        """Which control points lean on a bound, (K, b)."""
        size = np.abs(self.multipliers)
        return size > TOUCH * max(size.max(initial=0.0), np.finfo(float).tiny)


def minimise_action(
    problem: BoundaryValueProblem,
    iterate: Iterate,
    window: tuple[float, float],
    bounds: Sequence[tuple[Any, Any, Any]],
    began: float,
) -> Trajectory:
    """The path of least action near `iterate` within bounds."""
    bounded = bounds_of_path(problem, bounds)
    layout = program_layout(problem, iterate.increments.shape[1], bounded.at_points.numel())
    minimum, outcome = least_action_near(problem, layout, iterate, window, bounded)
    found = has_succeeded(outcome)
    error = _error_of(problem, minimum, window, bounded) if found else np.inf
    stats = {
        "plan": f"{problem.rule}: least action by Ipopt, {len(outcome.x)} unknowns",
        "steps": problem.steps,
        "status": outcome.status,
        "iterations": len(outcome.history.get("cost", ())) - 1,
        "residual": outcome.violation,
        "error_estimate": error,
        "seconds": perf_counter() - began,
    }
    active = _active_bounds(problem, layout, minimum, bounded, outcome)
    path = trajectory_of(problem, minimum, stats, active, at_times)
    if not found:
        words = WORDS.get(outcome.status, "the least action was not found; try another guess")
        raise SolverError(
            f"Ipopt ended with {outcome.status}: {words}", status=outcome.status, iterate=path
        )
    return path


def _error_of(
    problem: BoundaryValueProblem,
    minimum: Iterate,
    window: tuple[float, float],
    bounded: PathBounds,
) -> float:
    """Largest change of a coordinate at the control points relative to its range, or of a free
    duration, when every step is halved; infinite where no least action is found then.
    """
    halved, start = split_steps(problem, minimum, np.full(problem.steps, 2))
    layout = program_layout(halved, start.increments.shape[1], bounded.at_points.numel())
    finer, outcome = least_action_near(halved, layout, start, window, bounded)
    if not has_succeeded(outcome):
        return np.inf
    moved = np.abs(finer.points - start.points) / coordinate_ranges(minimum.points)
    return max(float(moved.max()), abs(finer.duration / minimum.duration - 1))


def bounds_of_path(
    problem: BoundaryValueProblem, bounds: Sequence[tuple[Any, Any, Any]]
) -> PathBounds:
    """The bounds, sorted, of a path whose action can be least."""
    if problem.system.structure.forced:
        raise InputError("with forces no action is least: bounds need a scene without forces")
    if not problem.rule.points:
        raise InputError(
            f"{problem.rule} has no paths between its nodes to bound; use gauss(s) or lobatto(s)"
        )
    bounded = path_bounds(problem.system, bounds)
    if bounded.at_nodes.numel():
        raise InputError(
            "bounds of paths may depend on q, t and the parameters, not on velocities or controls"
        )
    if problem.ends is not None:
        _check_ends_within(problem, bounded, problem.ends)
    return bounded


def least_action_near(
    problem: BoundaryValueProblem,
    layout: Layout,
    iterate: Iterate,
    window: tuple[float, float],
    bounded: PathBounds,
    options: Mapping[str, Any] | None = None,
) -> tuple[Iterate, SolverResult]:
    """Ipopt's path of least action, and how it came to it; in units of the path `iterate`."""
    program = least_action_program(problem, layout, iterate, window, bounded)
    unknowns = [iterate.points.ravel(), np.full(len(layout.duration), iterate.duration)]
    start = np.clip(np.concatenate(unknowns), program.x_low, program.x_high)
    scales = path_scales(problem, layout, iterate, program, start)
    solve = build_solver(program, "ipopt", options, scales, plain_order(program))
    outcome = solve(start)
    return _iterate_of(problem, layout, iterate, outcome), outcome


def has_succeeded(outcome: SolverResult) -> bool:
    """Did Ipopt end with a minimum within the bounds?"""
    return outcome.success and outcome.violation <= VIOLATION


def _check_ends_within(
    problem: BoundaryValueProblem, bounded: PathBounds, ends: np.ndarray
) -> None:
    """The given ends lie within the bounds; those that depend on time are left to Ipopt."""
    s = problem.system
    slopes = ca.densify(ca.jacobian(bounded.at_points, s.q))
    values = ca.Function("values", [s.q, s.t, s.c], [bounded.at_points, slopes])
    for name, q in zip(("q_start", "q_end"), ends, strict=True):
        outside = [str(s.q[i]) for i in np.flatnonzero((q < bounded.q[0]) | (q > bounded.q[1]))]
        if not ca.depends_on(bounded.at_points, s.t) and bounded.at_points.numel():
            x, slope = (np.array(part) for part in values(q, problem.t0, problem.c))
            x = x.ravel()
            allowed = VIOLATION * np.maximum(np.abs(x), np.abs(slope) @ np.abs(q))
            low, high = bounded.points_low - allowed, bounded.points_high + allowed
            off = np.flatnonzero((x < low) | (x > high))
            outside += [str(bounded.at_points[int(i)]) for i in off]
        if outside:
            raise InputError(
                f"{name} = {q} violates the bounds on {outside}; move the end or loosen the bounds"
            )


def _iterate_of(
    problem: BoundaryValueProblem, layout: Layout, first: Iterate, outcome: SolverResult
) -> Iterate:
    """The solver's point as an iterate with multipliers."""
    duration = float(outcome.x[layout.duration].sum()) if len(layout.duration) else first.duration
    degree, constraints = first.increments.shape[1], problem.system.structure.constraints
    minimum = iterate_through(outcome.x[layout.points], degree, constraints, duration)
    minimum.multipliers[:] = outcome.lam_g[layout.constraints]
    return minimum


def _active_bounds(
    problem: BoundaryValueProblem,
    layout: Layout,
    minimum: Iterate,
    bounded: PathBounds,
    outcome: SolverResult,
) -> ActiveBounds:
    """Multipliers of the bounds per unit of time; zero where the path does not lean on them, of
    which an interior point method leaves a little everywhere.
    """
    s = problem.system
    simple = np.flatnonzero(np.isfinite(bounded.q).any(axis=0))
    lam = np.zeros((len(layout.points), len(simple) + bounded.at_points.numel()))
    lam[layout.inner, : len(simple)] = outcome.lam_x[layout.points][layout.inner][:, simple]
    lam[layout.inner, len(simple) :] = outcome.lam_g[layout.bounded]
    expressions = ca.vertcat(*(s.q[int(i)] for i in simple), bounded.at_points)
    t = problem.t0 + minimum.duration * problem.point_shares
    slopes = ca.densify(ca.jacobian(expressions, s.q))
    given = minimum.points, t[:, None], problem.c
    values, slopes = over_columns(
        ca.Function("values", [s.q, s.t, s.c], [ca.densify(expressions), slopes]), *given
    )
    limits = zip(bounded.q, (bounded.points_low, bounded.points_high), strict=True)
    low, high = (np.append(q[simple], points) for q, points in limits)
    # units of the bounds and of the action: that a bound is held shows by many orders
    reach = np.abs(minimum.points).max(axis=0)
    size = np.maximum(
        np.abs(values).max(axis=0),
        np.abs(slopes).max(axis=0).reshape(len(reach), -1).max(axis=0) * reach.max(),
    )
    action = (
        abs(outcome.cost)
        + (np.abs(momenta_and_action(problem, minimum)[0]).max(axis=0) * reach).max()
    )
    tiny = np.finfo(float).tiny
    price = np.maximum(action, tiny) / np.maximum(size, tiny)
    lam[~activity(values, low, high, lam, np.maximum(size, tiny), price).active] = 0.0
    return ActiveBounds(
        tuple(str(x) for x in ca.vertsplit(expressions)),
        t,
        minimum.points,
        values,
        -lam / _point_weights(problem, minimum.duration)[:, None],
        outcome.status,
    )


def _point_weights(problem: BoundaryValueProblem, duration: float) -> np.ndarray:
    """Time that each control point stands for, (N d + 1,): its weight in the quadrature through
    the control points.
    """
    share = interpolatory_weights([Decimal(x) for x in problem.rule.points])
    degree, sizes = len(share) - 1, duration / problem.steps * problem.sizes
    weights = np.zeros(problem.steps * degree + 1)
    for j, weight in enumerate(share):
        weights[j : j + (problem.steps - 1) * degree + 1 : degree] += sizes * weight
    return weights

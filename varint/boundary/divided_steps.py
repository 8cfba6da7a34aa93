"""Paths with their steps divided."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from varint.boundary.iterate import Iterate, point_times
from varint.boundary.stationary import BoundaryValueProblem
from varint.rules.polynomials import lagrange_values


class Parts(NamedTuple):
    """Parts of steps: of which step, where they begin and how long they are in units of it."""

    step: np.ndarray
    begin: np.ndarray
    size: np.ndarray


def _equal_parts(parts: np.ndarray) -> Parts:
    step = np.repeat(np.arange(len(parts)), parts)
    within = np.arange(len(step)) - np.repeat(np.cumsum(parts) - parts, parts)
    return Parts(step, within / parts[step], 1 / parts[step])


def with_steps(problem: BoundaryValueProblem, parts: np.ndarray) -> BoundaryValueProblem:
    """The problem with every step k in `parts[k]` equal ones, and the same controls."""
    new = _equal_parts(parts)
    if problem.equal_steps and (parts == parts[0]).all():
        grid = np.arange(len(new.step) + 1.0)
    else:
        starts = problem.grid[new.step] + problem.sizes[new.step] * new.begin
        grid = np.append(starts, problem.grid[-1]) * (len(new.step) / problem.steps)
    return replace(problem, grid=grid, u=_controls_within(problem, new))


def split_steps(
    problem: BoundaryValueProblem, iterate: Iterate, parts: np.ndarray
) -> tuple[BoundaryValueProblem, Iterate]:
    """Every step k in `parts[k]` equal ones; path, controls and multipliers stay what they are."""
    finer = with_steps(problem, parts)
    starts, increments = _path_within(problem, iterate, _equal_parts(parts))
    multipliers = np.empty((len(finer.point_shares), iterate.multipliers.shape[1]))
    for row, values in enumerate(iterate.multipliers.T):
        multipliers[:, row] = np.interp(finer.point_shares, problem.point_shares, values)
    return finer, Iterate(starts, increments, multipliers, iterate.momenta, iterate.duration)


def _path_within(
    problem: BoundaryValueProblem, iterate: Iterate, new: Parts
) -> tuple[np.ndarray, np.ndarray]:
    """Starts and increments of parts of the steps: on the step's own polynomial, or on the
    straight line through a step of a composition.
    """
    tau = point_times(problem.rule)
    places = new.begin[:, None] + new.size[:, None] * tau
    if problem.rule.points:
        table = lagrange_values(tau, places.ravel())[:, 1:].reshape(*places.shape, -1)
        ahead = np.einsum("ijd,idn->ijn", table, iterate.increments[new.step])
    else:
        ahead = places[..., None] * iterate.increments[new.step, -1][:, None]
    return iterate.starts[new.step] + ahead[:, 0], ahead[:, 1:] - ahead[:, :1]


def _controls_within(problem: BoundaryValueProblem, new: Parts) -> np.ndarray:
    """Controls at the rule's nodes of parts of the steps."""
    nodes, u = np.array(problem.rule.nodes), problem.u[new.step]
    if not u.size or not problem.rule.points:  # a composition's are constant on a step
        return u
    table = lagrange_values(nodes, (new.begin[:, None] + new.size[:, None] * nodes).ravel())
    square = (len(u), len(nodes), -1)
    return (table.reshape(square) @ u.reshape(square)).reshape(len(u), -1)

"""Newton's method for a whole path, damped by the natural monotonicity test.

A trial step is accepted where the simplified correction K⁻¹F(x + λδ) is shorter than the step itself: unlike the
residual this measure does not depend on the units of the rows (Deuflhard, Newton Methods for Nonlinear Problems, §3.3).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import casadi as ca
import numpy as np

from varint.boundary.stationary import Iterate, Problem

LAST_CORRECTION = 1e-8  # relative to the path; quadratic convergence makes the next one round-off
MOST_ITERATIONS = 60
SMALLEST_DAMPING = 1e-4
RESIDUAL_LIMIT = 1e-9  # relative to the momenta
DAMPED = 1e-9  # relative to the equations: directions weaker than this are left alone (closed paths)


@dataclass(frozen=True, eq=False)
class Outcome:
    """Where Newton's method ended.

    Attributes
    ----------
    iterate : Iterate
    status : str
        ``"solved"``, or what stopped it.
    iterations : int
    correction, residual : float
        Last correction relative to the path's size, last residual relative to the momenta.
    """

    iterate: Iterate
    status: str
    iterations: int
    correction: float
    residual: float

    @property
    def solved(self) -> bool:
        """Whether the iterate is a solution."""
        return self.status == "solved"


def newton(problem: Problem, iterate: Iterate) -> Outcome:
    """Stationary path near `iterate`."""
    equations, size = problem.equations, Measure(problem, iterate)
    damping, polish, correction, residual = 1.0, False, np.inf, np.inf
    for iteration in range(1, MOST_ITERATIONS + 1):
        values, slope = equations.derivatives(problem, iterate)
        solve = _solver(slope, problem.closure is not None)
        if solve is None or not np.isfinite(values).all():
            status = "singular equations" if solve is None else "values that are not finite"
            return Outcome(iterate, status, iteration, correction, residual)
        change = -solve(values)
        correction = size(change)
        if not np.isfinite(correction):
            return Outcome(iterate, "singular equations", iteration, correction, residual)
        if correction <= LAST_CORRECTION:
            trial = iterate.moved(change)
            left = equations(problem, trial)
            if polish or correction == 0:
                residual = size.residual(trial, left)
                status = "solved" if residual <= RESIDUAL_LIMIT else "a residual that stagnates"
                return Outcome(trial, status, iteration, correction, residual)
            iterate, polish = trial, True
            continue
        damping = min(1.0, 4 * damping)
        while True:
            trial = iterate.moved(damping * change)
            left = equations(problem, trial) if trial.duration > 0 else np.array([np.nan])
            if np.isfinite(left).all() and size(solve(left)) <= (1 - damping / 4) * correction:
                break
            damping /= 2
            if damping < SMALLEST_DAMPING:
                return Outcome(iterate, "no further progress", iteration, correction, size.residual(iterate, values))
        iterate = trial
        residual = size.residual(iterate, left)
    return Outcome(iterate, "too many iterations", MOST_ITERATIONS, correction, residual)


class Measure:
    """Sizes of changes and residuals relative to the path: coordinates by their range, momenta by their size."""

    def __init__(self, problem: Problem, iterate: Iterate):
        points = iterate.points
        self.count, self.n = points.shape
        self.block = self.n + problem.system.structure.constraints
        ranges = np.maximum(np.ptp(points, axis=0), np.abs(points[-1] - points[0]))
        largest = max(float(ranges.max()), 1e-3 * float(np.abs(points).max()), np.finfo(float).tiny)
        self.ranges = np.maximum(ranges, 1e-3 * largest)
        self.duration = iterate.duration

    def __call__(self, change: np.ndarray) -> float:
        """Largest change of a coordinate relative to its range, or of the duration."""
        inner = change[: self.count * self.block].reshape(self.count, self.block)[:, : self.n]
        rest = change[self.count * self.block + 2 * self.n :]
        return max(float((np.abs(inner) / self.ranges).max()), float(np.abs(rest).sum()) / self.duration)

    def residual(self, iterate: Iterate, values: np.ndarray) -> float:
        """Largest unbalanced momentum relative to the momenta at the ends."""
        inner = values[: self.count * self.block].reshape(self.count, self.block)[:, : self.n]
        momenta = np.abs(iterate.momenta).max()
        return float(np.abs(inner).max()) / momenta if momenta else float(np.abs(inner).max())


def _solver(slope: ca.DM, closed: bool) -> Callable[[np.ndarray], np.ndarray] | None:
    """Solves slope · x = b; None where the matrix is singular.

    Closed paths come in families (shifted in time, turned, moved): there the least-squares solution of least norm is
    taken, by the quasi-definite system [μ K; Kᵀ −μ] of the equilibrated matrix.
    """
    values = np.array(slope.nonzeros())
    if not np.isfinite(values).all():
        return lambda right: np.full(right.shape, np.nan)
    if not closed:
        return factorised(slope)
    size = slope.shape[0]
    rows, columns = (np.array(x) for x in slope.sparsity().get_triplet())
    by_column = 1 / _largest(columns, np.abs(values), size)
    by_row = 1 / _largest(rows, np.abs(values) * by_column[columns], size)
    scaled = ca.DM(slope.sparsity(), values * by_row[rows] * by_column[columns])
    unit = DAMPED * ca.DM.eye(size)
    solve = factorised(ca.blockcat([[unit, scaled], [scaled.T, -unit]]))
    if solve is None:
        return None
    return lambda right: by_column * solve(np.concatenate([by_row * right, np.zeros(size)]))[size:]


def _largest(index: np.ndarray, values: np.ndarray, size: int) -> np.ndarray:
    found = np.zeros(size)
    np.maximum.at(found, index, values)
    return np.where(found > 0, found, 1.0)


def factorised(matrix: ca.DM) -> Callable[[np.ndarray], np.ndarray] | None:
    """Sparse LU with one step of iterative refinement."""
    solver = ca.Linsol("path", "csparse", matrix.sparsity())
    try:
        solver.sfact(matrix)
        solver.nfact(matrix)
    except RuntimeError:
        return None

    def solve(right: np.ndarray) -> np.ndarray:
        x = solver.solve(matrix, ca.DM(right))
        x += solver.solve(matrix, ca.DM(right) - ca.mtimes(matrix, x))
        return np.array(x).ravel()

    return solve

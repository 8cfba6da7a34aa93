"""Newton's method for a whole path, damped by the natural monotonicity test.

A trial step is accepted where the simplified correction K⁻¹F(x + λδ) is shorter than the step
itself: unlike the residual this measure does not depend on the units of the rows (Deuflhard, Newton
Methods for Nonlinear Problems, §3.3).
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

import casadi as ca
import numpy as np

from varint.boundary.iterate import Iterate
from varint.boundary.stationary import BoundaryValueProblem, momenta_and_action
from varint.numerics.limits import PATH_ITERATIONS, SHORTEST

SOLVED = "solved"
LAST_CORRECTION = 1e-8  # relative to the path; quadratic convergence makes the next one round-off
SMALLEST_DAMPING = 1e-4
RESIDUAL_LIMIT = 1e-9  # relative to the momenta
# CasADi compares it with entries of any unit; singular matrices show as huge corrections
SINGULAR = 1e-300
# relative to the equations: directions weaker than this are left alone (closed paths)
DAMPED = 1e-9


@dataclass(frozen=True, eq=False)
class NewtonResult:
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
        return self.status == SOLVED


def newton(
    problem: BoundaryValueProblem, iterate: Iterate, most: int = PATH_ITERATIONS
) -> NewtonResult:
    """Stationary path near `iterate`, by so many iterations at most."""
    equations, linear = problem.equations, problem.system.structure.linear
    damping, polish, correction = 1.0, False, np.inf

    def ended(iterate: Iterate, status: str, iteration: int, values: np.ndarray) -> NewtonResult:
        residual = relative_residual(problem, iterate, values)
        if status == SOLVED and not residual <= RESIDUAL_LIMIT:
            status = "a residual that stagnates"
        return NewtonResult(iterate, status, iteration, correction, residual)

    for iteration in range(1, most + 1):
        values, slope = equations.derivatives(problem, iterate)
        solve = path_solver(problem, slope)
        if not np.isfinite(values).all():
            return ended(iterate, "values that are not finite", iteration, values)
        change = -solve(values)
        # a path that stays where it is has no size yet: what it becomes is the measure
        size = Measure(problem, iterate if _extends(iterate) else iterate.moved(change))
        correction = size(change)
        if not np.isfinite(correction):
            return ended(iterate, "singular equations", iteration, values)
        if correction <= LAST_CORRECTION:
            trial = iterate.moved(change)
            if polish or correction == 0:
                return ended(trial, SOLVED, iteration, equations(problem, trial))
            iterate, polish = trial, True
            continue
        damping = min(1.0, 4 * damping, 1.0 if linear else 1 / correction)
        while True:
            trial = iterate.moved(damping * change)
            left = equations(problem, trial) if trial.duration > 0 else np.array([np.nan])
            if np.isfinite(left).all() and size(solve(left)) <= (1 - damping / 4) * correction:
                break
            damping /= 2
            if damping < SMALLEST_DAMPING:
                return ended(iterate, "no further progress", iteration, values)
        iterate = trial
    return ended(iterate, "too many iterations", most, left)


def _extends(iterate: Iterate) -> bool:
    return bool(np.ptp(iterate.points, axis=0).any())


class Measure:
    """Sizes of changes relative to the path: coordinates by their range, the duration by itself."""

    def __init__(self, problem: BoundaryValueProblem, iterate: Iterate):
        points = iterate.points
        self.count, self.n = points.shape
        self.block = self.n + problem.system.structure.constraints
        self.ranges = coordinate_ranges(points)
        self.duration = iterate.duration

    def __call__(self, change: np.ndarray) -> float:
        """Largest change of a coordinate relative to its range, or of the duration."""
        inner = change[: self.count * self.block].reshape(self.count, self.block)[:, : self.n]
        rest = change[self.count * self.block + 2 * self.n :]
        return max(
            float((np.abs(inner) / self.ranges).max()), float(np.abs(rest).sum()) / self.duration
        )


def coordinate_ranges(points: np.ndarray) -> np.ndarray:
    """Range of every coordinate of a path, (n,), none less than a thousandth of the largest."""
    ranges = np.maximum(np.ptp(points, axis=0), np.abs(points[-1] - points[0]))
    largest = max(float(ranges.max()), 1e-3 * float(np.abs(points).max()), SHORTEST)
    return np.maximum(ranges, 1e-3 * largest)


def relative_residual(problem: BoundaryValueProblem, iterate: Iterate, values: np.ndarray) -> float:
    """Largest unbalanced momentum relative to the largest momentum at a node.

    At the ends alone there may be none: a path may begin and end at rest.
    """
    count, n = iterate.points.shape
    block = n + problem.system.structure.constraints
    inner = np.abs(values[: count * block].reshape(count, block)[:, :n]).max()
    largest = np.abs(momenta_and_action(problem, iterate)[0]).max()
    return float(inner / largest) if largest else float(inner)


def path_solver(problem: BoundaryValueProblem, slope: ca.DM) -> Callable[[np.ndarray], np.ndarray]:
    """b ↦ x with slope · x = b.

    Closed paths come in families (shifted in time, turned, moved): there the least-squares solution
    of least norm is taken, by the quasi-definite system [μ K; Kᵀ −μ] of the equilibrated matrix.
    """
    free, size = int(problem.energy is not None), slope.shape[0]
    if problem.closure is None:
        return equilibrated_solver(slope, free)
    scaled, by_row, by_column = _equilibrate(slope)
    unit = DAMPED * ca.DM.eye(size)
    main, last = np.arange(size - free), np.arange(size - free, size)
    # the duration and its row go last
    order = np.concatenate([main, size + main, last, size + last])
    damped = ca.blockcat([[unit, scaled], [scaled.T, -unit]])[order.tolist(), order.tolist()]
    solve = sparse_solver(damped, 2 * free)
    back = np.argsort(order)[size:]
    return lambda right: (
        by_column * solve(np.concatenate([by_row * right, np.zeros(size)])[order])[back]
    )


def equilibrated_solver(matrix: ca.DM, border: int = 0) -> Callable[[np.ndarray], np.ndarray]:
    """As `sparse_solver`, for rows and columns of different units: conditions of the ends hold
    to round-off too.
    """
    scaled, by_row, by_column = _equilibrate(matrix)
    solve = sparse_solver(scaled, border)
    return lambda right: (by_column * solve((by_row * right.T).T).T).T


def _equilibrate(matrix: ca.DM) -> tuple[ca.DM, np.ndarray, np.ndarray]:
    """The matrix with columns and rows of size 1, and the factors of its rows and columns."""
    by_column = _inverse_sizes(ca.sum1(matrix**2))
    scaled = ca.mtimes(matrix, ca.diag(by_column))
    by_row = _inverse_sizes(ca.sum2(scaled**2))
    return ca.mtimes(ca.diag(by_row), scaled), np.array(by_row).ravel(), np.array(by_column).ravel()


def _inverse_sizes(squares: ca.DM) -> ca.DM:
    size = np.sqrt(np.array(ca.densify(squares)).ravel())
    return ca.DM(1 / np.where(size > 0, size, 1.0))


def sparse_solver(matrix: ca.DM, border: int = 0) -> Callable[[np.ndarray], np.ndarray]:
    """b ↦ x with matrix · x = b by sparse QR; the last `border` rows and columns, which are dense,
    are split off.

    x is NaN where the matrix is singular. Columns of b are solved at once.
    """
    inner = matrix.shape[0] - border
    main = matrix[:inner, :inner] if border else matrix
    solver = _analyse(main.sparsity())

    def solve(right: np.ndarray) -> np.ndarray:
        try:
            return np.array(solver.solve(main, ca.DM(right))).reshape(right.shape)
        except RuntimeError:
            return np.full(right.shape, np.nan)

    if not border:
        return solve
    beside, below = (
        np.array(ca.densify(matrix[:inner, inner:])),
        np.array(ca.densify(matrix[inner:, :inner])),
    )
    ahead = solve(beside)
    corner = np.array(ca.densify(matrix[inner:, inner:])) - below @ ahead

    def bordered(right: np.ndarray) -> np.ndarray:
        first = solve(right[:inner])
        last = np.linalg.lstsq(corner, right[inner:] - below @ first, rcond=None)[0]
        return np.concatenate([first - ahead @ last, last])

    def refined(right: np.ndarray) -> np.ndarray:
        x = bordered(right)
        return x + bordered(right - np.array(ca.mtimes(matrix, ca.DM(x))).reshape(right.shape))

    return refined


def _analyse(pattern: ca.Sparsity) -> ca.Linsol:
    """The solver for a pattern; its symbolic analysis takes longer than a factorisation and is
    kept.
    """
    for known, solver in _SOLVERS:
        if known == pattern:
            return solver
    solver = ca.Linsol("path", "qr", pattern, {"eps": SINGULAR})
    _SOLVERS.append((pattern, solver))
    return solver


_SOLVERS: deque[tuple[ca.Sparsity, ca.Linsol]] = deque(maxlen=8)

"""The neighbourhood of a solution: its active conditions, and the quadratic program that they make.

With the active set fixed, a small change of bounds and constants moves the solution by the d that
solves

    min ½ dᵀ H d + c·d,   A d = b,    H = ∂²(f + λ·g)/∂x²,  A: the active rows of ∂g/∂x,

which has one solution exactly where H is positive definite on the null space of A: the second-order
sufficient conditions (Fiacco & McCormick, Nonlinear Programming, §2.2; Nocedal & Wright, Numerical
Optimization, §12.5, §16.1). It is where [H Aᵀ; A 0] has as many positive eigenvalues as there are
unknowns, and fewer where it is not (Gould, Math. Programming 32 (1985) 90–99).
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from varint.nlp.arrangement import Scales
from varint.nlp.program import NonlinearProgram
from varint.numerics.frontal import Factors, Symmetric, factorise

# in the solver's units: where distance to a bound and multiplier are both smaller, it is not known
# whether the bound is active
DOUBTFUL = 1e-5
SOLVED = 1e-7  # relative residual of the linear system
NOTHING = 1e-9  # in units of the problem: a change this small is round-off of none


@dataclass(frozen=True, eq=False)
class Activity:
    """Which bounds of unknowns or of rows a solution leans on.

    Attributes
    ----------
    fixed : ndarray of bool
        Lower and upper bound are equal.
    low, high : ndarray of bool
        At the lower, at the upper bound with a multiplier.
    doubtful : ndarray of bool
        At a bound without a multiplier, or almost: what follows may differ from side to side.
    """

    fixed: np.ndarray
    low: np.ndarray
    high: np.ndarray
    doubtful: np.ndarray

    @property
    def active(self) -> np.ndarray:
        """Those that hold with equality in the neighbourhood."""
        return self.fixed | self.low | self.high


def activity(
    value: np.ndarray,
    low: np.ndarray,
    high: np.ndarray,
    multiplier: np.ndarray,
    size: np.ndarray,
    price: np.ndarray,
) -> Activity:
    """Activity of bounds by strict complementarity: a bound is active where its multiplier exceeds
    the distance to it, in the units `price` and `size`.
    """
    fixed = low == high
    with np.errstate(invalid="ignore"):
        below, above = (value - low) / size, (high - value) / size
    pull = multiplier / price
    at_low, at_high = ~fixed & (-pull > below), ~fixed & (pull > above)
    nearest, strongest = np.minimum(below, above), np.abs(pull)
    doubtful = ~fixed & (np.maximum(nearest, strongest) < DOUBTFUL)
    return Activity(fixed, at_low, at_high, doubtful)


@dataclass(frozen=True, eq=False)
class KktSystem:
    """H, A and the active set of a solution.

    Attributes
    ----------
    nlp : NonlinearProgram
        The program as it was solved.
    unknowns, rows : Activity
    hessian, jacobian : DM
        H of all unknowns, and the Jacobian of all rows.
    stages : tuple of ndarray of int
        The place in the chain of every unknown and of every row.
    scales : Scales
        Units of all unknowns, of the cost and of all rows.
    metric : ndarray
        Positive weights m_i: curvatures are those of dᵀ H d / Σ m_i d_i².
    """

    nlp: NonlinearProgram
    unknowns: Activity
    rows: Activity
    hessian: ca.DM
    jacobian: ca.DM
    stages: tuple[np.ndarray, np.ndarray]
    scales: Scales
    metric: np.ndarray

    @property
    def free(self) -> np.ndarray:
        """Unknowns that may move."""
        return np.flatnonzero(~self.unknowns.active)

    @property
    def held(self) -> np.ndarray:
        """Active rows."""
        return np.flatnonzero(self.rows.active)

    def solve(self, c: np.ndarray, b: np.ndarray, moved: np.ndarray) -> np.ndarray | None:
        """Changes d of all unknowns for gradients c (n, k), right sides b (m, k) of the rows and
        given changes of the active unknowns, `moved` (n, k); None where they are not determined.
        """
        free, held = self.free, self.held
        change = np.where(self.unknowns.active[:, None], moved, 0.0)
        right = np.vstack(
            [-(c + times(self.hessian, change))[free], (b - times(self.jacobian, change))[held]]
        )
        factors = self.factors(0.0)
        if not self.is_convex(factors):
            return None
        found = factors.solve(right)
        off = factors.scale[:, None] * (factors.matrix @ found - right)
        size = np.abs(factors.scale[:, None] * right).max(axis=0, initial=0.0)
        if not (np.abs(off).max(axis=0, initial=0.0) <= SOLVED * size).all():
            return None
        change[free] = found[: len(free)]
        return change

    def is_convex(self, factors: Factors) -> bool:
        """Is the shifted H of the factors positive definite where A d = 0?"""
        return factors.positive == len(self.free)

    def least_curvature(self, factors: Factors, iterations: int) -> tuple[float, np.ndarray]:
        """The least dᵀ H d / Σ m_i d_i² where A d = 0, and its d with Σ m_i d_i² = 1, by inverse
        iteration with factors for a shift near the least curvature, from above its negative; (∞, 0)
        where A leaves nothing.
        """
        free, held = self.free, self.held
        weight, change = self.metric[free], np.zeros(self.nlp.unknowns)
        d = np.random.default_rng(0).normal(size=len(free)) / np.sqrt(weight * len(free))
        for _ in range(iterations):
            right = np.concatenate([weight * d, np.zeros(len(held))])
            d = factors.substitute(right[:, None])[: len(free), 0]
            size = np.sqrt(np.sum(weight * d**2))
            if not size > NOTHING * self.scales.f:
                return np.inf, change
            d = d / size
        change[free] = d
        return float(change @ times(self.hessian, change)), change

    def factors(self, shift: float) -> Factors:
        """Factors of [H + shift · M, Aᵀ; A, 0] of what is free and active."""
        free, held = self.free, self.held
        n, size = len(free), len(free) + len(held)
        at_x, at_g = np.full(self.nlp.unknowns, -1), np.full(self.nlp.rows, -1)
        at_x[free], at_g[held] = np.arange(n), n + np.arange(len(held))
        parts = []
        for matrix, place in ((self.hessian, at_x), (self.jacobian, at_g)):
            i, j = (np.array(x, dtype=int) for x in matrix.sparsity().get_triplet())
            values = np.array(matrix.nonzeros())
            kept = (place[i] >= 0) & (at_x[j] >= 0)
            parts.append((place[i][kept], at_x[j][kept], values[kept]))
        (i, j, value), (row, column, slope) = parts
        every = np.arange(n)
        matrix = Symmetric(
            np.concatenate([i, every, row, column]),
            np.concatenate([j, every, column, row]),
            np.concatenate([value, shift * self.metric[free], slope, slope]),
            size,
        )
        stage = np.concatenate([self.stages[0][free], self.stages[1][held]])
        return factorise(matrix, stage)


def times(matrix: ca.DM, columns: np.ndarray) -> np.ndarray:
    """Matrix · columns, as an array of the same number of dimensions."""
    found = np.array(ca.mtimes(matrix, ca.DM(columns)))
    return found.ravel() if columns.ndim == 1 else found.reshape(-1, columns.shape[1])

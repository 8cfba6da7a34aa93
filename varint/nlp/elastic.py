"""A program whose bounds may be violated at a price: the exact penalty of elastic programming.

min f(x) + w Σ (e⁺ + e⁻),  low ≤ g(x) + e⁺ − e⁻ ≤ high,  e⁺, e⁻ ≥ 0: where the bounds can be met and
w exceeds their multipliers, the solution is that of the program itself (Fletcher, Practical Methods
of Optimization, §12.3); where they cannot, it is the point that violates them least in that sum.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from varint.nlp.arrangement import Scales
from varint.nlp.program import NonlinearProgram, Program
from varint.nlp.solver import SolverResult


@dataclass(frozen=True, eq=False)
class ElasticProgram:
    """The program in z = (x, e⁺, e⁻), its rows followed by those of the softened unknowns.

    Attributes
    ----------
    nlp : NonlinearProgram
    rows, unknowns : ndarray of int
        Which rows and which unknowns of the program itself may violate their bounds.
    """

    nlp: NonlinearProgram
    own: NonlinearProgram
    rows: np.ndarray
    unknowns: np.ndarray

    def bounds(self, x_low: np.ndarray, x_high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Bounds of z where those of x are these; softened ones are rows."""
        low, high = self.nlp.x_low.copy(), self.nlp.x_high.copy()
        hard = np.setdiff1d(np.arange(len(x_low)), self.unknowns)
        low[hard], high[hard] = x_low[hard], x_high[hard]
        return low, high

    def start(self, x: np.ndarray) -> np.ndarray:
        """z of a point x: no violation."""
        return np.append(x, np.zeros(len(self.nlp.x_low) - len(x)))

    def excess(self, z: np.ndarray) -> np.ndarray:
        """By how much each softened row, then each softened unknown, is beyond its bounds:
        negative below the lower one.
        """
        plus, minus = z[len(self.own.x_low) :].reshape(2, -1)
        return minus - plus

    def result(self, outcome: SolverResult, p: np.ndarray) -> SolverResult:
        """The outcome in the program's own unknowns and rows, its cost without the price."""
        n, m = len(self.own.x_low), len(self.own.g_low)
        x, lam_x = outcome.x[:n], outcome.lam_x[:n].copy()
        lam_x[self.unknowns] += outcome.lam_g[m:]
        cost = float(self.own.program.value(x, p)[0])
        own = replace(self.own, p=p)
        return replace(outcome, nlp=own, x=x, lam_x=lam_x, lam_g=outcome.lam_g[:m], cost=cost)


def soften(
    nlp: NonlinearProgram, rows: np.ndarray, unknowns: np.ndarray, weight: np.ndarray
) -> ElasticProgram:
    """Soften the bounds of these rows and unknowns at these prices, one for each of them."""
    n, m, count = nlp.unknowns, nlp.rows, len(rows) + len(unknowns)
    at = [*rows.tolist(), *(m + np.arange(len(unknowns))).tolist()]
    every = list(range(count))
    slack = ca.DM(ca.Sparsity.triplet(m + len(unknowns), count, at, every), 1.0)
    slack = ca.horzcat(slack, -slack)
    chosen = ca.DM(
        ca.Sparsity.triplet(len(unknowns), n, list(range(len(unknowns))), unknowns.tolist()), 1.0
    )
    price = ca.DM(np.tile(weight, 2))
    z, p = ca.MX.sym("x", n + 2 * count), ca.MX.sym("p", len(nlp.p))
    lam_f, lam_g = ca.MX.sym("lam_f"), ca.MX.sym("lam_g", m + len(unknowns))
    x, e = z[:n], z[n:]
    f, g = nlp.program.value(x, p)
    gradient, jacobian = nlp.program.gradient(x, p)[1], nlp.program.jacobian(x, p)[1]
    hessian = nlp.program.hessian(x, p, lam_f, lam_g[:m])
    cost = f + ca.dot(price, e)
    values = ca.vertcat(g, ca.mtimes(chosen, x)) + ca.mtimes(slack, e)
    slope = ca.horzcat(ca.vertcat(jacobian, ca.MX(chosen)), ca.MX(slack))
    curvature = ca.diagcat(hessian, ca.MX(2 * count, 2 * count))
    names = ["x", "p"]
    program = Program(
        ca.Function("nlp", [z, p], [cost, values], names, ["f", "g"]),
        ca.Function(
            "nlp_grad_f", [z, p], [cost, ca.vertcat(gradient, price)], names, ["f", "grad_f_x"]
        ),
        ca.Function("nlp_jac_g", [z, p], [values, slope], names, ["g", "jac_g_x"]),
        ca.Function(
            "nlp_hess_l",
            [z, p, lam_f, lam_g],
            [curvature],
            [*names, "lam_f", "lam_g"],
            ["triu_hess_gamma_x_x"],
        ),
    )
    low, high = nlp.x_low.copy(), nlp.x_high.copy()
    low[unknowns], high[unknowns] = -np.inf, np.inf
    return ElasticProgram(
        NonlinearProgram(
            program=program,
            p=nlp.p,
            x_low=np.append(low, np.zeros(2 * count)),
            x_high=np.append(high, np.full(2 * count, np.inf)),
            g_low=np.append(nlp.g_low, nlp.x_low[unknowns]),
            g_high=np.append(nlp.g_high, nlp.x_high[unknowns]),
        ),
        nlp,
        rows,
        unknowns,
    )


def elastic_scales(elastic: ElasticProgram, scales: Scales) -> Scales:
    """Sizes of violations are those of what is violated."""
    sizes = np.append(1 / scales.g[elastic.rows], scales.x[elastic.unknowns])
    return Scales(
        np.concatenate([scales.x, sizes, sizes]),
        scales.f,
        np.append(scales.g, 1 / scales.x[elastic.unknowns]),
    )

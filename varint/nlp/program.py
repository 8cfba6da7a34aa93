"""A sparse program as functions: value and exact derivatives, scaled, and within bounds."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np


@dataclass(frozen=True, eq=False)
class Program:
    """Functions of the program min f(x, p), g(x, p) within bounds, in the form `casadi.nlpsol`
    takes.

    Attributes
    ----------
    value : Function
        (x, p) → (f, g).
    gradient : Function
        (x, p) → (f, ∂f/∂x).
    jacobian : Function
        (x, p) → (g, ∂g/∂x), sparse.
    hessian : Function
        (x, p, lam_f, lam_g) → upper triangle of ∂²(lam_f f + lam_g·g)/∂x², sparse.
    terms : tuple of tuple of Function
        Of an assembled program: value, gradient, Jacobian and Hessian of one copy of each element.
    """

    value: ca.Function
    gradient: ca.Function
    jacobian: ca.Function
    hessian: ca.Function
    terms: tuple[tuple[ca.Function, ...], ...] = ()


@dataclass(frozen=True, eq=False)
class NonlinearProgram:
    """min f(x, p), g_low ≤ g(x, p) ≤ g_high, x_low ≤ x ≤ x_high.

    Attributes
    ----------
    program : Program
        f, g and their derivatives.
    p : ndarray
        The constants.
    x_low, x_high, g_low, g_high : ndarray
        Bounds of the unknowns and of the rows.
    """

    program: Program
    p: np.ndarray
    x_low: np.ndarray
    x_high: np.ndarray
    g_low: np.ndarray
    g_high: np.ndarray

    @property
    def unknowns(self) -> int:
        """Number of unknowns."""
        return len(self.x_low)

    @property
    def rows(self) -> int:
        """Number of rows."""
        return len(self.g_low)


def full_derivatives(program: Program) -> dict[str, ca.Function]:
    """Derivatives by CasADi's names, for solvers that want ∇(lam_f f + lam_g·g) and its whole
    Hessian.

    Derivatives with respect to the constants are not provided (zeros): leave lam_p alone.
    """
    rows, unknowns = program.jacobian.size1_out(1), program.jacobian.size2_out(1)
    x, p = ca.MX.sym("x", unknowns), ca.MX.sym("p", program.value.size1_in(1))
    lam_f, lam_g = ca.MX.sym("lam_f"), ca.MX.sym("lam_g", rows)
    (f, gradient), (g, jacobian) = program.gradient(x, p), program.jacobian(x, p)
    slope = lam_f * gradient + ca.mtimes(jacobian.T, lam_g)
    curvature = ca.triu2symm(program.hessian(x, p, lam_f, lam_g))
    at, weighted = [x, p], [x, p, lam_f, lam_g]
    names = ["x", "p", "lam_f", "lam_g"]
    none = ca.MX(*p.shape)
    return {
        "nlp_grad": ca.Function(
            "nlp_grad",
            weighted,
            [f, g, slope, none],
            names,
            ["f", "g", "grad_gamma_x", "grad_gamma_p"],
        ),
        "nlp_grad_f": ca.Function("nlp_grad_f", at, [gradient], names[:2], ["grad_f_x"]),
        "nlp_jac_g": ca.Function("nlp_jac_g", at, [g, jacobian], names[:2], ["g", "jac_g_x"]),
        "nlp_hess_l": ca.Function(
            "nlp_hess_l", weighted, [slope, curvature], names, ["grad_gamma_x", "hess_gamma_x_x"]
        ),
    }


def scale_program(
    program: Program, f_scale: float, x_scale: np.ndarray, g_scale: np.ndarray
) -> Program:
    """The program in x̂ = x / x_scale with f · f_scale and g · g_scale."""
    rows, unknowns = program.jacobian.size1_out(1), program.jacobian.size2_out(1)
    x, p = ca.MX.sym("x", unknowns), ca.MX.sym("p", program.value.size1_in(1))
    lam_f, lam_g = ca.MX.sym("lam_f"), ca.MX.sym("lam_g", rows)
    sx, sg = ca.DM(x_scale), ca.DM(g_scale)
    f, g = program.value(x * sx, p)
    _, gradient = program.gradient(x * sx, p)
    _, jacobian = program.jacobian(x * sx, p)
    hessian = program.hessian(x * sx, p, lam_f * f_scale, lam_g * sg)
    return Program(
        ca.Function("nlp", [x, p], [f * f_scale, g * sg], ["x", "p"], ["f", "g"]),
        ca.Function(
            "nlp_grad_f",
            [x, p],
            [f * f_scale, gradient * sx * f_scale],
            ["x", "p"],
            ["f", "grad_f_x"],
        ),
        ca.Function(
            "nlp_jac_g",
            [x, p],
            [g * sg, _times(jacobian, g_scale, x_scale)],
            ["x", "p"],
            ["g", "jac_g_x"],
        ),
        ca.Function(
            "nlp_hess_l",
            [x, p, lam_f, lam_g],
            [_times(hessian, x_scale, x_scale)],
            ["x", "p", "lam_f", "lam_g"],
            ["triu_hess_gamma_x_x"],
        ),
    )


def _times(matrix: ca.MX, left: np.ndarray, right: np.ndarray) -> ca.MX:
    """diag(left) · matrix · diag(right), entry by entry."""
    rows, columns = (np.array(part, dtype=int) for part in matrix.sparsity().get_triplet())
    return matrix * ca.DM(matrix.sparsity(), left[rows] * right[columns])

"""Large sparse programs from small kernels: differentiate one interval, not the whole program.

A program min f(x, p) with rows g(x, p) is a sum of terms that look alike: one interval of a path,
one end, one link. An `Element` holds the expressions of one such term in its own few symbols and
the indices that say which entries of x, p and g they stand for (the connectivity of a finite
element). Value, gradient, Jacobian and Hessian of the term's Lagrangian σ·cost + Σ μ·rows are SX
kernels, mapped over the copies and added up in the global matrices by one constant sparse matrix
each. Building takes as long as differentiating one term; evaluating grows linearly with the copies.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from varint.nlp.program import Program
from varint.numerics.arrays import distinct


@dataclass(frozen=True, eq=False)
class Element:
    """N copies of one term of a program.

    Attributes
    ----------
    variables : SX (a,)
        Its unknowns, for an interval for instance q_k, inner control points, controls, q_{k+1},
        duration.
    constants : SX (b,)
        Its data: what may change from solve to solve or from copy to copy.
    cost : SX
        Its share of the cost.
    rows : SX (c,)
        Its shares of the rows of the program.
    x, p, g : ndarray of int (N, a), (N, b), (N, c)
        Where variables, constants and rows of each copy sit in the program. Shares of the same row
        add up (momentum matching: p⁺ of one interval, −p⁻ of the next); a row with index −1 is left
        out.
    """

    variables: ca.SX
    constants: ca.SX
    cost: ca.SX
    rows: ca.SX
    x: np.ndarray
    p: np.ndarray
    g: np.ndarray

    def __post_init__(self) -> None:
        for name, symbols in (("x", self.variables), ("p", self.constants), ("g", self.rows)):
            shape = getattr(self, name).shape
            if len(shape) != 2 or shape[1] != symbols.numel() or shape[0] != len(self.x):
                raise AssertionError(
                    f"element: {name} has shape {shape} for {len(self.x)} × {symbols.numel()} "
                    "entries"
                )


Kernels = Callable[[list[ca.Function], int], list[ca.Function]]


# Evaluations of a kernel from which on looking for common subexpressions pays: it takes 2.5 µs an
# operation and spares each evaluation a twentieth to a fifth of the operations, 6 ns each
MANY = 4000
ITERATIONS = 20  # of a solver, about


def assemble(
    elements: Sequence[Element],
    unknowns: int,
    constants: int,
    rows: int,
    kernels: Kernels | None = None,
    solves: float = 1,
) -> Program:
    """The program that the elements add up to.

    Parameters
    ----------
    elements : sequence of Element
    unknowns, constants, rows : int
        Sizes of x, p and g.
    kernels : callable, optional
        Turns the kernels (value, gradient, Jacobian, Hessian) of an element with so many copies
        into those to use instead, for instance compiled ones.
    solves : float
        How often the program will be solved, about.

    Returns
    -------
    Program
    """
    x, p = ca.MX.sym("x", unknowns), ca.MX.sym("p", constants)
    lam_f, lam_g = ca.MX.sym("lam_f"), ca.MX.sym("lam_g", rows)
    cost = ca.MX(0)
    gradients, values, slopes, curvatures = [], [], [], []
    terms: list[tuple[ca.Function, ...]] = []
    for i, element in enumerate(elements):
        count = len(element.x)
        made = _kernels(element, f"element{i}", count * solves * ITERATIONS >= MANY)
        value, gradient, jacobian, hessian = kernels(made, count) if kernels else made
        terms.append((value, gradient, jacobian, hessian))
        z, d = _gather(x, element.x), _gather(p, element.p)
        mu = _gather(ca.vertcat(lam_g, 0), np.where(element.g < 0, rows, element.g))
        costs, shares = value.map(count)(z, d)
        cost += ca.sum2(costs)
        values.append((shares, element.g))
        gradients.append((gradient.map(count)(z, d), element.x))
        slopes.append(
            (jacobian.map(count)(z, d), *_places(jacobian.sparsity_out(0), element.g, element.x))
        )
        curved = hessian.map(count)(z, d, ca.repmat(lam_f, 1, count), mu)
        curvatures.append((curved, *_places(hessian.sparsity_out(0), element.x, element.x, True)))
    f, g = cost, _column(values, rows)
    return Program(
        ca.Function("nlp", [x, p], [f, g], ["x", "p"], ["f", "g"]),
        ca.Function(
            "nlp_grad_f", [x, p], [f, _column(gradients, unknowns)], ["x", "p"], ["f", "grad_f_x"]
        ),
        ca.Function(
            "nlp_jac_g",
            [x, p],
            [g, _matrix(slopes, (rows, unknowns))],
            ["x", "p"],
            ["g", "jac_g_x"],
        ),
        ca.Function(
            "nlp_hess_l",
            [x, p, lam_f, lam_g],
            [_matrix(curvatures, (unknowns, unknowns))],
            ["x", "p", "lam_f", "lam_g"],
            ["triu_hess_gamma_x_x"],
        ),
        tuple(terms),
    )


def with_constants_as_unknowns(elements: Sequence[Element], unknowns: int) -> list[Element]:
    """The same elements where the constants are unknowns too, behind so many others: their program
    has derivatives with respect to both.
    """
    return [
        Element(
            ca.vertcat(x.variables, x.constants),
            ca.SX(0, 1),
            x.cost,
            x.rows,
            np.hstack([x.x, unknowns + x.p]),
            np.zeros((len(x.x), 0), dtype=int),
            x.g,
        )
        for x in elements
    ]


def assemble_equations(
    elements: Sequence[Element], unknowns: int, constants: int
) -> tuple[ca.Function, ca.Function]:
    """The rows alone, for Newton's method: no cost, no second derivatives.

    Parameters
    ----------
    elements : sequence of Element
    unknowns, constants : int
        Sizes of x and p; there are as many rows as unknowns.

    Returns
    -------
    rows : Function
        (x, p) → g.
    linearised : Function
        (x, p) → (g, ∂g/∂x), sparse.
    """
    x, p = ca.MX.sym("x", unknowns), ca.MX.sym("p", constants)
    values, both, slopes = [], [], []
    for i, element in enumerate(elements):
        inputs, rows = [element.variables, element.constants], ca.densify(element.rows)
        slope = ca.jacobian(rows, element.variables)
        value = ca.Function(f"element{i}_rows", inputs, [rows], {"cse": True})
        linear = ca.Function(f"element{i}_linear", inputs, [rows, slope], {"cse": True})
        gathered = _gather(x, element.x), _gather(p, element.p)
        values.append((value.map(len(element.x))(*gathered), element.g))
        shares, slope_shares = linear.map(len(element.x))(*gathered)
        both.append((shares, element.g))
        slopes.append((slope_shares, *_places(slope.sparsity(), element.g, element.x)))
    matrix = _matrix(slopes, (unknowns, unknowns))
    return (
        ca.Function("rows", [x, p], [_column(values, unknowns)]),
        ca.Function("linearised", [x, p], [_column(both, unknowns), matrix]),
    )


def _kernels(element: Element, name: str, tidy: bool) -> list[ca.Function]:
    """Value, gradient, Jacobian and Hessian of one copy, each with common subexpressions evaluated
    once where it is to be tidy; the Hessian as its upper triangle.
    """
    z, d, cost, rows = (
        element.variables,
        element.constants,
        ca.densify(element.cost),
        ca.densify(element.rows),
    )
    sigma, mu = ca.SX.sym("sigma"), ca.SX.sym("mu", rows.numel())
    curvature, _ = ca.hessian(sigma * cost + ca.dot(mu, rows), z)
    kernels = [
        ("value", [z, d], [cost, rows]),
        ("gradient", [z, d], [ca.densify(ca.gradient(cost, z))]),
        ("jacobian", [z, d], [ca.jacobian(rows, z)]),
        ("hessian", [z, d, sigma, mu], [ca.triu(curvature)]),
    ]
    return [ca.Function(f"{name}_{what}", ins, outs, {"cse": tidy}) for what, ins, outs in kernels]


def _gather(x: ca.MX, index: np.ndarray) -> ca.MX:
    """Entries of x for each copy, one column a copy."""
    count, size = index.shape
    if not size:
        return ca.MX(0, count)
    return ca.reshape(x[index.ravel().tolist()], size, count)


def _places(pattern: ca.Sparsity, rows: np.ndarray, columns: np.ndarray, symmetric: bool = False):
    """Global row, column and weight of every nonzero of every copy, each (N · nonzeros of one
    copy,).

    Of a symmetric matrix only the upper triangle is kept, local and global: the weight is 2 where
    two different variables of a copy are one and the same unknown.
    """
    i, j = (np.array(part, dtype=int) for part in pattern.get_triplet())
    row, column = rows[:, i], columns[:, j]
    weight = np.ones(row.shape)
    if symmetric:
        weight[(row == column) & (i != j)] = 2.0
        row, column = np.minimum(row, column), np.maximum(row, column)
    return row.ravel(), column.ravel(), weight.ravel()


def _column(parts, size: int) -> ca.MX:
    """Sum of local columns at their places in a dense column."""
    total = ca.MX.zeros(size, 1)
    for values, rows in parts:
        kept = np.flatnonzero(rows.ravel() >= 0)
        if len(kept):
            places = ca.Sparsity.triplet(
                size, rows.size, rows.ravel()[kept].tolist(), kept.tolist()
            )
            total += ca.mtimes(ca.MX(ca.DM(places, 1.0)), ca.vec(values))
    return total


def _matrix(parts, shape: tuple[int, int]) -> ca.MX:
    """Sum of local matrices at their places in a sparse matrix."""
    keys = [column * shape[0] + row for _, row, column, _ in parts]
    kept = [np.flatnonzero(row >= 0) for _, row, _, _ in parts]
    places = distinct(
        np.concatenate([np.zeros(0, dtype=int), *(k[i] for k, i in zip(keys, kept, strict=True))])
    )
    pattern = ca.Sparsity.triplet(
        *shape, (places % shape[0]).tolist(), (places // shape[0]).tolist()
    )
    total = ca.MX.zeros(len(places), 1)
    for (values, _, _, weight), key, i in zip(parts, keys, kept, strict=True):
        if len(i):
            nonzero = np.searchsorted(places, key[i]).tolist()
            scatter = ca.DM.triplet(nonzero, i.tolist(), ca.DM(weight[i]), len(places), len(key))
            total += ca.mtimes(ca.MX(scatter), ca.vec(values.nz[:]))
    return ca.MX(pattern, total) if len(places) else ca.MX(pattern)

"""A controller as one function that CasADi can write as C: state in, control out, no allocation.

Sequential quadratic programming with exact Hessians (Nocedal & Wright, Numerical Optimization,
§18.1) and CasADi's active-set solver qrqp; both are written out with all derivatives.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from varint.control.problem import ControlProblem
from varint.errors import InputError, parsed_or_refused
from varint.nlp.assembly import assemble
from varint.nlp.program import NonlinearProgram, Program
from varint.numerics.files import write_atomically

ITERATIONS = 100
TOLERANCE = 1e-10  # of rows and of the gradient of the Lagrangian
LARGEST = 1e300  # what is not a number is not below it
QUIET = {
    "print_header": False,
    "print_iteration": False,
    "print_time": False,
    "print_status": False,
    "error_on_fail": False,
}


class ControllerFunctions(NamedTuple):
    """A controller as functions.

    Attributes
    ----------
    step : Function
        (q, v, t, params, x0, lam_x0, lam_g0) → (u, x, lam_x, lam_g, residual).
    start : Function
        () → (x, lam_x, lam_g, params) of the first call.
    before : Function
        What `step` takes → the residual with which it starts.
    """

    step: ca.Function
    start: ca.Function
    before: ca.Function


def controller_function(
    problem: ControlProblem, start: np.ndarray, ahead: tuple[np.ndarray, np.ndarray], name: str
) -> ControllerFunctions:
    """One call of a controller as a function, the function that gives the first call's start, and
    the residual with which a call starts.

    `ahead`: where unknowns and rows of the next call's start stand in this call's solution.
    """
    part, nlp = problem.phases[0], problem.nlp
    phase, slots = part.phase, part.slots
    n, first = phase.system.structure.n, part.first_shared
    if phase.system.structure.velocity_rows:
        raise InputError(
            "source() does not handle constraints: their rows imply each other, which its solver "
            "does not cope with; write the scene in coordinates without constraints"
        )
    elements = [e for group in (problem.phases, problem.links) for x in group for e in x.elements]
    solve = _sqp(assemble(elements, nlp.unknowns, len(nlp.p), nlp.rows), nlp, name)
    q, v = ca.MX.sym("q", n), ca.MX.sym("v", n)
    t, c = ca.MX.sym("t"), ca.MX.sym("params", len(phase.c))
    x0, lam_x0 = ca.MX.sym("x0", nlp.unknowns), ca.MX.sym("lam_x0", nlp.unknowns)
    lam_g0 = ca.MX.sym("lam_g0", nlp.rows)
    data, low, high = (ca.MX(ca.DM(x)) for x in (nlp.p, nlp.x_low, nlp.x_high))
    for places, value in ((slots.q[0], q), (slots.v[0], v)):
        low[places.tolist()], high[places.tolist()] = value, value
    data[[first]] = t
    if len(phase.c):
        data[list(range(first + 2, first + 2 + len(phase.c)))] = c
    found = solve["solver"](
        x0=ca.fmin(ca.fmax(x0, low), high),
        lam_x0=lam_x0,
        lam_g0=lam_g0,
        p=data,
        lbx=low,
        ubx=high,
        lbg=nlp.g_low,
        ubg=nlp.g_high,
    )
    x, lam_x, lam_g = found["x"], found["lam_x"], found["lam_g"]

    def residual(x: ca.MX, lam_x: ca.MX, lam_g: ca.MX) -> ca.MX:
        _, gradient, g, jacobian = solve["derivatives"](x, data)
        slope = gradient.T + ca.mtimes(jacobian.T, lam_g) + lam_x
        sides = ca.vertcat(low - x, x - high, nlp.g_low - g, g - nlp.g_high)
        # the largest of numbers passes over those that are none, a sum does not
        size = ca.sum1(ca.fabs(ca.vertcat(q, v, t, c, x, lam_x, lam_g)))
        return ca.if_else(size < LARGEST, ca.fmax(ca.mmax(ca.fabs(slope)), ca.mmax(sides)), np.inf)

    u = x[slots.u[0].ravel().tolist()]
    step = ca.Function(
        name,
        [q, v, t, c, x0, lam_x0, lam_g0],
        [
            ca.reshape(u, slots.u.shape[2], slots.u.shape[1]),
            x[ahead[0].tolist()],
            lam_x[ahead[0].tolist()],
            lam_g[ahead[1].tolist()],
            residual(x, lam_x, lam_g),
        ],
        ["q", "v", "t", "params", "x0", "lam_x0", "lam_g0"],
        ["u", "x", "lam_x", "lam_g", "residual"],
    )
    given = [q, v, t, c, x0, lam_x0, lam_g0]
    before = ca.Function(f"{name}_before", given, [residual(x0, lam_x0, lam_g0)])
    zeros = ca.DM.zeros(nlp.unknowns), ca.DM.zeros(nlp.rows)
    begin = ca.Function(
        f"{name}_start",
        [],
        [ca.DM(start), *zeros, ca.DM(phase.c)],
        [],
        ["x", "lam_x", "lam_g", "params"],
    )
    return ControllerFunctions(step, begin, before)


def _sqp(program: Program, nlp: NonlinearProgram, name: str) -> dict[str, ca.Function]:
    """The solver, and (x, p) → (f, ∇f, g, ∂g/∂x)."""
    x, p = ca.MX.sym("x", nlp.unknowns), ca.MX.sym("p", len(nlp.p))
    lam_f, lam_g = ca.MX.sym("lam_f"), ca.MX.sym("lam_g", nlp.rows)
    f, g = program.value(x, p)
    slope = ca.densify(program.gradient(x, p)[1]).T
    first = ca.Function(
        f"{name}_derivatives",
        [x, p],
        [f, slope, g, program.jacobian(x, p)[1]],
        ["x", "p"],
        ["f", "jac_f_x", "g", "jac_g_x"],
    )
    second = ca.Function(
        f"{name}_hessian",
        [x, p, lam_f, lam_g],
        [ca.triu2symm(program.hessian(x, p, lam_f, lam_g))],
        ["x", "p", "lam_f", "lam_g"],
        ["hess_gamma_x_x"],
    )
    inner = {"print_iter": False, "print_header": False, "error_on_fail": False}
    options: dict[str, Any] = QUIET | {
        "qpsol": "qrqp",
        "qpsol_options": inner,
        "max_iter": ITERATIONS,
        "tol_pr": TOLERANCE,
        "tol_du": TOLERANCE,
        "jac_fg": first,
        "hess_lag": second,
    }
    made = ca.nlpsol(f"{name}_solver", "sqpmethod", {"x": x, "p": p, "f": f, "g": g}, options)
    return {"solver": made, "derivatives": first}


def write_source(path: Any, functions: tuple[ca.Function, ...]) -> None:
    """The functions as one C file that stands alone."""
    target = parsed_or_refused(
        lambda: Path(path), lambda: f"source() takes the path of a C file, got {path!r}"
    )
    if target.suffix != ".c" or not target.parent.is_dir():
        raise InputError(
            f"source() takes a path in an existing folder that ends in .c, got {path!r}"
        )
    generator = ca.CodeGenerator(target.name)
    for function in functions:
        generator.add(function)
    text = generator.dump()
    write_atomically(target, lambda file: file.write(text.encode()))

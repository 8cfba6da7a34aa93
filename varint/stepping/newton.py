"""Newton's method as a function: CasADi's own iteration, and normal equations where its factorisation breaks down."""

from __future__ import annotations

import casadi as ca

from varint.stepping.implicit import LAST_CORRECTION, MOST_ITERATIONS

# CasADi's sparse QR turns round-off that stands for zero into NaN where it multiplies along a chain until its
# reciprocal overflows; it takes some twenty links and bad luck (40 links, level, at h = 1e-3). LDLᵀ of the normal
# equations has the same fill and no such trouble; it costs twice as much and squares the condition, which Newton's
# method corrects (a chain of 200 links: a factor 1e-3 an iteration).
LARGE = 120
FINITE = 1e300  # what is not a number is not below it
ROUNDS = 12  # unrolled; each that is not needed costs a copy


def newton(name: str, equations: ca.Function, *, large: int = LARGE) -> ca.Function:
    """Root of F(y, …) = 0 from a guess, (y, …) → y; y and F dimensionless, one argument and one output of `equations`.

    It ends with the first correction below LAST_CORRECTION, applied: what is left is its square. From `large` unknowns
    on the normal equations stand by for a root that is not finite.
    """
    options = {"abstol": 0.0, "abstolStep": LAST_CORRECTION, "max_iter": MOST_ITERATIONS, "error_on_fail": False}
    fast = ca.rootfinder(name, "fast_newton", equations, options)
    if equations.numel_in(0) < large:
        return fast
    args = [ca.MX.sym(f"a{i}", equations.numel_in(i)) for i in range(equations.n_in())]
    found = ca.MX.sym("found", equations.numel_in(0))
    keep = ca.Function("keep", [found, *args], [found])
    again = ca.Function("again", [found, *args], [_by_normal_equations(equations)(*args)])
    either = ca.Function.if_else("either", keep, again)
    root = fast(*args)
    return ca.Function(name, args, [either(ca.fabs(ca.sum1(root)) < FINITE, root, *args)])


def _by_normal_equations(equations: ca.Function) -> ca.Function:
    """(y, …) → y by Newton's method with JᵀJ."""
    inputs = equations.sx_in()
    residual = equations.call(inputs)[0]
    slope = ca.jacobian(residual, inputs[0])
    normal = ca.mtimes(slope.T, slope), ca.densify(ca.mtimes(slope.T, residual))
    linear = ca.Function("linear", inputs, normal, {"cse": True})
    size = equations.numel_in(0)
    args = [ca.MX.sym(f"a{i}", equations.numel_in(i)) for i in range(1, equations.n_in())]
    y, last = ca.MX.sym("y", size), ca.MX.sym("last")
    correction = ca.solve(*linear(y, *args), "ldl")
    improve = ca.Function(
        "improve", [ca.vertcat(y, last), *args], [ca.vertcat(y - correction, ca.norm_inf(correction))]
    )
    keep = ca.Function("keep", [ca.vertcat(y, last), *args], [ca.vertcat(y, last)])
    either = ca.Function.if_else("either", improve, keep)
    state = ca.MX.sym("state", size + 1)
    once = ca.Function("once", [state, *args], [either(state[-1] > LAST_CORRECTION, state, *args)])
    many = once.fold(ROUNDS)
    found = many(ca.vertcat(y, 1), *(ca.repmat(a, 1, ROUNDS) for a in args))
    return ca.Function("by_normal_equations", [y, *args], [found[:-1]])

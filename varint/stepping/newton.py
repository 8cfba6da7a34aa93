"""Newton's method as a function: small equations by CasADi's own iteration, large sparse ones by normal equations."""

from __future__ import annotations

import casadi as ca

from varint.stepping.implicit import LAST_CORRECTION, MOST_ITERATIONS

# CasADi's sparse QR turns round-off that stands for zero into NaN where it multiplies along a chain and its square
# underflows; some twenty links suffice. LDLᵀ of the normal equations has the same fill and no such trouble; it squares
# the condition, and Newton's method corrects that (a chain of 200 links: a factor 1e-3 an iteration).
LARGE = 120
ROUNDS = 12  # unrolled; each that is not needed costs a copy


def newton(name: str, equations: ca.Function, *, large: int = LARGE) -> ca.Function:
    """Root of F(y, …) = 0 from a guess, (y, …) → y; y and F dimensionless, one argument and one output of `equations`.

    It ends with the first correction below LAST_CORRECTION, applied: what is left is its square. From `large` unknowns
    on the normal equations are solved.
    """
    if equations.numel_in(0) < large:
        options = {"abstol": 0.0, "abstolStep": LAST_CORRECTION, "max_iter": MOST_ITERATIONS, "error_on_fail": False}
        return ca.rootfinder(name, "fast_newton", equations, options)
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
    return ca.Function(name, [y, *args], [found[:-1]])

"""Newton's method as a function: CasADi's own iteration, and normal equations where its
factorisation breaks down.
"""

from __future__ import annotations

from collections.abc import Callable

import casadi as ca

from varint.discrete.tolerances import LAST_CORRECTION
from varint.numerics.limits import STEP_ITERATIONS

# CasADi's sparse QR turns round-off that stands for zero into NaN where it multiplies along a chain
# until its reciprocal overflows; it takes some twenty links and bad luck (40 links, level, at h =
# 1e-3). LDLᵀ of the normal equations has the same fill and no such trouble; it costs twice as much
# and squares the condition, which Newton's method corrects (a chain of 200 links: a factor 1e-3 an
# iteration).
LARGE = 120
NEVER = 10**9
FINITE = 1e300  # what is not a number is not below it
SEARCH_ITERATIONS, NEAR = 200, 1e-8  # of corrections that may be halved, and where they end
ROUNDS = 12  # unrolled; each that is not needed costs a copy
# what one iteration adds to the counter among the unknowns: far below everything that is tested
COUNT = 1e-30


def newton(name: str, equations: ca.Function, *, large: int = LARGE) -> ca.Function:
    """Root of F(y, …) = 0 from a guess, (y; 0), … → (y; COUNT · iterations); y, F dimensionless,
    input 0 and output 0.

    It ends with the first correction below LAST_CORRECTION, applied: what is left is its square.
    From `large` unknowns on the normal equations stand by for a root that is not finite. The
    counter is one more unknown k with the equation COUNT exp(−k/COUNT) = 0, of which every
    correction is COUNT: CasADi tells of the iterations of a single call only, not of those in a
    loop.
    """
    options = {
        "abstol": 0.0,
        "abstolStep": LAST_CORRECTION,
        "max_iter": STEP_ITERATIONS,
        "error_on_fail": False,
    }
    fast = ca.rootfinder(name, "fast_newton", _counting(equations), options)
    if equations.numel_in(0) < large:
        return fast
    args = [ca.MX.sym(f"a{i}", fast.numel_in(i)) for i in range(fast.n_in())]
    found = ca.MX.sym("found", fast.numel_in(0))
    keep = ca.Function("keep", [found, *args], [found])
    again = ca.Function("again", [found, *args], [_by_normal_equations(equations)(*args)])
    either = ca.Function.if_else("either", keep, again)
    root = fast(*args)
    return ca.Function(name, args, [either(ca.fabs(ca.sum1(root)) < FINITE, root, *args)])


def searching_newton(name: str, equations: ca.Function, *, large: int = LARGE) -> ca.Function:
    """The same from start values that are too far for whole corrections: halved until the residual
    shrinks, then `newton`. What it costs more is for steps that fail without.
    """
    y, *rest = equations.sx_in()
    k = ca.SX.sym("k")
    both = ca.Function("both", [ca.vertcat(y, k), *rest], [ca.vertcat(equations(y, *rest), k)])
    options = {
        "abstol": 0.0,
        "abstolStep": NEAR,
        "max_iter": SEARCH_ITERATIONS,
        "line_search": True,
        "error_on_fail": False,
        "show_eval_warnings": False,  # the caller judges the end
    }
    search = ca.rootfinder("search", "newton", both, options)
    args = [ca.MX.sym(f"a{i}", search.numel_in(i)) for i in range(search.n_in())]
    close = newton("close", equations, large=large)
    return ca.Function(name, args, [close(search(*args), *args[1:])])


Root = Callable[..., ca.Function]  # `newton` and its kin


def _by_normal_equations(equations: ca.Function) -> ca.Function:
    """(y; 0), … → (y; COUNT · iterations) by Newton's method with JᵀJ."""
    inputs = equations.sx_in()
    residual = equations.call(inputs)[0]
    slope = ca.jacobian(residual, inputs[0])
    normal = ca.mtimes(slope.T, slope), ca.densify(ca.mtimes(slope.T, residual))
    linear = ca.Function("linear", inputs, normal, {"cse": True})
    size = equations.numel_in(0)
    args = [ca.MX.sym(f"a{i}", equations.numel_in(i)) for i in range(1, equations.n_in())]
    y, k, last = ca.MX.sym("y", size), ca.MX.sym("k"), ca.MX.sym("last")
    state = ca.vertcat(y, k, last)
    correction = ca.solve(*linear(y, *args), "ldl")
    better = ca.vertcat(y - correction, k + COUNT, ca.norm_inf(correction))
    improve = ca.Function("improve", [state, *args], [better])
    keep = ca.Function("keep", [state, *args], [state])
    either = ca.Function.if_else("either", improve, keep)
    state = ca.MX.sym("state", size + 2)
    once = ca.Function("once", [state, *args], [either(state[-1] > LAST_CORRECTION, state, *args)])
    many = once.fold(ROUNDS)
    start = ca.MX.sym("start", size + 1)
    found = many(ca.vertcat(start, 1), *(ca.repmat(a, 1, ROUNDS) for a in args))
    return ca.Function("by_normal_equations", [start, *args], [found[:-1]])


def iterations(counter: ca.SX | ca.MX) -> ca.SX | ca.MX:
    """The number that the last entry of what `newton` found stands for."""
    return ca.floor(counter / COUNT + 0.5)


def _counting(equations: ca.Function) -> ca.Function:
    """The equations and that of the counter."""
    y, *rest = equations.sx_in()
    k = ca.SX.sym("k")
    residual = equations.call([y, *rest])[0]
    both = ca.vertcat(residual, COUNT * ca.exp(-k / COUNT))
    return ca.Function(equations.name(), [ca.vertcat(y, k), *rest], [both], {"cse": True})

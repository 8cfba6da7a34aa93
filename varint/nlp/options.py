"""Settings of the solvers, and their words in plain English."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from varint.nlp.arrangement import Arrangement
from varint.nlp.program import Program, full_derivatives
from varint.nlp.watch import Watch

MOST_ITERATIONS = 3000  # of Ipopt, unless told otherwise
# a tenth of these is what KKT conditions and rows are met to; bounds are not relaxed, since 1e-8
# shows in the cost
IPOPT = {
    "print_level": 0,
    "sb": "yes",
    "tol": 1e-12,
    "acceptable_tol": 1e-9,
    "acceptable_iter": 3,
    "constr_viol_tol": 1e-11,
    "bound_relax_factor": 0.0,
    "max_iter": MOST_ITERATIONS,
}
FATROP = {"print_level": 0, "tol": 1e-11}
# the next attempt, from where the first one stalled: rounding may forbid more
LOOSER = {"tol": 1e-9}
WARM = {
    "warm_start_init_point": "yes",
    # near a solution the barrier only costs iterations: 1e-12 takes half as many as 1e-6 there and
    # in predictive control, as many or fewer on most far starts, and up to 1.7 times as many where
    # many bounds become active
    "mu_init": 1e-12,
    # that of the cold start is at the level of rounding, which takes two iterations more to see
    "tol": 1e-11,
    "warm_start_bound_push": 1e-8,
    "warm_start_bound_frac": 1e-8,
    "warm_start_slack_bound_push": 1e-8,
    "warm_start_slack_bound_frac": 1e-8,
    "warm_start_mult_bound_push": 1e-8,
    # steps are not refined where a Newton step near the solution mends them, and the program is in
    # its units already: a tenth of a warm solve
    "fast_step_computation": "yes",
    "nlp_scaling_method": "none",
    # units are chosen before: scaling and permuting the few linear systems of a warm solve costs a
    # sixth of it; where they would be needed the cold start that follows has them
    "mumps_scaling": 0,
    "mumps_permuting_scaling": 0,
    "mumps_pivot_order": 0,
}
WORDS = {
    "Infeasible_Problem_Detected": (
        "the conditions seem to contradict each other near the last iterate: relax bounds or "
        "ends, lengthen the duration, or start from another guess"
    ),
    "Maximum_Iterations_Exceeded": (
        'more iterations than allowed: options={"ipopt": {"max_iter": …}} or a better guess'
    ),
    "Restoration_Failed": (
        "no feasible point was found from this guess: try another guess, more steps, looser bounds"
    ),
    "Error_In_Step_Computation": (
        "no step could be computed: conditions may be imposed twice, or scales differ widely"
    ),
    "Not_Enough_Degrees_Of_Freedom": (
        "more conditions than unknowns: free an end, the duration, or add controls"
    ),
    "Invalid_Number_Detected": (
        "values are not finite: the guess passes a singular point of L, of the cost or of a bound"
    ),
    "Invalid_Option": (
        "an option is unknown or its value impossible (a linear solver that is not installed?)"
    ),
    "Diverging_Iterates": "the unknowns grow without bound: bound the controls or the duration",
    "Search_Direction_Becomes_Too_Small": (
        "no progress at the last iterate: scale the scene or start elsewhere"
    ),
    "Not_Solved": (
        "no solution was found from this guess; Fatrop also fails where conditions imply each "
        "other, such "
        'as a conserved momentum given at both ends: solver="ipopt" copes with that'
    ),
    "User_Requested_Stop": "stopped by the user",
    "Maximum_CpuTime_Exceeded": "the time allowed is used up",
    "Maximum_WallTime_Exceeded": "the time allowed is used up",
}
EXTRA: dict[str, tuple[dict[str, Any], ...]] = {"ipopt": ({}, WARM), "fatrop": ({}, LOOSER)}
DIFFERENTIATED = ("ipopt", "fatrop")  # solvers that are handed all derivatives
KNOWN = (
    "ipopt",
    "fatrop",
    "sqpmethod",
    "blocksqp",
    "knitro",
    "snopt",
    "worhp",
    "alpaqa",
    "sleqp",
    "uno",
    "madnlp",
)


def solver_settings(
    program: Program,
    name: str,
    given: Mapping[str, Any],
    extra: dict,
    watch: Watch | None,
    order: Arrangement,
) -> dict[str, Any]:
    """Options for `casadi.nlpsol`: those of the solver and of this attempt, derivatives, a watch,
    and what the caller gave.
    """
    settings: dict[str, Any] = {
        "print_time": False,
        "error_on_fail": False,
        "show_eval_warnings": False,
    }
    if name == "ipopt":
        settings |= dict(grad_f=program.gradient, jac_g=program.jacobian, hess_lag=program.hessian)
        settings |= {"no_nlp_grad": True, "ipopt": IPOPT | extra}
        settings |= {} if watch is None else {"iteration_callback": watch}
    if name == "fatrop":
        settings |= {"cache": full_derivatives(program), "fatrop": FATROP | extra, **order.options}
    if name in DIFFERENTIATED:
        settings |= {"calc_lam_p": False}
    for key, value in given.items():
        nested = isinstance(value, Mapping) and isinstance(settings.get(key), dict)
        settings[key] = settings[key] | dict(value) if nested else value
    return settings

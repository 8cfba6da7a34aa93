"""The header of an exported controller: what its user reads."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from varint.numerics.files import VERSION
from varint.standalone.layout import CLOSING, OPENING, comment

TEXT = """
/* The worst case of a call: so many quadratic programs, and so many changes of the active set in
   each. May be set by -D{N}_ITERATIONS=... */
#ifndef {N}_ITERATIONS
#define {N}_ITERATIONS {iterations}
#endif
#ifndef {N}_QP_ITERATIONS
#define {N}_QP_ITERATIONS {qp_iterations}
#endif

/* Largest violation of the dynamics, of bounds and of stationarity with which a plan is accepted;
   1e-10 is where iterations end of themselves. */
#ifndef {N}_TOLERANCE
#define {N}_TOLERANCE 1e-6
#endif
#define {N}_FAILED 1e300 /* the residual where functions could not be evaluated */

/* Status of a call */
#define {N}_SOLVED 0     /* u are the controls of a new plan */
#define {N}_NOT_SOLVED 1 /* no plan was found in time: u are those of the former plan for this
                            time; the next call goes on where this one came to */
#define {N}_NOT_FINITE 2 /* the same, and a number overflowed or is not defined */
{extern}
/* Before the first call: the plan at the first state of the motion that the test goes along.
     memory: {N}_MEMORY numbers, kept by the caller from call to call */
void {name}_start(double *memory);

/* The controls at the state (q, v): {n} coordinates and velocities.
     t: time, for scenes and costs that depend on it
     params: values of the parameters, such as a set-point{no_params}
     ahead: whether a whole step of the horizon has passed since the call before
     u: {N}_CONTROLS numbers, the controls to apply now
     report: null, or one number: the largest violation left
   returns {N}_SOLVED, or why the plan is the former one */
int {name}_step(double *memory, const double *q, const double *v, double t,
    const double *params, int ahead, double *u, double *report);
"""


def controller_header(
    name: str,
    sizes: Mapping[str, int],
    about: Sequence[str],
    iterations: int,
    qp_iterations: int,
) -> str:
    """The header of a controller."""
    big, count = name.upper(), sizes["parameters"]
    words = dict(
        name=name,
        N=big,
        n=sizes["n"],
        iterations=iterations,
        qp_iterations=qp_iterations,
        no_params=f"; the defaults are {name}_params" if count else "; null here",
        extern=f"\nextern const double {name}_params[{count}];\n" if count else "",
    )
    defines = [
        ("N", sizes["n"], "coordinates"),
        ("CONTROLS", sizes["controls"], "numbers that say what the controls are in a step"),
        ("PARAMETERS", count, "parameters"),
        ("MEMORY", sizes["kept"] + sizes["work"], "numbers that the caller keeps"),
    ]
    return "".join(
        [
            comment([f"A predictive controller; written by varint {VERSION}.", *about]),
            f"#ifndef {big}_H\n#define {big}_H\n\n{OPENING}",
            *(f"#define {big}_{x} {size} /* {what} */\n" for x, size, what in defines),
            TEXT.format_map(words),
            f"{CLOSING}\n#endif /* {big}_H */\n",
        ]
    )

"""The header of an exported step: what its user reads."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from varint.numerics.files import VERSION
from varint.standalone.layout import CLOSING, OPENING, comment

STEP = """
/* The state of a run at (q, p): {n} coordinates and momenta at `t`. Begin anew after a jump of q or
   p, and whenever h or params change.
     u: controls of the first step{u}
     params: values of the parameters; {name}_params are the defaults{no_params}
     state: {N}_STATE numbers, to be kept from step to step */
void {name}_start(const double *q, const double *p, const double *u,
    const double *params, double t, double h, double *state);

/* One step of size h from time t; the coordinates are then state[{N}_Q + i], the momenta
   state[{N}_P + i]. What is left of a step that fails is the state before it.
     report: null, or two numbers: iterations of the step, and what is left of its equations,
             relative to the momenta
   returns {N}_SOLVED, or why the step could not be made */
int {name}_step(double *state, const double *u, const double *params, double t, double h,
    double *report);

/* p = dL/dv of the velocities v */
void {name}_momentum(const double *q, const double *v, const double *params, double t, double *p);
"""
VELOCITY = """
/* The velocities v of the momenta p */
void {name}_velocity(const double *q, const double *p, const double *params, double t, double *v);
"""
STATUS = """
/* Status of a step */
#define {N}_SOLVED 0     /* its equations hold to 1e-10 of the momenta or better */
#define {N}_NOT_SOLVED 1 /* they do not{bound}: take a smaller h */
#define {N}_NOT_FINITE 2 /* a number overflowed or is not defined: the scene is singular there */
"""
ITERATIONS = """
/* Iterations of Newton's method after which a step gives up: its worst case. Some 3 to 6 are usual;
   may be set by -D{N}_ITERATIONS=... */
#ifndef {N}_ITERATIONS
#define {N}_ITERATIONS {iterations}
#endif
"""


def step_header(
    name: str, sizes: Mapping[str, int], about: Sequence[str], iterations: int, velocity: bool
) -> str:
    """The header; `iterations` is 0 where a step iterates nothing."""
    words = dict(
        name=name,
        N=name.upper(),
        n=sizes["n"],
        iterations=iterations,
        u=_controls(sizes, name.upper()),
        no_params="" if sizes["parameters"] else " (null here)",
        bound=f" after {name.upper()}_ITERATIONS iterations" if iterations else "",
    )
    guard = f"{name.upper()}_H"
    defines = [
        ("N", sizes["n"], "coordinates"),
        ("CONTROLS", sizes["controls"], "controls"),
        ("NODES", sizes["nodes"], "times in a step at which controls are given"),
        ("PARAMETERS", sizes["parameters"], "parameters"),
        ("STATE", sizes["state"], "numbers of the state of a run"),
        ("Q", 0, "where its coordinates begin"),
        ("P", 2 * sizes["n"], "where its momenta begin"),
    ]
    parts = [
        comment([f"One step of a mechanical system; written by varint {VERSION}.", *about]),
        f"#ifndef {guard}\n#define {guard}\n\n{OPENING}",
        *(f"#define {name.upper()}_{x} {size} /* {what} */\n" for x, size, what in defines),
        ITERATIONS.format_map(words) if iterations else "",
        STATUS.format_map(words),
        f"\nextern const double {name}_params[{sizes['parameters']}];\n"
        if sizes["parameters"]
        else "",
        STEP.format_map(words),
        VELOCITY.format_map(words) if velocity else "",
        f"{CLOSING}\n#endif /* {guard} */\n",
    ]
    return "".join(parts)


def _controls(sizes: Mapping[str, int], big: str) -> str:
    if not sizes["controls"]:
        return "; null here"
    if sizes["nodes"] == 1:
        return f", {big}_CONTROLS numbers that hold all the step"
    return f" at the rule's nodes, u[node * {big}_CONTROLS + i]"

"""One call of a predictive controller as C: state in, controls out, with bounded iterations."""

from __future__ import annotations

import re
from typing import NamedTuple

import casadi as ca
import numpy as np

from varint.control.controller import Controller, ahead_by_a_step
from varint.control.source import controller_function
from varint.errors import InputError
from varint.results.trajectory import Trajectory
from varint.scene.system import parameter_entries
from varint.standalone.c_text import CText, c_text
from varint.standalone.controller_header import controller_header
from varint.standalone.layout import Files, array, comment

TESTED = 20  # states that the test program hands to the controller
ROUNDED = 1e-9  # of the largest control: what iterations that end at 1e-10 may leave
WHOLE = 1e-9  # of a step: times that are so nearly a whole number of steps are one
QP_ITERATIONS = 200  # changes of the active set of one quadratic program, at most
_SQP = re.compile(r"\biter_count >= \d{2,}\b")
_QP = re.compile(r"\bp\.max_iter = \d+;")


class Parts(NamedTuple):
    """Lengths of what a controller keeps, its function, and where the first call ever starts."""

    unknowns: int
    rows: int
    step: ca.Function
    start: np.ndarray


def controller_files(
    controller: Controller, name: str, along: Trajectory, iterations: int
) -> Files:
    """Header, source and test program of a controller, tested at the states of a motion."""
    part = controller.problem.phases[0]
    s, slots = part.phase.system, part.slots
    if along.q.shape[1] != s.structure.n:
        raise InputError(
            f"along= has a motion of {along.q.shape[1]} coordinates, the controller has "
            f"{s.structure.n}"
        )
    parts = _parts(controller, name)
    plan, ahead, u = _answers(controller, parts, along)
    text = c_text(name, [parts.step])
    sizes = dict(
        n=s.structure.n,
        controls=slots.u.shape[1] * slots.u.shape[2],
        parameters=len(part.phase.c),
        kept=len(parts.start),
        work=2 * len(parts.start) + text.functions[f"{name}_step_"].numbers,
    )
    header = controller_header(name, sizes, _about(controller, parts), iterations, QP_ITERATIONS)
    source = "".join(
        [
            f'#include "{name}.h"\n\n',
            _bounded(text, name),
            f"\n/* {', '.join(parameter_entries(s)) or 'no parameters'} */\n",
            array(f"{name}_params", part.phase.c, static=False) if len(part.phase.c) else "",
            array(f"{name}_first_plan", plan),
            _start_wrapper(name, parts),
            _step_wrapper(name, text, parts, sizes),
        ]
    )
    return Files(header, source, _test(name, sizes, along, ahead, u))


def _parts(controller: Controller, name: str) -> Parts:
    """The function of one call: (q, v, t, params, kept, ahead) → (controls, kept, residual, the
    guess's controls, guess and residual), where x and λ are kept.
    """
    nlp, part = controller.problem.nlp, controller.problem.phases[0]
    same = np.arange(nlp.unknowns), np.arange(nlp.rows)
    made = controller_function(controller.problem, controller.start, same, f"{name}_solve")
    q, v, t, c, x, lam_x, lam_g = inputs = made.step.mx_in()
    ahead = ca.MX.sym("ahead")
    to = ahead_by_a_step(part, nlp)
    guess = [
        ca.if_else(ahead, old[index.tolist()], old)
        for old, index in ((x, to[0]), (lam_x, to[0]), (lam_g, to[1]))
    ]
    u, *found, residual = made.step(q, v, t, c, *guess)
    before = made.before(q, v, t, c, *guess)
    held = guess[0][part.slots.u[0].ravel().tolist()]
    outputs = [ca.vec(u), ca.vertcat(*found), residual, held, ca.vertcat(*guess), before]
    kept = ca.MX.sym("kept", 2 * nlp.unknowns + nlp.rows)
    split = ca.vertsplit(kept, [0, nlp.unknowns, 2 * nlp.unknowns, kept.numel()])
    whole = ca.Function("whole", [*inputs, ahead], outputs)
    given = [*inputs[:4], *split, ahead]
    step = ca.Function(f"{name}_step_", [*inputs[:4], kept, ahead], whole(*given))
    zeros = np.zeros(nlp.unknowns + nlp.rows)
    return Parts(nlp.unknowns, nlp.rows, step, np.concatenate([controller.start, zeros]))


def _bounded(text: CText, name: str) -> str:
    """The text, its iterations bounded by what the header defines."""
    big = name.upper()
    found, outer = _SQP.subn(f"iter_count >= {big}_ITERATIONS", text.text)
    found, inner = _QP.subn(f"p.max_iter = {big}_QP_ITERATIONS;", found)
    assert outer == inner == 1, (outer, inner)
    return found


def _about(controller: Controller, parts: Parts) -> list[str]:
    phase = controller.problem.phases[0].phase
    s = phase.system
    return [
        f"Coordinates: {', '.join(s.names)}.",
        f"Controls: {', '.join(s.control_names)}.",
        f"Parameters: {', '.join(parameter_entries(s)) or 'none'}.",
        f"Horizon: {phase.steps} steps of {phase.rule}, {phase.duration[0]:g} in all; "
        f"{parts.unknowns} unknowns, {parts.rows} rows.",
        "Method: sequential quadratic programming with exact Hessians (Nocedal & Wright, section "
        "18.1), each program by a primal-dual active-set method; CasADi's sqpmethod and qrqp.",
        "No allocation. The solver has a static record: one thread at a time.",
    ]


def _start_wrapper(name: str, parts: Parts) -> str:
    big = name.upper()
    return f"""
void {name}_start(double *memory) {{
    int i;
    for (i = 0; i < {len(parts.start)}; ++i) memory[i] = {name}_first_plan[i];
    for (; i < {big}_MEMORY; ++i) memory[i] = 0;
}}
"""


def _step_wrapper(name: str, text: CText, parts: Parts, sizes: dict[str, int]) -> str:
    f, big, kept = text.functions[f"{name}_step_"], name.upper(), sizes["kept"]
    k = sizes["controls"]
    given = ["q", "v", "&t", "params", "memory", "&moved"]
    results = ["now", "next", "&residual", "held", "guess", "&before"]
    lines = [f"    arg[{i}] = {x};" for i, x in enumerate(given)]
    lines += [f"    res[{i}] = {x};" for i, x in enumerate(results)]
    parameters = ""
    if count := sizes["parameters"]:
        every = f"    for (i = 0; i < {count}; ++i)"
        parameters = f"{every} if (!isfinite(params[i])) status = {big}_NOT_FINITE;\n"
    return f"""
int {name}_step(double *memory, const double *q, const double *v, double t,
    const double *params, int ahead, double *u, double *report) {{
    const double *arg[{f.arguments}];
    double *res[{f.results}];
    int iw[{max(f.integers, 1)}];
    double now[{k}], held[{k}], residual = 0, before = 0, moved = ahead != 0;
    double *next = memory + {kept}, *guess = next + {kept}, *w = guess + {kept};
    const double *plan;
    int i, status = {big}_SOLVED;
{chr(10).join(lines)}
    if ({f.called}(arg, res, iw, w, 0)) residual = {big}_FAILED;
    if (report) report[0] = residual;
    if (!(residual <= {big}_TOLERANCE)) status = {big}_NOT_SOLVED;
    if (!isfinite(t)) status = {big}_NOT_FINITE; /* the largest of numbers passes over these */
    for (i = 0; i < {sizes["n"]}; ++i) if (!isfinite(q[i] + v[i])) status = {big}_NOT_FINITE;
{parameters}    for (i = 0; i < {kept}; ++i) if (!isfinite(next[i])) status = {big}_NOT_FINITE;
    /* what is not solved yet is gone on with by the next call, if it is any better */
    plan = status != {big}_NOT_FINITE && residual <= fmax(before, {big}_TOLERANCE) ? next : guess;
    for (i = 0; i < {k}; ++i) u[i] = status == {big}_SOLVED ? now[i] : held[i];
    for (i = 0; i < {kept}; ++i) memory[i] = plan[i];
    return status;
}}
"""


def _answers(
    controller: Controller, parts: Parts, along: Trajectory
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The plan at the first state of the motion, with which a controller in C begins; whether a
    step of the horizon has passed before each state, and the controls there.
    """
    part = controller.problem.phases[0]
    h = part.phase.duration[0] / part.phase.steps
    passed = np.floor((along.t - along.t[0]) / h + WHOLE)
    ahead = np.append(0, np.diff(passed) > 0).astype(float)
    kept, u = parts.start, list[np.ndarray]()
    for i in (0, *range(min(len(along), TESTED))):
        found = parts.step(along.q[i], along.v[i], along.t[i], part.phase.c, kept, ahead[i])
        if not float(found[2]) < ROUNDED:
            raise InputError(
                f"the controller finds no controls at node {i} of the motion along=, "
                f"t = {along.t[i]:g}: a residual of {float(found[2]):.1e} is left; give a motion "
                "whose states it can control, such as that of closed_loop"
            )
        if not u:
            plan = np.array(found[1]).ravel()
        u.append(np.array(found[0]).ravel())
        kept = found[1]
    return plan, ahead[: len(u) - 1], np.array(u[1:])


def _test(
    name: str, sizes: dict[str, int], along: Trajectory, ahead: np.ndarray, u: np.ndarray
) -> str:
    """A program that hands the states of the motion to the controller and compares."""
    big, k = name.upper(), sizes["controls"]
    q, v, t = (getattr(along, x)[: len(u)] for x in ("q", "v", "t"))
    n, params = sizes["n"], f"{name}_params" if sizes["parameters"] else "0"
    return f"""{comment([f"Compares {name}_step with varint in Python; returns 0 if they agree."])}
#include <math.h>
#include <stdio.h>
#include "{name}.h"

{array("q", q)}{array("v", v)}{array("t", t)}{array("ahead", ahead)}{array("u", u)}
static double memory[{big}_MEMORY];

int main(void) {{
    double found[{k}], report[1], off = 0, size = 1e-300;
    int i, k, status;
    {name}_start(memory);
    for (k = 0; k < {len(u)}; ++k) {{
        status = {name}_step(memory, q + k * {n}, v + k * {n}, t[k], {params}, ahead[k] != 0,
            found, report);
        if (status != {big}_SOLVED) {{
            printf("state %d: status %d, residual %g\\n", k, status, report[0]);
            return 2;
        }}
        for (i = 0; i < {k}; ++i) {{
            size = fmax(size, fabs(u[k * {k} + i]));
            off = fmax(off, fabs(found[i] - u[k * {k} + i]));
        }}
    }}
    printf("{name}: {len(u)} states, largest relative difference %.2g\\n", off / size);
    return off <= {ROUNDED!r} * size ? 0 : 1;
}}
"""

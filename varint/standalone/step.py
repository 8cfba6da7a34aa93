"""One step of a scene as C: the stepper that `simulate` runs, over plain arrays."""

from __future__ import annotations

import re
import warnings

import casadi as ca
import numpy as np

from varint.discrete.legendre import velocity_function
from varint.discrete.scales import BALANCED
from varint.discrete.tolerances import RESIDUAL_LIMIT
from varint.errors import InputError
from varint.integration.interpreted_loop import beginning_function
from varint.integration.plan import Plan, plan
from varint.integration.simulate import simulate
from varint.integration.steppers.stepper import state_size
from varint.results.trajectory import Trajectory
from varint.rules.rule import Rule
from varint.scene.system import System, parameter_entries, parameters_by_name
from varint.standalone.c_text import CFunction, c_text
from varint.standalone.layout import Files, array, calls, comment, work_bytes
from varint.standalone.step_header import step_header

TESTED = 50  # steps of the motion that the test program goes along
ROUNDED = 1e-12  # of the largest value of each coordinate: what compilers round differently
_NEWTON = re.compile(r"\biter<\d+;")


def step_files(motion: Trajectory, name: str, iterations: int) -> Files:
    """Header, source and test program of the step that made a motion."""
    system, rule = _scene_of(motion)
    chosen = plan(system, rule)
    held = motion.u.shape[1] == 1  # controls are constant on a step
    functions = _functions(system, rule, name, held)
    text = c_text(name, functions)
    step = text.functions[f"{name}_step_"]
    sizes = dict(
        n=system.structure.n,
        controls=system.structure.controls,
        nodes=1 if held else len(rule.nodes),
        parameters=system.c.numel(),
        state=functions[1].numel_in(0),
    )
    bounded = _NEWTON.sub(f"iter<{name.upper()}_ITERATIONS;", text.text)
    header = step_header(
        name,
        sizes,
        about=_about(system, rule, chosen, text.functions),
        iterations=iterations if bounded != text.text else 0,
        velocity=f"{name}_velocity_" in text.functions,
    )
    source = "".join(
        [
            f'#include "{name}.h"\n\n',
            bounded,
            f"\n/* {', '.join(parameter_entries(system)) or 'no parameters'} */\n",
            array(f"{name}_params", motion.c, static=False) if len(motion.c) else "",
            *_wrappers(name, text.functions),
            _step_wrapper(name, step),
        ]
    )
    return Files(header, source, _test(motion, system, rule, name, sizes))


def _scene_of(motion: Trajectory) -> tuple[System, Rule]:
    """The scene that a step of the motion solves, with constraint rows that depend on others left
    out.
    """
    for found, what in (
        (motion.system.structure.contacts, "contacts, whose impacts no bounded number of steps is"),
        (motion.fictitious is not None, "variable steps (time_scale=)"),
        (motion.sizes is not None, "steps that differ in size"),
        (len(motion.u) == 0, "no step"),
    ):
        if found:
            raise InputError(
                f"export takes a motion of equal steps, this one has {what}; simulate it with h= "
                "and steps="
            )
    if motion.active_sets:
        return motion.active_sets[0].scene(motion.system), motion.rule
    return motion.system, motion.rule


def _functions(system: System, rule: Rule, name: str, held: bool) -> list[ca.Function]:
    """Begin, step, momentum, and velocity where there is one; their state is the stepper's without
    its counters, and the typical sizes that its iterations are measured by.
    """
    stepper = plan(system, rule).build(system, rule)
    s, n, size = system, system.structure.n, stepper.step.numel_in(0) - 2
    names, copies = ("q", "p", "u", "params", "t", "h"), len(rule.nodes) if held else 1
    sizes = (n, n, stepper.step.numel_in(1) // copies, s.c.numel(), 1, 1)
    q, p, given, c, t, h = inputs = [ca.MX.sym(x, k) for x, k in zip(names, sizes, strict=True)]
    u = ca.repmat(given, copies)
    typical = ca.MX(0, 1)
    if s.structure.controls:
        typical = ca.mmax(ca.fabs(given)) * ca.DM.ones(s.structure.controls)
    x0, scale, _ = beginning_function(s, rule)(q, p, u, typical, t, h, c)
    begin = ca.Function(f"{name}_start_", inputs, [ca.vertcat(x0[:size], scale)])
    state = ca.MX.sym("state", size + scale.numel())
    x, kept = ca.vertsplit(state, [0, size, state.numel()])
    after = stepper.step(ca.vertcat(x, 0, 0), u, t, h, c, kept)
    outputs = [ca.vertcat(after[:size], kept), after[size:]]
    step = ca.Function(f"{name}_step_", [state, given, c, t, h], outputs)
    assert size + 2 == state_size(n, size - 4 * n)
    found = [begin, step, ca.Function(f"{name}_momentum_", [s.q, s.v, s.c, s.t], [s.momentum])]
    if not s.structure.degenerate:
        v = velocity_function(s)(q, p, t, c)
        found.append(ca.Function(f"{name}_velocity_", [q, p, c, t], [v]))
    return found


def _about(system: System, rule: Rule, chosen: Plan, functions: dict[str, CFunction]) -> list[str]:
    s = system
    named = ", ".join(parameter_entries(s)) or "none"
    return [
        f"Coordinates: {', '.join(s.names)}.",
        f"Controls: {', '.join(s.control_names) or 'none'}.",
        f"Parameters: {named}.",
        f"Rule: {rule}, order {rule.order}; {chosen.method}.",
        *(f"  {line}." for line in chosen.runs),
        f"Stack: about {max(map(work_bytes, functions.values()))} bytes; no allocation, no global "
        "state: several threads may call at once.",
    ]


def _wrappers(name: str, functions: dict[str, CFunction]) -> list[str]:
    """C functions whose arguments are arrays, and numbers by value."""
    start = calls(
        f"void {name}_start(const double *q, const double *p, const double *u,\n"
        f"    const double *params, double t, double h, double *state)",
        functions[f"{name}_start_"],
        ["q", "p", "u", "params", "&t", "&h"],
        ["state"],
    )
    found = [start]
    for what, given in (("momentum", "v"), ("velocity", "p")):
        if entry := functions.get(f"{name}_{what}_"):
            result = "p" if what == "momentum" else "v"
            found.append(
                calls(
                    f"void {name}_{what}(const double *q, const double *{given},\n"
                    f"    const double *params, double t, double *{result})",
                    entry,
                    ["q", given, "params", "&t"],
                    [result],
                )
            )
    return found


def _step_wrapper(name: str, step: CFunction) -> str:
    big = name.upper()
    body = f"""
    double next[{big}_STATE], how[2];
    int i, status = {big}_SOLVED;
@CALL@
    if (report) {{
        report[0] = how[0];
        report[1] = how[1];
    }}
    if (!(how[1] <= {RESIDUAL_LIMIT!r})) status = {big}_NOT_SOLVED;
    for (i = 0; i < {big}_STATE; ++i) if (!isfinite(next[i])) status = {big}_NOT_FINITE;
    if (status == {big}_SOLVED) for (i = 0; i < {big}_STATE; ++i) state[i] = next[i];
    return status;
"""
    return calls(
        f"int {name}_step(double *state, const double *u, const double *params, double t, double h,"
        "\n    double *report)",
        step,
        ["state", "u", "params", "&t", "&h"],
        ["next", "how"],
        body,
    )


def _test(motion: Trajectory, system: System, rule: Rule, name: str, sizes: dict[str, int]) -> str:
    """A program that goes along the first steps of the motion and compares."""
    steps, n, big = min(len(motion.u), TESTED), sizes["n"], name.upper()
    u = motion.u[:steps]
    expected = _again(motion, system, rule, u)
    params = f"{name}_params" if len(motion.c) else "0"
    control = f"u + k * {u[0].size}" if u.size else "0"
    return f"""{comment([f"Compares {name}_step with varint in Python; returns 0 if they agree."])}
#include <math.h>
#include <stdio.h>
#include "{name}.h"

{array("q", expected.q)}{array("p", expected.p)}{array("u", u) if u.size else ""}
/* Largest values on the way, by which differences are measured */
{array("q_size", _sizes(expected.q))}{array("p_size", _sizes(expected.p))}
int main(void) {{
    double state[{big}_STATE], report[2], most = 0, off;
    const double t0 = {float(expected.t[0])!r}, h = {float(expected.h)!r};
    int i, k, status;
    {name}_start(q, p, {control.replace("k", "0")}, {params}, t0, h, state);
    for (k = 0; k < {steps}; ++k) {{
        status = {name}_step(state, {control}, {params}, t0 + k * h, h, report);
        if (status != {big}_SOLVED) {{
            printf("step %d: status %d, residual %g\\n", k, status, report[1]);
            return 2;
        }}
        for (i = 0; i < {n}; ++i) {{
            off = fabs(state[{big}_Q + i] - q[(k + 1) * {n} + i]) / q_size[i];
            most = fmax(most, off);
            off = fabs(state[{big}_P + i] - p[(k + 1) * {n} + i]) / p_size[i];
            most = fmax(most, off);
        }}
    }}
    printf("{name}: {steps} steps, largest relative difference %.2g\\n", most);
    return most <= {ROUNDED!r} ? 0 : 1;
}}
"""


def _sizes(values: np.ndarray) -> np.ndarray:
    """Largest value of each coordinate; of one at rest, a hundredth of the others'."""
    largest = np.abs(values).max(axis=0)
    return np.maximum(largest, BALANCED * largest.max(initial=0.0)) + np.finfo(float).tiny


def _again(motion: Trajectory, system: System, rule: Rule, u: np.ndarray) -> Trajectory:
    """The first steps of the motion by the interpreted loop, whose operations are those in C."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # its user has read them when it was made
        return simulate(
            system,
            rule,
            q0=motion.q[0],
            p0=motion.p[0],
            t0=float(motion.t[0]),
            h=motion.h,
            steps=len(u),
            u=u if u.size else None,
            params=parameters_by_name(system, motion.c),
            backend="interpreted",
            progress=False,
        )

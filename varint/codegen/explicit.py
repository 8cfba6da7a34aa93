"""Explicit kick–drift compositions in a compiled loop."""

from __future__ import annotations

import casadi as ca

from varint.codegen.arranged import forms_of
from varint.codegen.cache import AS_WRITTEN
from varint.codegen.graph import NotCompilable, kernel_per_system
from varint.codegen.kernel import Kernel
from varint.codegen.mechanics import force, velocity
from varint.codegen.routines import Routine, routines
from varint.codegen.source import Source, compiled, emitted, source_of
from varint.rules.rule import Rule
from varint.scene.system import System

LOOPS_FROM = 2000  # operations of a force; the compiler vectorises loops over pairs and neighbours
# and from which on that pays where most of them have so many of the same form beside them, as those
# of a chain's springs
ALIKE_FROM, MOST, MANY = 150, 0.6, 24
# operations of a force that take far longer than a call: it is written out once, not wherever it is
# needed, where every copy takes the compiler as long as all the rest
IN_LINE = 200
OF_A_FUNCTION = 15  # operations of a sine, a cosine or an exponential besides itself, in line
UNROLLED_OPERATIONS = 400  # a whole sequence of kicks up to this size is straight-line code


@kernel_per_system
def explicit_kernel(system: System, rule: Rule) -> Kernel:
    """The compiled composition ``p += h b_i F(q, t, u), q += h a_i M⁻¹(p − d)`` of a separable
    scene.

    Parameters
    ----------
    system : System
        Separable, with constant mass and forces free of v.
    rule : Rule
        With kicks and drifts.

    Returns
    -------
    Kernel

    Raises
    ------
    NotCompilable
        If the scene or the rule is not of this kind.
    CompileError
        If there is no compiler or no safe cache folder.
    """
    return compiled(explicit_source(system, rule))


@kernel_per_system
def explicit_source(system: System, rule: Rule) -> Source:
    """The C source of `explicit_kernel`."""
    arranged = explicit_functions(system, rule)
    functions = emitted({"rhs": arranged["rhs"]}, written_out=loops_from(arranged["rhs"]))
    functions |= emitted({"velocity": arranged["velocity"]}, written_out=LOOPS_FROM)
    kicks = len(rule.kicks)
    written_out = sum(node[0] in ("sin", "cos", "exp") for node in arranged["rhs"].graph.nodes)
    operations = functions["rhs"].operations + OF_A_FUNCTION * written_out
    unrolled = kicks if operations * kicks <= UNROLLED_OPERATIONS else 1
    data = "".join(
        f"static const double {name}[] = {{{', '.join(float(x).hex() for x in values)}}};\n"
        for name, values in zip(("KICK", "DRIFT", "NODE"), sequence(rule), strict=True)
    )
    return source_of(
        about(rule),
        system,
        kicks,
        functions,
        {
            "LANES": 1,
            "KICKS": kicks,
            "UNROLLED": f'"GCC unroll {unrolled}"',
            "LONG_FORCE": int(operations > IN_LINE),
        },
        data,
        "explicit.c",
        contraction=AS_WRITTEN,
    )


def loops_from(force: Routine) -> int:
    """From how many operations on this force is written in loops. Short ones are arranged as they
    are written out, and long sums, which loops add up in an order of their own, stay that way.
    """
    forms = forms_of(force.graph, force.last, ALIKE_FROM)
    if forms is None or forms.terms:
        return LOOPS_FROM
    alike = sum([len(nodes) for nodes in forms.members if len(nodes) >= MANY])
    return ALIKE_FROM if alike >= MOST * force.sizes.operations else LOOPS_FROM


@kernel_per_system
def explicit_functions(system: System, rule: Rule) -> dict[str, Routine]:
    """The forces "rhs" and the "velocity"; raises NotCompilable."""
    if not system.structure.explicit or not rule.kicks:
        raise NotCompilable(
            "a compiled composition needs a separable scene with constant mass, and a rule with "
            "kicks"
        )
    q, t, u = system.q, system.t, system.control
    p = ca.SX.sym("p", q.numel())
    expressions = {
        "rhs": ([q, t, u], [force(system)]),
        "velocity": ([q, p, t], [velocity(system, p)]),
    }
    return routines(system.c, expressions, LOOPS_FROM)


def about(rule: Rule) -> str:
    return f"{rule.name}, {len(rule.kicks)} kicks a step"


def sequence(rule: Rule) -> tuple[list[float], list[float], list[float]]:
    """Weights of kicks and drifts, and the time of each kick in a step."""
    return [*rule.kicks], [*rule.drifts], [sum(rule.drifts[:k]) for k in range(len(rule.kicks))]

"""Explicit kick–drift compositions in a compiled loop."""

from __future__ import annotations

import casadi as ca

from varint.codegen.graph import NotCompilable, kernel_per_system
from varint.codegen.kernel import Kernel, compiled, emit_functions, source_of
from varint.codegen.mechanics import force, velocity
from varint.rules.rule import Rule
from varint.scene.system import System

LOOPS_FROM = 2000  # operations of a force; the compiler vectorises loops over pairs and neighbours
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
    functions = emit_functions(system.c, expressions, written_out=LOOPS_FROM)
    kicks = len(rule.kicks)
    unrolled = kicks if functions["rhs"].operations * kicks <= UNROLLED_OPERATIONS else 1
    data = "".join(
        f"static const double {name}[] = {{{', '.join(float(x).hex() for x in values)}}};\n"
        for name, values in (("KICK", rule.kicks), ("DRIFT", rule.drifts), ("NODE", _times(rule)))
    )
    defines = {"LANES": 1, "KICKS": kicks, "UNROLLED": f'"GCC unroll {unrolled}"'}
    source = source_of(
        f"{rule.name}, {kicks} kicks a step", system, kicks, functions, defines, data, "explicit.c"
    )
    return compiled(source)


def _times(rule: Rule) -> list[float]:
    """Time of each kick in a step."""
    return [sum(rule.drifts[:k]) for k in range(len(rule.kicks))]

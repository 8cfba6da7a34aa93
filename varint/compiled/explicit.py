"""Explicit kick–drift compositions in a compiled loop."""

from __future__ import annotations

from weakref import WeakKeyDictionary

import casadi as ca

from varint.compiled.graph import NotCompilable
from varint.compiled.kernel import Kernel, build, emitted
from varint.compiled.mechanics import force, velocity
from varint.rules import Rule
from varint.system import System

_KNOWN: WeakKeyDictionary[System, dict[Rule, Kernel]] = WeakKeyDictionary()
LOOPS_FROM = 2000  # operations of a force; the compiler vectorises loops over pairs and neighbours
UNROLLED_OPERATIONS = 1500  # a whole sequence of kicks up to this size is straight-line code


def explicit_kernel(system: System, rule: Rule) -> Kernel:
    """The compiled composition ``p += h b_i F(q, t, u), q += h a_i M⁻¹(p − d)`` of a separable scene.

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
        raise NotCompilable("a compiled composition needs a separable scene with constant mass, and a rule with kicks")
    known = _KNOWN.setdefault(system, {})
    if rule not in known:
        known[rule] = _built(system, rule)
    return known[rule]


def _built(system: System, rule: Rule) -> Kernel:
    q, t, u = system.q, system.t, system.control
    p = ca.SX.sym("p", q.numel())
    expressions = {"rhs": ([q, t, u], [force(system)]), "velocity": ([q, p, t], [velocity(system, p)])}
    functions = emitted(system.c, expressions, written_out=LOOPS_FROM)
    kicks = len(rule.kicks)
    unrolled = kicks if functions["rhs"].operations * kicks <= UNROLLED_OPERATIONS else 1
    data = "".join(
        f"static const double {name}[] = {{{', '.join(float(x).hex() for x in values)}}};\n"
        for name, values in (("KICK", rule.kicks), ("DRIFT", rule.drifts), ("NODE", _times(rule)))
    )
    defines = {"LANES": 1, "KICKS": kicks, "UNROLLED": f'"GCC unroll {unrolled}"'}
    return build(f"{rule.name}, {kicks} kicks a step", system, kicks, functions, defines, data, "explicit.c")


def _times(rule: Rule) -> list[float]:
    """Time of each kick in a step."""
    return [sum(rule.drifts[:k]) for k in range(len(rule.kicks))]

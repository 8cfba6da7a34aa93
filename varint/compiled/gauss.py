"""Stage-parallel Gauss collocation: all stages of a step iterated at once in vector registers."""

from __future__ import annotations

from functools import lru_cache
from weakref import WeakKeyDictionary

import casadi as ca

from varint.compiled.cache import vector_length
from varint.compiled.graph import NotCompilable
from varint.compiled.kernel import Kernel, build, emitted
from varint.compiled.mechanics import acceleration, dense, force, velocity
from varint.compiled.tableau import tableau_source
from varint.legendre import full_inertia
from varint.rules import Rule
from varint.system import System

FEW = 6  # so many coordinates stay in registers
_KNOWN: WeakKeyDictionary[System, dict[tuple[str, int], Kernel]] = WeakKeyDictionary()


def lanes_for(stages: int) -> tuple[int, int]:
    """Vector length for so many stages and the number of lanes of all vectors together."""
    lanes = vector_length()
    while lanes // 2 >= stages:
        lanes //= 2
    return lanes, -(-stages // lanes) * lanes


def gauss_form(system: System) -> int:
    """2: unknown accelerations (separable, constant mass); 1: unknown velocities and forces; 0: not possible."""
    s = system.structure
    if s.constraints or s.nonholonomic or s.contacts or s.degenerate or not s.quadratic_kinetic:
        return 0
    return 2 if s.separable and s.constant_mass else 1


def gauss_kernel(system: System, rule: Rule, form: int | None = None) -> Kernel:
    """The compiled fixed-point Gauss method of a regular scene without constraints.

    ``Q_i = q + h Σ a_ij V_j, P_i = p + h Σ a_ij F_j``; for separable scenes with constant mass in second-order form,
    ``Q_i = q + c_i h v + h² Σ (A²)_ij G_j`` with accelerations G, which converges twice as fast.

    Parameters
    ----------
    system : System
    rule : Rule
        From `gauss`.
    form : int, optional
        2 or 1 to choose the form; by default the scene decides.

    Returns
    -------
    Kernel

    Raises
    ------
    NotCompilable
        If the scene has constraints or contacts, or its momentum is not linear in the velocities.
    CompileError
        If there is no compiler or no safe cache folder.
    """
    form = gauss_form(system) if form is None else form
    if not form:
        raise NotCompilable(
            "the compiled Gauss method needs a regular scene without constraints, quadratic in velocities"
        )
    known = _KNOWN.setdefault(system, {})
    if (rule.name, form) not in known:
        known[rule.name, form] = _built(system, len(rule.nodes), form)
    return known[rule.name, form]


def _built(system: System, stages: int, form: int) -> Kernel:
    lanes, padded = lanes_for(stages)
    q, v, t = system.q, system.v, system.t
    p = ca.SX.sym("p", v.numel())
    right = _right_side(system, form, p)
    expressions = dict(right)
    if "rhs" in right:
        expressions["velocity"] = ([q, p, t], [velocity(system, p)])
    expressions["momentum"] = ([q, v, t], [system.momentum])
    functions = emitted(system.c, expressions, str(padded // lanes))
    on_velocity = int(form == 2 and system.structure.force_on_velocity)
    defines = {"LANES": lanes, "FORM": form, "ON_VELOCITY": on_velocity, "FEW": FEW, "STRIDE": padded // lanes}
    about = f"Gauss, {stages} stages in {padded // lanes} vector(s) of {lanes}, " + (
        "unknown accelerations" if form == 2 else "unknown velocities and forces"
    )
    if "rhs" not in right:
        defines["GEOMETRY"] = right["geometry"][1][0].numel()
    diagonals = q.numel() <= FEW and 4 * stages > 3 * padded
    data = _tableau(stages, lanes, diagonals) + _needs(q, right)
    loops = ("gauss.c",) if "rhs" in right else ("dense.c", "gauss.c")
    return build(about, system, stages, functions, defines, data, *loops)


def _right_side(system: System, form: int, p: ca.SX) -> dict[str, tuple[list[ca.SX], list[ca.SX]]]:
    """The functions of the right-hand side: "rhs" alone, or those of dense.c."""
    q, v, t, u = system.q, system.v, system.t, system.control
    if form == 2:
        return {"rhs": ([q, v, t, u], [acceleration(system)])}
    if full_inertia(system):
        return dense(system)
    speed = velocity(system, p)
    return {"rhs": ([q, p, t, u], [speed, ca.substitute(force(system), v, speed)])}


def _needs(q: ca.SX, right: dict[str, tuple[list[ca.SX], list[ca.SX]]]) -> str:
    """NEEDS_Q and NEEDS_P of gauss.c: does the right-hand side depend on q_i, does the momentum p_i change?"""
    rates = [ca.densify(x) for _, outputs in right.values() for x in outputs]
    needed = {"NEEDS_Q": ca.which_depends(ca.vertcat(*rates), q, 1, False)}
    needed["NEEDS_P"] = [not rate.is_zero() for rate in ca.vertsplit(rates[-1])]
    return "".join(
        f"static const char {name}[] __attribute__((unused)) = {{{', '.join(str(int(x)) for x in values)}}};\n"
        for name, values in needed.items()
    )


@lru_cache(maxsize=64)
def _tableau(stages: int, lanes: int, diagonals: bool) -> str:
    return tableau_source(stages, lanes, diagonals)

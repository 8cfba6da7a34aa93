"""Stage-parallel Gauss collocation: all stages of a step iterated at once in vector registers."""

from __future__ import annotations

from functools import lru_cache

import casadi as ca

from varint.codegen.cache import AS_WRITTEN, vector_length
from varint.codegen.emit import Emitted
from varint.codegen.graph import NotCompilable, kernel_per_system
from varint.codegen.kernel import Kernel, build, emit_functions, emit_halves
from varint.codegen.mechanics import acceleration, dense, force, velocity
from varint.codegen.tableau import tableau_source
from varint.discrete.legendre import full_inertia
from varint.rules.rule import Rule
from varint.scene.system import System

FEW = 6  # so many coordinates stay in registers
# vector operations of an evaluation up to which latency decides its time, not their number
SHORT = 60
PRODUCT = 10  # of a coordinate's stages with the coefficients


def lanes_for(stages: int) -> tuple[int, int]:
    """Vector length for so many stages and the number of lanes of all vectors together."""
    lanes = vector_length()
    while lanes // 2 >= stages:
        lanes //= 2
    return lanes, -(-stages // lanes) * lanes


def gauss_form(system: System) -> int:
    """2: unknown accelerations (separable, constant mass); 1: unknown velocities and forces; 0:
    not possible.
    """
    s = system.structure
    if s.constraints or s.nonholonomic or s.contacts or s.degenerate or not s.quadratic_kinetic:
        return 0
    return 2 if s.separable and s.constant_mass else 1


@kernel_per_system
def gauss_kernel(system: System, rule: Rule, form: int | None = None) -> Kernel:
    """The compiled fixed-point Gauss method of a regular scene without constraints.

    ``Q_i = q + h Σ a_ij V_j, P_i = p + h Σ a_ij F_j``; for separable scenes with constant mass in
    second-order form, ``Q_i = q + c_i h v + h² Σ (A²)_ij G_j`` with accelerations G, which
    converges twice as fast.

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
            "the compiled Gauss method needs a regular scene without constraints, quadratic in "
            "velocities"
        )
    return build_gauss(system, len(rule.nodes), form)


def build_gauss(system: System, stages: int, form: int) -> Kernel:
    lanes, padded = lanes_for(stages)
    stride = str(padded // lanes)
    full = form == 1 and full_inertia(system)
    make = _accelerations if form == 2 else _inertia_and_push if full else _kick_and_drift
    functions, rates = make(system, stride)
    needs = _needs(system.q, rates)
    ahead = not system.control.numel() and _work(functions, needs) <= SHORT
    functions |= emit_functions(
        system.c, {"momentum": ([system.q, system.v, system.t], [system.momentum])}
    )
    on_velocity = int(form == 2 and system.structure.force_on_velocity)
    defines = {
        "LANES": lanes,
        "FORM": form,
        "ON_VELOCITY": on_velocity,
        "FEW": FEW,
        "STRIDE": stride,
    }
    defines["AHEAD"] = int(ahead)
    if full:
        defines["GEOMETRY"] = dense(system)["geometry"][1][0].numel()
    about = f"Gauss, {stages} stages in {stride} vector(s) of {lanes}, " + (
        "unknown accelerations" if form == 2 else "unknown velocities and forces"
    )
    diagonals = system.q.numel() <= FEW and 4 * stages > 3 * padded
    data = _tableau(stages, lanes, diagonals) + "".join(
        f"static const char {name}[] __attribute__((unused)) = "
        f"{{{', '.join(str(int(x)) for x in values)}}};\n"
        for name, values in needs.items()
    )
    loops = ("dense.c", "gauss.c") if full else ("gauss.c",)
    return build(
        about, system, stages, functions, defines, data, *loops, contraction=AS_WRITTEN
    )


# of the right-hand side, and the expressions it is made of
Functions = tuple[dict[str, Emitted], list[ca.SX]]


def _accelerations(system: System, stride: str) -> Functions:
    """The right-hand side of form 2, "rhs", and "velocity" at a single point."""
    q, v, t, p = system.q, system.v, system.t, ca.SX.sym("p", system.q.numel())
    rates = [acceleration(system)]
    expressions = {
        "rhs": ([q, v, t, system.control], rates),
        "velocity": ([q, p, t], [velocity(system, p)]),
    }
    return emit_functions(system.c, expressions, stride), rates


def _inertia_and_push(system: System, stride: str) -> Functions:
    """The functions that dense.c makes the right-hand side and "velocity" of."""
    expressions = dense(system)
    return emit_functions(system.c, expressions, stride), [
        x for _, outputs in expressions.values() for x in outputs
    ]


def _kick_and_drift(system: System, stride: str) -> Functions:
    """The right-hand side in halves: "kick", the forces, then "drift", the velocities that the
    new momenta make.
    """
    q, t, p = system.q, system.t, ca.SX.sym("p", system.q.numel())
    speed = velocity(system, p)
    push = ca.substitute(force(system), system.v, speed)
    late = ca.SX.sym("p", p.numel())
    known = ca.vertcat(*(p[i] if push[i].is_zero() else late[i] for i in range(p.numel())))
    outputs = [push, ca.substitute(speed, p, known)]
    functions = emit_halves(
        system.c, ("kick", "drift"), [q, p, t, system.control], late, outputs, stride
    )
    return functions | emit_functions(system.c, {"velocity": ([q, p, t], [speed])}), [speed, push]


def _needs(q: ca.SX, rates: list[ca.SX]) -> dict[str, list[bool]]:
    """NEEDS_Q and NEEDS_P of gauss.c: does the right-hand side depend on q_i, does the momentum
    p_i change?
    """
    depends = ca.which_depends(ca.vertcat(*map(ca.densify, rates)), q, 1, False)
    return {
        "NEEDS_Q": depends,
        "NEEDS_P": [not rate.is_zero() for rate in ca.vertsplit(ca.densify(rates[-1]))],
    }


def _work(functions: dict[str, Emitted], needs: dict[str, list[bool]]) -> int:
    """Roughly the vector operations of an evaluation at the stages."""
    products = sum(needs["NEEDS_Q"]) + ("rhs" not in functions) * sum(needs["NEEDS_P"])
    return PRODUCT * products + sum(
        f.operations for name, f in functions.items() if name != "velocity"
    )


@lru_cache(maxsize=64)
def _tableau(stages: int, lanes: int, diagonals: bool) -> str:
    return tableau_source(stages, lanes, diagonals)

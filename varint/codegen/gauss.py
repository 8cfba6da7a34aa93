"""Stage-parallel Gauss collocation: all stages of a step iterated at once in vector registers."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from varint.codegen.arguments import c_source, c_table
from varint.codegen.cache import AS_WRITTEN, vector_length
from varint.codegen.graph import NotCompilable, kernel_per_system
from varint.codegen.kernel import Kernel
from varint.codegen.mechanics import acceleration, dense, force, momentum, velocity
from varint.codegen.routines import Routine, halved, routines
from varint.codegen.source import Source, c_head, compiled, emitted, source_of
from varint.codegen.tableau import tableau_source
from varint.discrete.composed import steps_by_gauss
from varint.discrete.legendre import (
    HALVINGS,
    first_order_velocity,
    full_inertia,
    known_velocity,
    legendre_expressions,
    mass_solve,
)
from varint.numerics.limits import LEGENDRE_ITERATIONS
from varint.rules.rule import Rule
from varint.scene.memory import per_scene
from varint.scene.structure import jumps
from varint.scene.system import System

FEW = 6  # so many coordinates stay in registers
# and so many where an evaluation has few operations: compiling takes half as long again
MORE, FEW_OPERATIONS = 8, 500
# vector operations of an evaluation up to which latency decides its time, not their number
SHORT = 60
DIRECTIONS = 2  # of an evaluation with a full inertia matrix
PRODUCT = 10  # of a coordinate's stages with the coefficients


def lanes_for(stages: int) -> tuple[int, int]:
    """Vector length for so many stages and the number of lanes of all vectors together."""
    lanes = vector_length()
    while lanes // 2 >= stages:
        lanes //= 2
    return lanes, -(-stages // lanes) * lanes


@per_scene
def gauss_form(system: System) -> int:
    """2: unknown accelerations (separable, constant mass); 1: unknown velocities and forces; 0:
    not possible.
    """
    s = system.structure
    if s.constraints or s.nonholonomic or s.contacts:
        return 0
    if s.degenerate:
        return int(steps_by_gauss(system))
    if not s.quadratic_kinetic and (jumps(system.momentum, system.v) or full_inertia(system)):
        return 0
    return 2 if s.separable and s.constant_mass else 1


@dataclass(frozen=True, eq=False)
class Scheme:
    """What the loop of c/gauss.h needs of a scene and a number of stages, as C or as data.

    Attributes
    ----------
    form : int
        2: unknown accelerations; 1: unknown velocities and forces.
    lanes, padded : int
        Length of a vector; lanes of all vectors of a coordinate's stages.
    functions : dict of Routine
        The right-hand side first: "rhs"; or "kick" and "drift", and "inertia" where velocities are
        improved; or those of c/dense.c; then "velocity" or "legendre", and "momentum".
    needs : dict
        NEEDS_Q and NEEDS_P: does the right-hand side depend on q_i, does the momentum p_i change?
    geometry : int
        Numbers that the functions of c/dense.c share; 0 where it is not needed.
    few : int
        Up to so many coordinates stay in registers.
    diagonals, on_velocity, ahead : bool
        How products with the tableau are arranged; whether forces depend on v; whether the next
        step is begun while this one is iterated.
    by_defect : bool
        Whether velocities are improved by what their momenta miss.
    legendre_iterations : int
        Of Newton's method for velocities at a node; 0 where they have a formula.
    work : int
        Roughly the vector operations of an evaluation at the stages.
    """

    form: int
    stages: int
    lanes: int
    padded: int
    functions: dict[str, Routine]
    needs: dict[str, list[bool]]
    geometry: int
    few: int
    diagonals: bool
    on_velocity: bool
    ahead: bool
    by_defect: bool
    legendre_iterations: int
    work: int

    @property
    def vectors(self) -> int:
        return self.padded // self.lanes

    @property
    def about(self) -> str:
        return f"Gauss, {self.stages} stages in {self.vectors} vector(s) of {self.lanes}, " + (
            "unknown accelerations" if self.form == 2 else "unknown velocities and forces"
        )


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
    return compiled(gauss_source(system, rule, form))


@kernel_per_system
def gauss_source(system: System, rule: Rule, form: int | None = None) -> Source:
    """The C source of `gauss_kernel`."""
    scheme = gauss_scheme(system, len(rule.nodes), form)
    sizes = {
        "LANES": scheme.lanes,
        "FORM": scheme.form,
        "ON_VELOCITY": int(scheme.on_velocity),
        "FEW": scheme.few,
        "STRIDE": scheme.vectors,
        "AHEAD": int(scheme.ahead),
        "BY_DEFECT": int(scheme.by_defect),
        "LEGENDRE_ITERATIONS": scheme.legendre_iterations,
        "DENSE": int(scheme.geometry > 0),
    }
    # the loop is that of all scenes of a size, compiled once; these are the scene's own
    own = {
        "HALVINGS": HALVINGS,
        "TAKEN": numbers_taken(scheme),
        "GEOMETRY": scheme.geometry,
        "EVALUATION": scheme.work,
    }
    tableau = tableau_source(scheme.stages, scheme.lanes, scheme.diagonals)
    needs = "".join(c_table("char", x, map(str, map(int, y))) for x, y in scheme.needs.items())
    loops = ("dense.c", "gauss_scene.c") if scheme.geometry else ("gauss_scene.c",)
    functions = emitted(scheme.functions, str(scheme.vectors))
    many = {"N": system.q.numel(), "NU": system.control.numel(), "SCENE_APART": 1}
    apart = c_head(many | sizes, tableau) + "".join(
        map(c_source, ("gauss.h", "gauss_loop.c", "parts.c", "within_steps.c"))
    )
    return source_of(
        scheme.about,
        system,
        scheme.stages,
        functions,
        sizes | own,
        tableau + needs,
        *loops,
        contraction=AS_WRITTEN,
        apart=apart,
    )


def gauss_scheme(system: System, stages: int, form: int | None = None) -> Scheme:
    """What the Gauss method with so many stages needs of a scene; raises NotCompilable."""
    return _scheme_of(system, stages, gauss_form(system) if form is None else form)


@per_scene
def _scheme_of(system: System, stages: int, form: int) -> Scheme:
    if not form:
        raise NotCompilable(
            "the compiled Gauss method needs a regular scene without constraints, whose momentum "
            "has no jumps"
        )
    lanes, padded = lanes_for(stages)
    full = form == 1 and full_inertia(system)
    quadratic = system.structure.quadratic_kinetic
    by_defect = form == 1 and (not quadratic or known_velocity(system, system.v) is not None)
    make = (
        _accelerations
        if form == 2
        else _inertia_and_push
        if full
        else _push_and_defect
        if by_defect
        else _first_order
        if system.structure.degenerate
        else _kick_and_drift
    )
    functions, rates = make(system)
    needs = _needs(system.q, rates)
    work = _work(functions, needs)
    ahead = not by_defect and not system.control.numel() and work <= SHORT
    if full:  # every direction of conjugate gradients takes a product and two triangles
        each = functions["product"].sizes.operations + system.q.numel() ** 2
        work += DIRECTIONS * each
    few = MORE if work <= FEW_OPERATIONS and not full else FEW
    functions |= routines(
        system.c, {"momentum": ([system.q, system.v, system.t], [momentum(system)])}
    )
    return Scheme(
        form,
        stages,
        lanes,
        padded,
        functions,
        needs,
        dense(system)["geometry"][1][0].numel() if full else 0,
        few,
        system.q.numel() <= few and 4 * stages > 3 * padded,
        form == 2 and system.structure.force_on_velocity,
        ahead,
        by_defect,
        0 if quadratic else LEGENDRE_ITERATIONS,
        max(work, 1),
    )


# of the right-hand side, and the expressions it is made of
Functions = tuple[dict[str, Routine], list[ca.SX]]


def _accelerations(system: System) -> Functions:
    """The right-hand side of form 2, "rhs", and "velocity" at a single point."""
    q, v, t, p = system.q, system.v, system.t, ca.SX.sym("p", system.q.numel())
    rates = [acceleration(system)]
    expressions = {
        "rhs": ([q, v, t, system.control], rates),
        "velocity": ([q, p, t], [velocity(system, p)]),
    }
    return routines(system.c, expressions), rates


def _inertia_and_push(system: System) -> Functions:
    """The functions that dense.c makes the right-hand side and "velocity" of."""
    expressions = dense(system)
    return routines(system.c, expressions), [
        x for _, outputs in expressions.values() for x in outputs
    ]


def _kick_and_drift(system: System) -> Functions:
    """The right-hand side in halves: "kick", the forces, then "drift", the velocities that the
    new momenta make.
    """
    q, t, p = system.q, system.t, ca.SX.sym("p", system.q.numel())
    speed = velocity(system, p)
    push = ca.substitute(force(system), system.v, speed)
    late = ca.SX.sym("p", p.numel())
    known = ca.vertcat(*(p[i] if push[i].is_zero() else late[i] for i in range(p.numel())))
    outputs = [push, ca.substitute(speed, p, known)]
    functions = halved(system.c, ("kick", "drift"), [q, p, t, system.control], late, outputs)
    return functions | routines(system.c, {"velocity": ([q, p, t], [speed])}), [speed, push]


def _first_order(system: System) -> Functions:
    """The right-hand side of a degenerate scene, q̇ = v(q, t), and the gain A q̇ of its momentum
    A q + b.
    """
    q, t, p = system.q, system.t, ca.SX.sym("p", system.q.numel())
    speed = first_order_velocity(system)
    assert speed is not None
    gain = ca.densify(ca.jacobian(system.momentum, q) @ speed)
    late = ca.SX.sym("p", p.numel())
    functions = halved(system.c, ("kick", "drift"), [q, p, t, system.control], late, [gain, speed])
    return functions | routines(system.c, {"velocity": ([q, p, t], [speed])}), [speed, gain]


def _push_and_defect(system: System) -> Functions:
    """The right-hand side for velocities that are improved: "kick", forces and momenta of given
    velocities; "drift", the velocities that belong to momenta that are missed, of what "inertia"
    says of a place and of velocities there, on which it depends where L is not quadratic in them.
    """
    q, v, t, p = system.q, system.v, system.t, ca.SX.sym("p", system.q.numel())
    missed, quadratic = ca.SX.sym("missed", p.numel()), system.structure.quadratic_kinetic
    outputs = [force(system), momentum(system)]
    if quadratic:
        speed = velocity(system, p)
        gained, at_nodes = ca.jtimes(speed, p, missed), {"velocity": ([q, p, t], [speed])}
    else:
        gained = mass_solve(system.mass_matrix, missed)
        at_nodes = {"legendre": legendre_expressions(system)}
    functions = routines(system.c, {"kick": ([q, v, t, system.control], outputs)})
    placed = halved(system.c, ("inertia", "drift"), [q, v, t], missed, [gained])
    functions |= {name: placed[name] for name in ("drift", "inertia")}
    functions |= routines(system.c, at_nodes)
    return functions, [gained, *outputs[::-1]]


def numbers_taken(scheme: Scheme) -> int:
    """How many numbers "drift" takes from what was evaluated before it."""
    before = scheme.functions.get("inertia" if scheme.by_defect else "kick")
    return len(before.graph.outputs[-1]) if before else 0


def _needs(q: ca.SX, rates: list[ca.SX]) -> dict[str, list[bool]]:
    """NEEDS_Q and NEEDS_P of gauss.h."""
    depends = ca.which_depends(ca.vertcat(*map(ca.densify, rates)), q, 1, False)
    return {
        "NEEDS_Q": depends,
        "NEEDS_P": [not rate.is_zero() for rate in ca.vertsplit(ca.densify(rates[-1]))],
    }


def _work(functions: dict[str, Routine], needs: dict[str, list[bool]]) -> int:
    """Roughly the vector operations of an evaluation at the stages."""
    products = sum(needs["NEEDS_Q"]) + ("rhs" not in functions) * sum(needs["NEEDS_P"])
    return PRODUCT * products + sum(
        f.sizes.operations for name, f in functions.items() if name not in ("velocity", "legendre")
    )

"""Which loop in C takes the flights of a scene with contacts, and the contacts as data for it."""

from __future__ import annotations

from functools import partial

import casadi as ca

from varint.codegen.cache import CompileError
from varint.codegen.contacts import ContactData, contact_data
from varint.codegen.graph import NotCompilable, kernel_per_system
from varint.codegen.kernel import Kernel
from varint.codegen.uniform import native_uniform
from varint.discrete.constraints import ActiveSet, velocity_rows
from varint.discrete.tolerances import RESIDUAL_LIMIT
from varint.errors import InputError
from varint.integration.backend import require_backend
from varint.integration.events.contacts import NEAR
from varint.integration.events.enclosures import (
    PATH_ERROR,
    gap_enclosure_function,
    gap_floor_function,
)
from varint.integration.events.flights import Flights
from varint.integration.events.gaps import HALVINGS, MOST_LOOKS, NEWTON
from varint.integration.events.impacts import (
    DEPENDENT,
    FLAT,
    MOST_IMPACTS,
    PULL,
    RESTING,
    RESTLESS,
    TOUCH,
    ZENO,
)
from varint.integration.events.roots import LOCATED
from varint.integration.gears import compiled_kernel, gears_of, kernel_now, newton
from varint.integration.problem import InitialValueProblem
from varint.integration.steppers.uniform_field import is_uniform
from varint.numerics.limits import GAP_ITERATIONS, ROOT_ITERATIONS
from varint.rules.rule import Rule
from varint.scene.system import System

NUMBERS = {
    "MOST_LOOKS": MOST_LOOKS,
    "NEWTON": NEWTON,
    "GAP_ITERATIONS": GAP_ITERATIONS,
    "ROOT_ITERATIONS": ROOT_ITERATIONS,
    "MOST_IMPACTS": MOST_IMPACTS,
    "RESTLESS": RESTLESS,
    "TOUCH": TOUCH,
    "RESTING": RESTING,
    "PULL": PULL,
    "ZENO": ZENO,
    "LOCATED": LOCATED,
    "NEAR": NEAR,
    "DEPENDENT": DEPENDENT,
    "FLAT": FLAT,
    "RESIDUAL_LIMIT": RESIDUAL_LIMIT,
    "SHORTEST": 0.5**HALVINGS,
    "PATH_ERROR": PATH_ERROR,
}


def flies(system: System) -> bool:
    """Whether impulses change velocities by M⁻¹, and nothing is told from outside."""
    s = system.structure
    apart = s.controls or s.degenerate or system.rays
    return bool(s.contacts and s.quadratic_kinetic and not apart)


@kernel_per_system
def contacts_as_data(system: System) -> ContactData:
    """The gaps, their bounds along steps, and what an impact needs; raises NotCompilable."""
    s, n = system, system.structure.n
    gap = ca.densify(s.contact)
    rate = ca.densify(ca.jtimes(gap, s.q, s.v) + ca.jacobian(gap, s.t))
    rows = ca.vertcat(velocity_rows(s), rate)  # W v + w of all that may hold
    slope = ca.densify(ca.jacobian(rows, s.v))
    bend = ca.densify(ca.jtimes(rows, s.q, s.v) + ca.jacobian(rows, s.t))
    carried = ca.jtimes(s.momentum, s.q, s.v) + ca.jacobian(s.momentum, s.t)
    push = ca.densify(s.generalised_force - carried)
    ends = [ca.SX.sym(name, n) for name in ("q0", "v0", "q1", "v1")]
    piece = [*ends, ca.SX.sym("t"), ca.SX.sym("w")]
    low, _, rate_low, rate_high, bend_low, _ = gap_enclosure_function(s)(*piece, ca.SX(0, 1), s.c)
    box = [ca.SX.sym("least", n), ca.SX.sym("most", n), ca.SX.sym("begin"), ca.SX.sym("end")]
    state = [s.q, s.v, s.t]
    mass, energy = ca.vec(ca.densify(s.mass_matrix)), ca.densify(s.energy)
    blow = [ca.vec(slope.T), mass, push, bend, energy, s.bounce]
    functions = {
        "gaps": (state, [gap, rate]),
        "bounds": (piece, [low, rate_low, rate_high, bend_low]),
        "blow": (state, blow),
        "floors": (box, [gap_floor_function(s)(*box, s.c)]),
    }
    return contact_data(n, rows.numel(), gap.numel(), s.c, functions, **NUMBERS)


def flights_for(
    system: System, rule: Rule, problem: InitialValueProblem, backend: str
) -> Flights | None:
    """The loop in C for the flights of a run; None where there is none, or none is wanted.

    Raises
    ------
    InputError
        If there is no such backend.
    NotCompilable, CompileError
        If ``"compiled"`` or ``"native"`` is asked for and impossible.
    """
    require_backend(backend)
    asked = backend in ("compiled", "native")
    if not (flies(system) and problem.h > 0):
        if asked:
            raise InputError(
                "runs with contacts are interpreted where controls drive bodies, rays are "
                "coordinates, or time runs backwards; "
                f"backend={backend!r} is not for them"
            )
        return None
    if backend == "interpreted":
        return None
    try:
        begin = problem.active_set or ActiveSet(tuple(range(system.structure.constraints)))
        if _loop_of(begin.scene(system), rule, backend) is None:
            return None
        return Flights(partial(_loop_in, system, rule, backend), contacts_as_data(system))
    except (NotCompilable, CompileError):
        if asked:
            raise
    return None


def _loop_in(system: System, rule: Rule, backend: str, active_set: ActiveSet) -> Kernel | None:
    """The loop of the scene in an active set, where it has one."""
    try:
        return _loop_of(active_set.scene(system), rule, backend)
    except (NotCompilable, CompileError):
        return None


def _loop_of(system: System, rule: Rule, backend: str) -> Kernel | None:
    """Newton's method, whose rounding errors outlive impacts; nothing is solved in uniform
    fields.
    """
    if is_uniform(system):
        return native_uniform(system)
    if backend == "native":
        return newton().native(system, rule)
    if backend == "compiled":
        return compiled_kernel(system, rule, newton())
    gears = gears_of(system, rule, newton())
    return kernel_now(gears) if gears else None

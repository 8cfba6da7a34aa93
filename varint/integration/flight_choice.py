"""Which loop in C takes the flights of a scene with contacts, and the contacts as data for it."""

from __future__ import annotations

import casadi as ca
import numpy as np

from varint.codegen.cache import CompileError
from varint.codegen.contacts import ContactData, contact_data
from varint.codegen.graph import NotCompilable, kernel_per_system
from varint.codegen.kernel import Kernel
from varint.codegen.uniform import native_uniform
from varint.discrete.constraints import ActiveSet
from varint.discrete.tolerances import RESIDUAL_LIMIT
from varint.errors import InputError
from varint.integration.backend import kernel_for, require_backend
from varint.integration.events.contacts import NEAR
from varint.integration.events.enclosures import gap_enclosure_function
from varint.integration.events.flights import Flights
from varint.integration.events.gaps import HALVINGS, MOST_LOOKS, NEWTON
from varint.integration.events.impacts import FLAT, MOST_IMPACTS, RESTING, TOUCH, ZENO
from varint.integration.events.roots import LOCATED
from varint.integration.problem import InitialValueProblem
from varint.integration.steppers.uniform_field import is_uniform
from varint.numerics.limits import GAP_ITERATIONS
from varint.rules.rule import Rule
from varint.scene.system import System

NUMBERS = {
    "MOST_LOOKS": MOST_LOOKS,
    "NEWTON": NEWTON,
    "GAP_ITERATIONS": GAP_ITERATIONS,
    "MOST_IMPACTS": MOST_IMPACTS,
    "TOUCH": TOUCH,
    "RESTING": RESTING,
    "ZENO": ZENO,
    "LOCATED": LOCATED,
    "NEAR": NEAR,
    "FLAT": FLAT,
    "RESIDUAL_LIMIT": RESIDUAL_LIMIT,
    "SHORTEST": 0.5**HALVINGS,
}


def flies(system: System) -> bool:
    """Whether bodies fly free between impacts: nothing else holds them, and impulses change
    velocities by M⁻¹.
    """
    s = system.structure
    held = s.constraints or s.nonholonomic or s.controls or system.rays
    return bool(s.contacts and s.quadratic_kinetic and not s.degenerate and not held)


@kernel_per_system
def contacts_as_data(system: System) -> ContactData:
    """The gaps, their bounds along steps, and what an impact needs; raises NotCompilable."""
    s, n = system, system.structure.n
    gap = ca.densify(s.contact)
    slope = ca.densify(ca.jacobian(gap, s.q))
    rate = ca.densify(ca.mtimes(slope, s.v) + ca.jacobian(gap, s.t))
    bend = ca.densify(ca.jtimes(rate, s.q, s.v) + ca.jacobian(rate, s.t))
    carried = ca.jtimes(s.momentum, s.q, s.v) + ca.jacobian(s.momentum, s.t)
    push = ca.densify(ca.gradient(s.lagrangian, s.q) + s.force - carried)
    ends = [ca.SX.sym(name, n) for name in ("q0", "v0", "q1", "v1")]
    piece = [*ends, ca.SX.sym("t"), ca.SX.sym("w")]
    low, _, rate_low, rate_high, bend_low, _ = gap_enclosure_function(s)(*piece, ca.SX(0, 1), s.c)
    state = [s.q, s.v, s.t]
    blow = [ca.vec(slope.T), ca.vec(ca.densify(s.mass_matrix)), push, bend, ca.densify(s.energy)]
    functions = {
        "gaps": (state, [gap, rate]),
        "bounds": (piece, [low, rate_low, rate_high, bend_low]),
        "blow": (state, blow),
    }
    return contact_data(n, np.array(s.restitution, dtype=float), s.c, functions, **NUMBERS)


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
    asked = backend in ("compiled", "native")
    if not (flies(system) and problem.h > 0):
        if asked:
            raise InputError(
                "runs with contacts are interpreted where bodies are held, driven by controls, "
                f"have momenta that are not linear in v, or go backwards; backend={backend!r} is "
                "not for them"
            )
        require_backend(backend)
        return None
    try:
        kernel = _loop_of(ActiveSet(()).scene(system), rule, problem, backend)
        return None if kernel is None else Flights(kernel, contacts_as_data(system))
    except (NotCompilable, CompileError):
        if asked:
            raise
    return None


def _loop_of(
    system: System, rule: Rule, problem: InitialValueProblem, backend: str
) -> Kernel | None:
    """The loop of the scene that flies."""
    if is_uniform(system) and backend in ("auto", "native", "compiled"):
        return native_uniform(system)
    return kernel_for(system, rule, problem, backend)

"""Flights in a uniform field, in C."""

from __future__ import annotations

import casadi as ca

from varint.codegen.block import block_of
from varint.codegen.core import uniform_loop
from varint.codegen.graph import kernel_per_system
from varint.codegen.kernel import Kernel
from varint.codegen.mechanics import force, velocity
from varint.codegen.native import kernel_on, tapes_of
from varint.codegen.routines import routines
from varint.discrete.legendre import mass_solve
from varint.scene.system import System


@kernel_per_system
def native_uniform(system: System) -> Kernel:
    """The kernel of q1 = q0 + h M⁻¹(p0 + ½ h F), p1 = p0 + h F, both compensated; raises as
    `native_gauss` does.
    """
    n = system.q.numel()
    p, x, push = ca.SX.sym("p", n), ca.SX.sym("x", n), force(system)
    functions = {
        "speed": ([p], [velocity(system, p)]),
        "solved": ([x], [mass_solve(system.mass_matrix, x)]),
        "field": ([], [push, mass_solve(system.mass_matrix, push)]),
    }
    tapes = tapes_of(routines(system.c, functions)).values()
    heads = "flight in a uniform field", n, 0, 1, 10 * n
    return kernel_on(heads, uniform_loop(), block_of([n, *tapes]))

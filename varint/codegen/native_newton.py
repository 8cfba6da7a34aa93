"""Newton's method with nothing compiled for the scene."""

from __future__ import annotations

from dataclasses import replace

from varint.codegen.block import block_of
from varint.codegen.core import newton_loop
from varint.codegen.frozen import no_whole_derivatives
from varint.codegen.graph import kernel_per_system
from varint.codegen.kernel import Kernel
from varint.codegen.native import (
    MOST_OF_MACHINES,
    MOST_OPERATIONS,
    kernel_on,
    members_by_name,
    tapes_of,
)
from varint.codegen.newton import newton_routines, newton_scheme
from varint.rules.rule import Rule
from varint.scene.system import System


@kernel_per_system
def native_newton(system: System, rule: Rule) -> Kernel:
    """The kernel of `newton_kernel` with the scene as data; raises as `native_gauss` does."""
    x = newton_scheme(system, rule)
    functions = newton_routines(system, rule)
    tapes = tapes_of(
        functions, MOST_OF_MACHINES if no_whole_derivatives(system) else MOST_OPERATIONS
    )
    members = members_by_name("newton_scene.h", x.counts | x.limits, x.places, x.tables, tapes)
    first = next(iter(functions.values()))
    heads = x.about, system.q.numel(), system.control.numel(), len(rule.nodes)
    kernel = kernel_on((*heads, first.sizes.operations), newton_loop(), block_of(members))
    return replace(kernel, opening=x.opening, rows=x.rows)

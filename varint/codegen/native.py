"""Kernels with nothing compiled for the scene: its operations are data that a loop, built once,
carries out.

They give the same bytes as the compiled kernels of the same schemes in two to five times the time.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from functools import cache

import numpy as np

from varint.codegen.arguments import c_source
from varint.codegen.block import Member, block_of, start_of
from varint.codegen.core import Loop, dense_loop, explicit_loop, gauss_loop
from varint.codegen.explicit import LOOPS_FROM, about, explicit_functions, sequence
from varint.codegen.gauss import gauss_scheme
from varint.codegen.graph import NotCompilable, kernel_per_system
from varint.codegen.kernel import Kernel
from varint.codegen.routines import Routine
from varint.codegen.source import FEW_ROOTS
from varint.codegen.tableau import tableau_arrays
from varint.codegen.tape import NOTHING_TO_DO, Tape
from varint.discrete.legendre import HALVINGS
from varint.rules.rule import Rule
from varint.scene.system import System

MOST_COORDINATES, MOST_CONTROLS = 256, 64  # MOST_N and MOST_NU of c/scene.h
MOST_OPERATIONS = 60_000  # of a scene: more are worth the compiler's time
MOST_OF_MACHINES = 250_000  # of a machine of many links, which takes the compiler minutes
TOO_LARGE = "the scene is too large to be run as data; use backend='compiled'"


@kernel_per_system
def native_gauss(system: System, rule: Rule) -> Kernel:
    """The kernel of `gauss_kernel` with the scene as data.

    Raises
    ------
    NotCompilable
        If the scene has no such kernel, or is too large for it.
    CompileError
        If the loop was not built with the package and cannot be compiled.
    """
    x = gauss_scheme(system, len(rule.nodes))
    n, controls = system.q.numel(), system.control.numel()
    if n > MOST_COORDINATES or controls > MOST_CONTROLS:
        raise NotCompilable(TOO_LARGE)
    tapes = tapes_of(x.functions, MOST_OF_MACHINES if x.by_defect else MOST_OPERATIONS)
    names = ("rhs" if x.form == 2 else "kick", "drift", "inertia")
    if x.geometry:
        names = ("geometry", "product", "push")
    at_nodes = "legendre" if x.legendre_iterations else "velocity", "momentum"
    ordered = [tapes.get(name, NOTHING_TO_DO) for name in (*names, *at_nodes)]
    tables = list(tableau_arrays(x.stages, x.lanes, x.diagonals).values())
    needs = (np.array(needed, np.int8) for needed in x.needs.values())
    counts = (
        n,
        controls,
        x.stages,
        int(x.diagonals),
        int(x.on_velocity),
        int(x.ahead),
        int(x.by_defect),
        x.legendre_iterations,
        HALVINGS,
        x.work,
        x.geometry,
    )
    block = block_of([*counts, *needs, tables, *ordered])
    first = next(iter(x.functions.values()))
    heads = x.about, n, controls, x.stages, first.sizes.operations
    loop = dense_loop(x.lanes, x.vectors) if x.geometry else gauss_loop(x.lanes, x.vectors, x.form)
    return kernel_on(heads, loop, block)


@kernel_per_system
def native_explicit(system: System, rule: Rule) -> Kernel:
    """The kernel of `explicit_kernel` with the scene as data; raises as `native_gauss` does."""
    functions = explicit_functions(system, rule)
    size = sum(f.sizes.nodes for f in functions.values())
    if size > LOOPS_FROM:  # long sums are added up in another order there
        raise NotCompilable(TOO_LARGE)
    n, controls, kicks = system.q.numel(), system.control.numel(), len(rule.kicks)
    members = [n, controls, kicks, *map(np.array, sequence(rule))]
    block = block_of([*members, *tapes_of(functions).values()])
    work = next(f.sizes.operations for f in functions.values())
    return kernel_on((about(rule), n, controls, kicks, work), explicit_loop(), block)


def tapes_of(functions: Mapping[str, Routine], most: int = MOST_OPERATIONS) -> dict[str, Tape]:
    """The functions as tapes; their square roots are those of the compiled kernel."""
    found = functions.values()
    # there are not more operations than nodes, which need not be counted
    if sum(f.nodes for f in found) > most and sum(f.sizes.operations for f in found) > most:
        raise NotCompilable(TOO_LARGE)
    few = {name: f.tape(False) for name, f in functions.items()}
    if sum(tape.sizes.roots for tape in few.values()) <= FEW_ROOTS:
        return few
    return {name: f.tape(True) for name, f in functions.items()}


def kernel_on(heads: tuple[str, int, int, int, int], loop: Loop, block: np.ndarray) -> Kernel:
    """The kernel that begins with these fields and runs a loop on a scene."""
    at = start_of(block)
    size, within_steps = loop.carry_size(at), loop.within_steps
    entries = loop.run, loop.parts, size
    return Kernel(*heads, *entries, None, at, block, within_steps=within_steps)


def members_by_name(
    file: str,
    numbers: Mapping[str, float],
    places: Mapping[str, np.ndarray],
    tables: Mapping[str, np.ndarray],
    tapes: Mapping[str, Tape],
) -> list[Member]:
    """The members of the structure Scene of a C file, in the order of its lists; functions that
    are not there do nothing.
    """
    names = _member_names(file)
    return [
        *(int(numbers[name]) for name in names["COUNTS"]),
        *(float(numbers[name]) for name in names["LIMITS"]),
        *(places[name].astype(np.int32) for name in names.get("PLACES", [])),
        *(tables[name].astype(float) for name in names["TABLES"]),
        *(tapes.get(name, NOTHING_TO_DO) for name in names["FUNCTIONS"]),
    ]


@cache
def _member_names(file: str) -> dict[str, list[str]]:
    """The lists of members in a C file, kind by kind."""
    text = c_source(file).replace("\\\n", "")
    found = re.findall(r"#define (\w+)\(DO\) (.*)", text)
    return {kind: re.findall(r"DO\((\w+)\)", names) for kind, names in found}

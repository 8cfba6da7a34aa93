"""Which loops take the derivatives of a scene's steps: those of the native core, compiled ones, or
CasADi's own.
"""

from __future__ import annotations

import warnings
from contextlib import suppress
from typing import TYPE_CHECKING

from varint.discrete.composed import base_of
from varint.discrete.step_map import step_map
from varint.errors import InputError
from varint.integration.backend import BACKENDS
from varint.rules.rule import Rule
from varint.scene.memory import per_system
from varint.scene.system import System
from varint.sensitivities.linear_steps import operations
from varint.sensitivities.steps_at_once import Sweeper

if TYPE_CHECKING:
    from varint.codegen.sweep import Sweep, SweepKernel

INSTRUCTION = 8e-9  # seconds of CasADi's virtual machine for an operation
CALL = 5e-5  # seconds of it for a step besides
ARRANGING, ARRANGED = 0.02, 6e-5  # seconds to arrange a scene's operations, and for one of them
SWEEPS = 5  # that are expected of one scene, when it is decided whether to arrange it
STARTING, STATEMENT = 0.25, 1e-4  # seconds to compile loops, and for a statement of them
REPAID = 4  # steps a number of unknowns whose full matrices are made
STAGES_STARTING, STAGES_STATEMENT = 1.0, 7e-4  # the same where all stages go at once


def sweeper(
    system: System, rule: Rule, steps: int, backend: str, density: str | None = None
) -> Sweeper:
    """The native core's loops, for which nothing is compiled, and which compiled ones with the same
    digits take over in time; CasADi's own for the shortest runs.

    Raises
    ------
    InputError
        If there is no such backend.
    NotCompilable, CompileError
        If ``"compiled"`` or ``"native"`` is asked for and impossible.
    """
    if backend not in BACKENDS:
        raise InputError(f"unknown backend {backend!r}; known: {list(BACKENDS)}")
    if backend == "interpreted" or base_of(system, rule):  # no loop solves a step in parts
        return Sweeper(system, rule, density)
    from varint.codegen.cache import CompileError
    from varint.codegen.graph import NotCompilable

    which = system, rule, density, _by_one_map(system, rule, steps)
    if backend == "native":
        return Sweeper(system, rule, density, _native(*which), native=True)
    if backend == "auto" and is_built() and _worth_arranging(system, rule, steps):
        with suppress(CompileError, NotCompilable):  # then as where the core was not built
            return Sweeper(system, rule, density, _in_gear(*which), native=True)
    if backend == "compiled" or _repays(system, rule, steps):
        try:
            return Sweeper(system, rule, density, _kernels(*which))
        except (CompileError, NotCompilable) as error:
            if backend == "compiled":
                raise
            if isinstance(error, CompileError):
                warnings.warn(f"{str(error).splitlines()[0]}; slower until then", stacklevel=4)
    return Sweeper(system, rule, density)


def _by_one_map(system: System, rule: Rule, steps: int) -> bool:
    """Whether the steps are affine maps, and enough of them to repay the matrices of these."""
    from varint.codegen.sweep_linear import has_linear_sweep

    return has_linear_sweep(system, rule) and steps >= REPAID * step_map(system, rule).y.numel()


def is_built() -> bool:
    """Whether the native core came with the package."""
    from varint.codegen.built import built_library

    return built_library() is not None


@per_system
def _kernels(
    system: System, rule: Rule, density: str | None, one_map: bool
) -> tuple[SweepKernel, ...]:
    """Where stages are iterated the factors of a step's equations are not built at once: only a
    stiff scene needs them.
    """
    from varint.codegen.sweep import sweep_kernel
    from varint.codegen.sweep_explicit import explicit_sweep_kernel, has_explicit_sweep
    from varint.codegen.sweep_gauss import has_stage_sweep, stage_sweep_kernel
    from varint.codegen.sweep_linear import linear_sweep_kernel

    if one_map:
        return (linear_sweep_kernel(system, rule, density),)
    if has_stage_sweep(system, rule):
        return (stage_sweep_kernel(system, rule, density),)
    if has_explicit_sweep(system, rule):
        return (explicit_sweep_kernel(system, rule, density),)
    return (sweep_kernel(system, rule, density),)


@per_system
def _native(
    system: System, rule: Rule, density: str | None, one_map: bool
) -> tuple[SweepKernel, ...]:
    """`_kernels` with the scene as data."""
    from varint.codegen.native_sweep import (
        native_explicit_sweep,
        native_linear_sweep,
        native_stage_sweep,
        native_sweep,
    )
    from varint.codegen.sweep_explicit import has_explicit_sweep
    from varint.codegen.sweep_gauss import has_stage_sweep

    if one_map:
        return (native_linear_sweep(system, rule, density),)
    if has_stage_sweep(system, rule):
        return (native_stage_sweep(system, rule, density),)
    if has_explicit_sweep(system, rule):
        return (native_explicit_sweep(system, rule, density),)
    return (native_sweep(system, rule, density),)


@per_system
def _in_gear(
    system: System, rule: Rule, density: str | None, one_map: bool
) -> tuple[SweepKernel, ...]:
    """`_native` that gives way to `_kernels` in time."""
    from varint.codegen.sweep import ONE_BY_ONE, sweep_scheme, sweep_source
    from varint.codegen.sweep_explicit import (
        explicit_sweep_scheme,
        has_explicit_sweep,
        steps_at_once,
    )
    from varint.codegen.sweep_gauss import has_stage_sweep, shape_for, stage_sweep_scheme
    from varint.codegen.sweep_linear import linear_sweep_scheme
    from varint.sensitivities.shifting import SweepGears, shifting

    by_stages = has_stage_sweep(system, rule)

    def source() -> str:
        if one_map:
            scheme = linear_sweep_scheme(system, rule, density)
            return sweep_source(scheme, steps_at_once(), "sweep_linear.c")
        if has_explicit_sweep(system, rule):
            scheme = explicit_sweep_scheme(system, rule, density)
            return sweep_source(scheme, steps_at_once(), "sweep_explicit.c")
        if by_stages:
            scheme = stage_sweep_scheme(system, rule, density)
            return sweep_source(scheme, shape_for(len(rule.nodes)), "sweep_gauss.c")
        return sweep_source(sweep_scheme(system, rule, density), ONE_BY_ONE, "sweep.c")

    def compiled() -> SweepKernel:
        return _kernels(system, rule, density, one_map)[0]

    low = _native(system, rule, density, one_map)[0]
    if by_stages:
        functions = stage_sweep_scheme(system, rule, density).functions.values()
        expected = STAGES_STARTING + STAGES_STATEMENT * sum(f.sizes.nodes for f in functions)
    else:
        expected = STARTING + STATEMENT * operations(system, rule)[1]
    return (shifting(SweepGears(low, source, compiled, expected)),)


def _worth_arranging(system: System, rule: Rule, steps: int) -> bool:
    """Whether the steps take CasADi longer than arranging the operations for the native core: by
    stages always, for there CasADi has the whole step to differentiate and the core its rates.
    """
    from varint.codegen.sweep_gauss import has_stage_sweep

    if has_stage_sweep(system, rule):
        return True
    turn, statements = operations(system, rule)
    return SWEEPS * steps * (CALL + INSTRUCTION * turn) > ARRANGING + ARRANGED * statements


def _repays(system: System, rule: Rule, steps: int) -> bool:
    """Whether the steps take CasADi longer than the compiler needs for their loops."""
    turn, statements = operations(system, rule)
    return steps * (CALL + INSTRUCTION * turn) > STARTING + STATEMENT * statements


def by_factors(by: Sweeper) -> SweepKernel | None:
    """The loop that factorises the equations of a step, if it is not the one that failed.

    Raises
    ------
    NotCompilable
        If these equations are too large to be written in C.
    """
    from varint.codegen.native_sweep import native_sweep
    from varint.codegen.sweep import sweep_kernel

    made = native_sweep if by.native else sweep_kernel
    kernel = made(by.system, by.rule, by.density)
    return None if kernel in by.kernels else kernel


def curvature_loop(by: Sweeper) -> Sweep | None:
    """The loop of second derivatives of the same kind; None where CasADi's own is to be taken."""
    if not by.kernels:
        return None
    from varint.codegen.graph import NotCompilable
    from varint.codegen.native_sweep import native_curvature
    from varint.codegen.sweep import curvature_kernel

    made = native_curvature if by.native else curvature_kernel
    try:
        return made(by.system, by.rule)
    except NotCompilable:  # the second derivatives have many more operations than the first
        return None

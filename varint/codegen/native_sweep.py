"""Derivatives of runs with nothing compiled for the scene: its operations, and those of the
derivatives of its step, are data.

They give the same bytes as the compiled loops.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from varint.codegen.arranged import WRITTEN_OUT
from varint.codegen.block import block_of, start_of
from varint.codegen.core import (
    curvature_entry,
    explicit_sweep_entries,
    linear_sweep_entries,
    stage_sweep_entries,
    sweep_entries,
)
from varint.codegen.graph import NotCompilable, kernel_per_system
from varint.codegen.native import TOO_LARGE, members_by_name, tapes_of
from varint.codegen.sweep import (
    Sweep,
    SweepKernel,
    SweepScheme,
    curvature_scheme,
    entry_of,
    sweep_scheme,
)
from varint.codegen.sweep_explicit import explicit_sweep_scheme
from varint.codegen.sweep_gauss import shape_for, stage_sweep_scheme
from varint.codegen.sweep_linear import linear_sweep_scheme
from varint.rules.rule import Rule
from varint.scene.system import System

NO_CURVATURE = {"SS_ROW": np.zeros(0, int), "SS_COLUMN": np.zeros(0, int)}


@kernel_per_system
def native_sweep(system: System, rule: Rule, density: str | None = None) -> SweepKernel:
    """The loops of `sweep_kernel` with the scene as data.

    Raises
    ------
    NotCompilable
        If a step has too many operations, or one that has no form there.
    CompileError
        If the loop was not built with the package and cannot be compiled.
    """
    block = _block("sweep_scene.h", sweep_scheme(system, rule, density))
    return SweepKernel(*(_on(block, entry) for entry in sweep_entries()))


@kernel_per_system
def native_explicit_sweep(system: System, rule: Rule, density: str | None = None) -> SweepKernel:
    """The loops of `explicit_sweep_kernel` with the scene as data; raises as `native_sweep`."""
    block = _block("sweep_explicit_scene.h", explicit_sweep_scheme(system, rule, density))
    return SweepKernel(*(_on(block, entry) for entry in explicit_sweep_entries()))


@kernel_per_system
def native_linear_sweep(system: System, rule: Rule, density: str | None = None) -> SweepKernel:
    """The loops of `linear_sweep_kernel` with the scene as data; raises as `native_sweep` does."""
    block = _block("sweep_linear_scene.h", linear_sweep_scheme(system, rule, density))
    return SweepKernel(*(_on(block, entry) for entry in linear_sweep_entries()))


@kernel_per_system
def native_stage_sweep(system: System, rule: Rule, density: str | None = None) -> SweepKernel:
    """The loops of `stage_sweep_kernel` with the scene as data; raises as `native_sweep` does."""
    block = _block("sweep_gauss_scene.h", stage_sweep_scheme(system, rule, density))
    shape = shape_for(len(rule.nodes))
    entries = stage_sweep_entries(shape["LANES"], shape["STRIDE"])
    return SweepKernel(*(_on(block, entry) for entry in entries))


@kernel_per_system
def native_curvature(system: System, rule: Rule) -> Sweep:
    """The loop of `curvature_kernel` with the scene as data; raises as `native_sweep` does."""
    return _on(_block("sweep_scene.h", curvature_scheme(system, rule)), curvature_entry())


def _block(file: str, scheme: SweepScheme) -> np.ndarray:
    if any(f.sizes.nodes > WRITTEN_OUT for f in scheme.functions.values()):
        raise NotCompilable(TOO_LARGE)  # in C they are loops, which add up in another order
    numbers = {"SS": 0} | scheme.counts | scheme.limits
    arrays = NO_CURVATURE | scheme.places
    return block_of(
        members_by_name(file, numbers, arrays, scheme.tables, tapes_of(scheme.functions))
    )


def _on(block: np.ndarray, entry: Callable) -> Sweep:
    return partial(_call, block, entry_of(entry, start_of(block)))


def _call(block: np.ndarray, loop: Sweep, given: dict) -> int:
    """The loop on a scene, whose block lives as long as what refers to it."""
    return loop(given)

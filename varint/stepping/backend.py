"""Compiled or interpreted: which loop runs, and how compiled runs are handed on block by block."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from functools import cache
from types import ModuleType
from typing import TYPE_CHECKING

import numpy as np

from varint.discrete import point_function
from varint.errors import InputError
from varint.rules import Rule
from varint.stepping.run import Block, Position, Task, run
from varint.system import System

if TYPE_CHECKING:
    from varint.compiled.kernel import Kernel

BACKENDS = ("auto", "compiled", "interpreted")
WORTH_COMPILING = 0.5  # seconds of interpreted work; the compiler takes 0.3 to 1, the first time
INSTRUCTION = 4e-9  # seconds of CasADi's virtual machine for one operation
EVALUATIONS = 36  # of every stage in an implicit step, derivatives included
FACTOR = 3e-9  # seconds of it for the cube of an unknown: factorisations
UNKNOWN = 2e-6  # seconds of it for an unknown of Newton's method with constraints
COMPILING = 0.03  # seconds of the compiler for an unknown or coordinate
CALL = 3e-7  # seconds of CasADi's virtual machine for a step besides


def kernel_for(system: System, rule: Rule, task: Task, backend: str) -> Kernel | None:
    """The compiled loop for a run, or None where the interpreted one is to be used.

    ``"auto"`` compiles where the interpreted run would take longer than the compiler, by the number of operations: the
    same input always gives the same choice and so the same digits.

    Raises
    ------
    InputError
        If there is no such backend.
    NotCompilable, CompileError
        If ``"compiled"`` is asked for and impossible.
    """
    if backend not in BACKENDS:
        raise InputError(f"unknown backend {backend!r}; known: {list(BACKENDS)}")
    if backend == "interpreted" or (backend == "auto" and not repays(system, rule, task.steps)):
        return None
    native = _native()
    try:
        return native.kernel_of(system, rule)
    except native.NotCompilable:
        if backend == "compiled":
            raise
    except native.CompileError as error:
        if backend == "compiled":
            raise
        _say_once(str(error).splitlines()[0])
    return None


@cache
def _native() -> ModuleType:
    """The module of compiled loops; an import in a function looks it up every time."""
    from varint.stepping import native

    return native


def repays(system: System, rule: Rule, steps: int) -> bool:
    """Whether so many interpreted steps take longer than the compiler."""
    s = system.structure
    if not (rule.kicks and s.explicit) and (s.degenerate or s.contacts or not s.quadratic_kinetic or not rule.points):
        return False
    worth = WORTH_COMPILING
    if s.constraints or s.nonholonomic:
        worth += COMPILING * (s.n + _unknowns(system, rule))
    return interpreted_seconds(system, rule) * steps > worth


def interpreted_seconds(system: System, rule: Rule) -> float:
    """An estimate of the time of an interpreted step, from the number of operations alone."""
    s = system.structure
    evaluation = point_function(system).n_instructions() * len(rule.nodes) * INSTRUCTION
    if rule.kicks and s.explicit:
        return evaluation + CALL
    unknowns = _unknowns(system, rule)
    if s.constraints or s.nonholonomic:
        return unknowns * UNKNOWN + CALL
    return evaluation * EVALUATIONS + unknowns**3 * FACTOR + CALL


def _unknowns(system: System, rule: Rule) -> int:
    s = system.structure
    if not (s.constraints or s.nonholonomic):
        return s.n * rule.degree
    from varint.stepping.rattle import eliminates_path

    path = 0 if s.constraints and eliminates_path(system, rule) else s.n * rule.degree
    return path + s.constraints * rule.degree + s.nonholonomic


_SAID: set[str] = set()


def _say_once(reason: str) -> None:
    if reason not in _SAID:
        _SAID.add(reason)
        warnings.warn(f"{reason}; until then everything works, slower", stacklevel=5)


def blocks_of(
    system: System, rule: Rule, task: Task, kernel: Kernel | None, at: Position | None = None
) -> Iterator[Block]:
    """The run block by block, compiled where there is a kernel; from a position on where one is given."""
    if kernel is None or (at is not None and at.carry is None and not at.by_newton):
        return run(system, rule, task, at)
    return _native().native_blocks(system, rule, task, kernel, at)


def divided(system: System, rule: Rule, task: Task, kernel: Kernel | None, at: Position) -> list[Block]:
    """The step at which a run failed in parts; compiled implicit rules go on from there by Newton's method."""
    from varint.stepping.subdivide import subdivided

    block, n = subdivided(system, rule, task, at), system.structure.n
    if kernel is None or rule.kicks or block.after is None:
        return [block]
    x = np.concatenate([block.after.x[:n], block.after.x[2 * n : 3 * n]])
    return [block._replace(after=Position(x, np.empty(0), np.empty(0), block.after.k, 0, by_newton=True))]

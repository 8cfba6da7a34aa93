"""Compiled or interpreted: which loop runs, and how compiled runs are handed on block by block."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from typing import TYPE_CHECKING

from varint.discrete import point_function
from varint.errors import InputError
from varint.rules import MOST_STAGES, Rule, gauss
from varint.stepping.run import Block, Task, run
from varint.system import System

if TYPE_CHECKING:
    from varint.compiled.kernel import Kernel

BACKENDS = ("auto", "compiled", "interpreted")
WORTH_COMPILING = 0.5  # seconds of interpreted work; the compiler takes 0.3 to 1, the first time
INSTRUCTION = 4e-9  # seconds of CasADi's virtual machine for one operation
ITERATIONS = 6  # evaluations of every stage in an implicit step
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
    if backend == "interpreted" or (backend == "auto" and not _repays(system, rule, task)):
        return None
    from varint.compiled.cache import CompileError
    from varint.compiled.graph import NotCompilable
    from varint.stepping.native import kernel_of

    try:
        return kernel_of(system, rule)
    except NotCompilable:
        if backend == "compiled":
            raise
    except CompileError as error:
        if backend == "compiled":
            raise
        _say_once(str(error).splitlines()[0])
    return None


def _repays(system: System, rule: Rule, task: Task) -> bool:
    s = system.structure
    explicit = bool(rule.kicks) and s.explicit
    regular = s.quadratic_kinetic and not (s.constraints or s.nonholonomic or s.degenerate)
    if not explicit and not (regular and rule == gauss(min(len(rule.nodes), MOST_STAGES))):
        return False
    evaluations = len(rule.nodes) * (1 if explicit else ITERATIONS)
    work = point_function(system).n_instructions() * evaluations * INSTRUCTION + CALL
    return work * task.steps > WORTH_COMPILING


_SAID: set[str] = set()


def _say_once(reason: str) -> None:
    if reason not in _SAID:
        _SAID.add(reason)
        warnings.warn(f"{reason}; until then everything works, slower", stacklevel=5)


def blocks_of(system: System, rule: Rule, task: Task, kernel: Kernel | None) -> Iterator[Block]:
    """The run block by block, compiled where there is a kernel."""
    if kernel is None:
        return run(system, rule, task)
    from varint.stepping.native import native_blocks

    return native_blocks(system, rule, task, kernel)

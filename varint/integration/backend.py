"""Compiled or interpreted: which loop runs, and how compiled runs are handed on block by block."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from functools import cache
from types import ModuleType
from typing import TYPE_CHECKING

import numpy as np

from varint.errors import InputError
from varint.integration.cost import repays
from varint.integration.interpreted_loop import interpreted_blocks
from varint.integration.problem import InitialValueProblem
from varint.integration.state import NodeBlock, RunState
from varint.integration.steppers.stepper import state_layout
from varint.rules.rule import Rule
from varint.scene.memory import per_scene
from varint.scene.system import System

if TYPE_CHECKING:
    from varint.codegen.kernel import Kernel, LoopResult

BACKENDS = ("auto", "compiled", "native", "interpreted")


def require_backend(backend: str) -> None:
    """Refuse a backend that does not exist."""
    if backend not in BACKENDS:
        raise InputError(f"unknown backend {backend!r}; known: {list(BACKENDS)}")


def kernel_for(
    system: System, rule: Rule, problem: InitialValueProblem, backend: str
) -> Kernel | None:
    """The loop in C for a run, or None where the interpreted one is to be used.

    ``"auto"`` begins Gauss rules with the scene's operations as data, for which nothing is
    compiled; their compiled loop gives the same digits and takes over where that pays. It compiles
    other rules where the interpreted run would take longer than the compiler, by the number of
    operations: the same input always gives the same digits.

    Raises
    ------
    InputError
        If there is no such backend.
    NotCompilable, CompileError
        If ``"compiled"`` or ``"native"`` is asked for and impossible.
    """
    require_backend(backend)
    if backend == "interpreted":
        return None
    if backend == "native":
        return _compiled_loop().native_kernel(system, rule)
    in_gear = _compiled_loop().kernel_in_gear(system, rule) if backend == "auto" else None
    if in_gear is not None:
        return in_gear
    if backend == "auto" and not repays(system, rule, problem.steps + problem.ahead):
        return None
    loop = _compiled_loop()
    try:
        return loop.kernel_of(system, rule)
    except loop.NotCompilable:
        if backend == "compiled":
            raise
    except loop.CompileError as error:
        if backend == "compiled":
            raise
        _say_once(str(error).splitlines()[0])
    return None


def runs_by_stages(system: System, rule: Rule, backend: str) -> bool:
    """Whether the rule iterates all stages at once, in a loop that need not be compiled first."""
    return backend in ("auto", "native") and _by_stages_at_once(system, rule)


@per_scene
def _by_stages_at_once(system: System, rule: Rule) -> bool:
    loop = _compiled_loop()
    by_stages = loop.scheme_of(system, rule) is loop.BY_STAGES
    return by_stages and loop.kernel_in_gear(system, rule) is not None


@cache
def _compiled_loop() -> ModuleType:
    """The module of compiled loops; an import in a function looks it up every time."""
    from varint.integration import compiled_loop

    return compiled_loop


@cache
def _short_loop() -> ModuleType:
    """That of compiled loops in one call."""
    from varint.integration import short_loop

    return short_loop


_SAID: set[str] = set()


def _say_once(reason: str) -> None:
    if reason not in _SAID:
        _SAID.add(reason)
        warnings.warn(f"{reason}; until then everything works, slower", stacklevel=5)


def blocks_of(
    system: System,
    rule: Rule,
    problem: InitialValueProblem,
    kernel: Kernel | None,
    at: RunState | None = None,
) -> Iterator[NodeBlock]:
    """The run block by block, compiled where there is a kernel; from a position on where one is
    given.
    """
    if kernel is None or (at is not None and at.carry is None and not at.by_newton):
        return interpreted_blocks(system, rule, problem, at)
    return _compiled_loop().compiled_blocks(system, rule, problem, kernel, at)


def run_at_once(
    system: System,
    rule: Rule,
    problem: InitialValueProblem,
    kernel: Kernel,
    short: bool = True,
    looks: tuple[np.ndarray, int] | None = None,
) -> LoopResult | None:
    """A run without a look at it on the way; None where it is not short, if it is to be, or where
    another loop must go on. With `looks` it tells what the stages of its steps show.
    """
    loop = _short_loop()
    if short and not loop.is_short(kernel, problem.steps - problem.first):
        return None
    return loop.run_at_once(system, rule, problem, kernel, looks)


def subdivide_failed_step(
    system: System, rule: Rule, problem: InitialValueProblem, kernel: Kernel | None, at: RunState
) -> list[NodeBlock]:
    """The step at which a run failed in parts; compiled implicit rules go on from there by
    Newton's method.
    """
    from varint.integration.events.subdivide import subdivide

    block, layout = subdivide(system, rule, problem, at), state_layout(system.structure.n)
    if kernel is None or rule.kicks or block.after is None:
        return [block]
    x = np.concatenate([block.after.x[layout.q], block.after.x[layout.p]])
    return [
        block._replace(
            after=RunState(x, np.empty(0), np.empty(0), block.after.k, 0, by_newton=True)
        )
    ]

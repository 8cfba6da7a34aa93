"""Two gears of the loops that carry derivatives: a scene's operations as data from the first step
on, compiled where that pays; see `varint.integration.gears`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from time import perf_counter

from varint.codegen.cache import (
    AS_WRITTEN,
    Compilation,
    CompileError,
    begin_compilation,
    finished,
    in_cache,
)
from varint.codegen.graph import NotCompilable
from varint.codegen.sweep import SweepKernel
from varint.integration.gears import LOOK

# of the time that the compiler is thought to need, spent before it is started: less than for runs,
# of which one may be the last, for who takes derivatives of a scene takes many
START = 0.25


@dataclass(eq=False)
class SweepGears:
    """The loops of a scene and a rule in both gears.

    Attributes
    ----------
    low : SweepKernel
        With the scene as data.
    source : callable
        The text of the compiled loops; raises NotCompilable.
    compiled : callable
        Those, from the cache where they are there.
    expected : float
        Seconds that the compiler is thought to need.
    seconds : float
        Spent in the low gear so far.
    work : Compilation or None
        The compiler at work.
    high : SweepKernel or None
        The compiled loops, once there are any.
    looked, stuck : bool
        Whether the cache has been asked; whether there is no high gear.
    """

    low: SweepKernel
    source: Callable[[], str]
    compiled: Callable[[], SweepKernel]
    expected: float
    seconds: float = 0.0
    work: Compilation | None = None
    high: SweepKernel | None = None
    looked: bool = False
    stuck: bool = False


def shifting(gears: SweepGears) -> SweepKernel:
    """Loops that begin in the low gear. Both give the same numbers: nothing but time depends on
    which of them runs.
    """
    return SweepKernel(*(partial(_in_gear, gears, name) for name in ("tangents", "adjoints")))


def _in_gear(gears: SweepGears, loop: str, given: dict) -> int:
    if gears.work is not None and finished(gears.work):
        gears.work = None
        _shift(gears)
    if gears.high is not None:
        return getattr(gears.high, loop)(given)
    began = perf_counter()
    status = getattr(gears.low, loop)(given)
    gears.seconds += perf_counter() - began
    spent, busy = gears.seconds / gears.expected, gears.work is not None or gears.stuck
    if not busy and (spent > START or (spent > LOOK and not gears.looked)):
        gears.looked = True
        _prepare(gears, spent > START)
    return status


def _prepare(gears: SweepGears, start: bool) -> None:
    """Take the compiled loops from the cache; where they are not there, start the compiler."""
    try:
        source = gears.source()
        if in_cache(source, AS_WRITTEN):
            _shift(gears)
        elif start:
            gears.work = begin_compilation(source, AS_WRITTEN)
    except (NotCompilable, CompileError):
        gears.stuck = True


def _shift(gears: SweepGears) -> None:
    try:
        gears.high = gears.compiled()
    except (NotCompilable, CompileError):
        gears.stuck = True

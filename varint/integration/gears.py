"""Two gears of one loop: operations as data from the first step on, compiled where it pays.

Both give the same numbers, so nothing but time depends on which one runs, on the clock, on what the
cache holds or on what ran before. The compiler works in a process of its own meanwhile.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field, replace
from functools import cache
from typing import TYPE_CHECKING, NamedTuple

from varint.codegen.cache import Compilation, CompileError, begin_compilation, finished, in_cache
from varint.codegen.explicit import explicit_kernel, explicit_source
from varint.codegen.gauss import gauss_form, gauss_kernel, gauss_source
from varint.codegen.graph import NotCompilable
from varint.codegen.kernel import Kernel
from varint.codegen.native import native_explicit, native_gauss
from varint.integration.cost import compiling_seconds, is_solved_at_once, loop_seconds
from varint.numerics.limits import CLOSED
from varint.numerics.progress import notice
from varint.rules.polynomials import MOST_STAGES
from varint.rules.rule import Rule, gauss
from varint.scene.memory import per_scene
from varint.scene.system import System

if TYPE_CHECKING:
    from varint.codegen.source import Source

# of the compiler's predicted time: what must have been spent, or be ahead, before the source is
# written and looked for in the cache, which takes about a fifth of it, and before the compiler is
# started: below twice its time the low gear meanwhile and the compiler take more of the processor
# than the low gear alone
LOOK, START = 0.2, 2.0
MANY = 24  # coordinates from which on arranging a scene's operations may take seconds


class Scheme(NamedTuple):
    """A way to step: with the scene as data, as C source, and compiled."""

    native: Callable[[System, Rule], Kernel]
    source: Callable[[System, Rule], Source]
    compiled: Callable[[System, Rule], Kernel]


EXPLICIT = Scheme(native_explicit, explicit_source, explicit_kernel)
BY_STAGES = Scheme(native_gauss, gauss_source, gauss_kernel)  # all at once, by fixed points


@cache
def newton() -> Scheme:
    """Newton's method; its modules are many, and loaded when it is needed."""
    from varint.codegen.native_newton import native_newton
    from varint.codegen.newton import newton_kernel, newton_source

    return Scheme(native_newton, newton_source, newton_kernel)


@per_scene
def scheme_of(system: System, rule: Rule) -> Scheme:
    """Kick and drift where they exist; all stages at once by fixed-point iteration for Gauss
    rules, which beats Newton's method by far except for the midpoint rule in few coordinates
    (double pendulum: 0.35 against 0.16 µs a step) and linear scenes that are not large; else
    Newton's method.
    """
    s = system.structure
    if rule.kicks and s.explicit:
        return EXPLICIT
    few = rule == gauss(1) and s.n <= CLOSED
    return (
        newton()
        if few or not _has_stages(system, rule) or is_solved_at_once(system, rule)
        else BY_STAGES
    )


def _has_stages(system: System, rule: Rule) -> bool:
    return rule == gauss(min(len(rule.nodes), MOST_STAGES)) and bool(gauss_form(system))


@dataclass(eq=False)
class Gears:
    """The loop of a system and a rule in both gears.

    Attributes
    ----------
    system, rule, scheme
    low : Kernel
        With the scene as data.
    work : Compilation or None
        The compiler at work.
    seconds, loop : float
        Spent in the low gear so far; that the compiler is predicted to take for what scenes of a
        size share, where the cache has been asked and it was not there.
    looked, stuck : bool
        Whether the cache has been asked; whether there is no high gear.
    begun : list of str
        C sources that the compiler has been given.
    high : list of Kernel
        The compiled loop, once there is one, of all that share it.
    """

    system: System
    rule: Rule
    scheme: Scheme
    low: Kernel
    work: Compilation | None = None
    seconds: float = 0.0
    loop: float = 0.0
    looked: bool = False
    stuck: bool = False
    begun: list[str] = field(default_factory=list)
    high: list[Kernel] = field(default_factory=list)


@per_scene
def gears_of(system: System, rule: Rule, scheme: Scheme) -> Gears | None:
    """The gears of a rule, or None where the scene has none: its operations are too many, or there
    is neither a loop that was built with the package nor a compiler.
    """
    try:
        low = native_loop(system, rule, scheme)
    except (NotCompilable, CompileError):
        return None
    high = high_gear(system, rule, scheme)
    return Gears(system, rule, scheme, replace(low), high=high)  # not that of backend="native"


def native_loop(system: System, rule: Rule, scheme: Scheme) -> Kernel:
    """The low gear; raises NotCompilable, CompileError."""
    with _said(system, f"arranging the operations of {system.structure.n} coordinates"):
        return scheme.native(system, rule)


def _said(system: System, what: str) -> AbstractContextManager[object]:
    """Nobody waits for small scenes."""
    return notice(what) if system.structure.n >= MANY else nullcontext()


@per_scene
def high_gear(system: System, rule: Rule, scheme: Scheme) -> list[Kernel]:
    """The compiled loop, once there is one."""
    return []


def compiled_kernel(system: System, rule: Rule, scheme: Scheme) -> Kernel:
    """The compiled loop, now; raises NotCompilable, CompileError."""
    kernel = scheme.compiled(system, rule)
    high_gear(system, rule, scheme)[:] = [kernel]
    return kernel


def gears_with(system: System, rule: Rule, scheme: Scheme, kernel: Kernel) -> Gears | None:
    """The gears whose low one this kernel is."""
    found = gears_of(system, rule, scheme) if kernel.is_native else None
    return found if found and found.low is kernel else None


def kernel_now(gears: Gears) -> Kernel:
    """The best loop that is there."""
    if gears.work is not None and finished(gears.work):
        gears.work = None
        _prepare(gears, math.inf)
    return gears.high[0] if gears.high else gears.low


def kernel_after(gears: Gears, seconds: float, ahead: float) -> Kernel:
    """The loop to go on with after so many seconds in the low gear, with about so many ahead."""
    gears.seconds += seconds
    if gears.work is None and not gears.stuck and kernel_now(gears) is gears.low:
        total = gears.seconds + ahead
        if total > (START if gears.looked else LOOK) * _seconds_to_compile(gears):
            gears.looked = True
            _prepare(gears, total)
    return kernel_now(gears)


def _seconds_to_compile(gears: Gears) -> float:
    """As far as it is known what the cache holds."""
    return compiling_seconds(gears.system, gears.rule) + gears.loop


def _prepare(gears: Gears, total: float) -> None:
    """Take the compiled loop from the cache; where it is not there, start the compiler, with one of
    its sources after the other, if that repays for so many seconds in the low gear.
    """
    try:
        with _said(gears.system, "writing the operations as C"):
            source = gears.scheme.source(gears.system, gears.rule)
        missing = [text for text in source.texts if not in_cache(text, source.contraction)]
        ahead = [text for text in missing if text not in gears.begun]
        gears.loop = loop_seconds(gears.system) if source.loop in missing else 0.0
        if not ahead:
            _shift(gears)
        elif total > START * _seconds_to_compile(gears):
            gears.work = begin_compilation(ahead[0], source.contraction)
            gears.begun += ahead[:1] if gears.work else []
    except (NotCompilable, CompileError):
        gears.stuck = True


def _shift(gears: Gears) -> None:
    """Into the high gear: the compiled loop is in the cache, or the compiler has refused it."""
    try:
        compiled_kernel(gears.system, gears.rule, gears.scheme)
    except (NotCompilable, CompileError):
        gears.stuck = True

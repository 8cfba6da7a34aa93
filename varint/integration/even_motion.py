"""Motions of equal steps with a node at each, of which nothing is made but what runs have found."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from ctypes import c_void_p, cast
from functools import cache, partial
from time import perf_counter
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from varint.codegen.beside import NOTHING_BESIDE, Beside
from varint.codegen.built import built_module
from varint.codegen.cache import CompileError
from varint.codegen.times import states_at_times
from varint.codegen.two_runs import (
    GRADED,
    GRADED_DOUBTED,
    Course,
    Places,
    Rates,
    graded_run,
    two_runs,
)
from varint.integration.many_steps import in_gear, steps_again
from varint.integration.plan import Plan
from varint.integration.trajectories import stats_of
from varint.results.records import Event
from varint.results.trajectory import Trajectory
from varint.scene.system import System

if TYPE_CHECKING:
    from varint.codegen.kernel import Kernel
    from varint.codegen.within_steps import Within

_new, _set = object.__new__, object.__setattr__
# what was found on the way of a motion: its system and parameters, names of expressions, and zeros
Happened = tuple[System, np.ndarray, tuple[str, ...], np.ndarray]
TOLD = "seconds", "tol", "error_estimate", "rule", "runs"  # in this order, or the first of them


class Made(NamedTuple):
    """How motions are made of what the core finds; see `made_of`. The fields are those of
    c/direct.c.

    Attributes
    ----------
    course : Course
    entry : int
        Where the core's function is.
    head : bytes
        The course, as the core is told of it.
    n, parts : int
        Numbers of each of so many parts of a node.
    kind : type
    blank : dict
        What a motion has, of which the rule is known.
    name : str
        Of the rule.
    make : callable
        (h, t0, steps, iterations, residual), what is `TOLD`, what happened, name → what the motion
        has of it.
    now, array, number : callable, type, dtype
        The clock, and what nodes are made of.
    """

    course: Course
    entry: int
    head: bytes
    n: int
    parts: int
    kind: type
    blank: dict[str, Any]
    name: str
    make: Callable[..., Any]
    now: Callable[[], float]
    array: type
    number: np.dtype


def made_of(course: Course, chosen: Plan) -> Made:
    """By a course, of a plan."""
    entry = cast(course.entry, c_void_p).value or 0  # type: ignore[arg-type]
    make = partial(_made, chosen, course.kernel)
    numbers = course.head, course.n, course.parts
    parts = ("q", "p", "v")[: course.parts]
    blank = dict.fromkeys(("system", "h", "c", "origin", "_make", *parts)) | {"rule": chosen.rule}
    tools = perf_counter, np.ndarray, np.dtype(float)
    return Made(course, entry, *numbers, Trajectory, blank, chosen.rule.name, make, *tools)


@cache
def proved_motion() -> Callable[..., Trajectory | tuple[Trajectory, float] | int]:
    """(how motions are made, places, system, parameters, t0, duration, first, radians, tol, rates,
    began) → the motion whose error `two_runs` prove, with that error where more is to be looked at
    before; or what they say. Behind that may stand what is asked `Beside`, or None, then times that
    are asked for, and how it is looked at between its nodes: these may be its nodes already.
    """
    built = built_module()
    return _proved if built is None else built.prove  # type: ignore[no-any-return]


def _proved(
    how: Made,
    places: Places,
    system: System,
    c: np.ndarray,
    t0: float,
    duration: float,
    first: int,
    radians: float,
    tol: float,
    rates: Rates,
    began: float,
    beside: Beside | None = None,
    *asked: Any,
) -> Trajectory | tuple[Trajectory, float] | int:
    """As c/direct.c does, but at times that are asked for."""
    beside = beside or NOTHING_BESIDE
    found = two_runs(how.course, places, t0, duration, first, radians, tol, rates, beside)
    if isinstance(found, int):
        if found not in (GRADED, GRADED_DOUBTED):
            return found
        graded, estimate, _ = graded_motion(system, how, places, c, (t0, duration, tol), began)
        return graded if found == GRADED else (graded, estimate)
    steps, runs, estimate, iterations, residual, nodes, doubted, zeros = found
    grid: tuple = (duration / steps, t0, steps, iterations, residual)
    happened = None
    if zeros is not None and len(zeros):
        cut = beside.stops and not zeros[0, 1]
        if cut:
            grid = (*grid, len(nodes[0]) - 1, zeros.item((0, 2)))
        if len(zeros) > cut:
            happened = system, c, beside.names, zeros[cut:]
    told = perf_counter() - began, tol, estimate, how.name, runs
    motion = even_motion_of(system, how, nodes, c, grid, told, happened)
    return (motion, estimate) if doubted else motion


def even_motion_of(
    system: System,
    how: Made,
    nodes: np.ndarray,
    c: np.ndarray,
    grid: tuple,
    told: tuple,
    happened: Happened | None = None,
) -> Trajectory:
    """`plain_motion_of` one with a node at each of its equal steps, or until it ends within one of
    them: (q, p) and perhaps v, and what is made of its grid, (h, t0, steps, iterations, residual)
    and perhaps the number and time of its last node, of what is `TOLD` and what happened when it is
    asked for.
    """
    known = dict(how.blank, system=system, q=nodes[0], p=nodes[1], h=grid[0], c=c, origin=grid[1])
    known["_make"] = partial(how.make, grid, told, happened)
    if len(nodes) > 2:
        known["v"] = nodes[2]
    motion = _new(Trajectory)
    _set(motion, "__dict__", known)
    return motion


def graded_motion(
    system: System,
    how: Made,
    places: Places,
    c: np.ndarray,
    asked: tuple[float, float, float],
    began: float,
) -> tuple[Trajectory, float, int]:
    """The motion that the core has found by steps of more than one size, for t0, a duration and a
    wanted error; the estimate of its own, and how many runs were made.
    """
    steps, runs, estimate, iterations, residual, nodes = graded_run(how.course, places)
    (t0, duration, tol), t = asked, nodes[2, :, 0].copy()
    grid = duration / steps, t0, steps, iterations, residual
    told = perf_counter() - began, tol, estimate, how.name, runs
    motion = even_motion_of(system, how, nodes[:2], c, grid, told)
    motion.__dict__.update(t=t, sizes=t[1:] - t[:-1])
    return motion, estimate, runs


def between_nodes(motion: Any, kernel: Kernel, times: np.ndarray, steps: Within) -> Any:
    """A motion that has just been made, with these times as its nodes if the loop can look at them
    at once; what is none, or has other nodes already, as it is.
    """
    if type(motion) is not Trajectory or "t" in motion.__dict__:
        return motion
    own, found = motion.__dict__, None
    if not times.flags.c_contiguous:
        return motion
    with suppress(CompileError):
        grid, nodes = (own["h"], own["origin"]), (None, own["q"], own["p"], None)
        found = states_at_times(kernel, nodes, own["c"], grid, times, steps)
    if found is not None:
        own.update(zip(("q", "p", "k"), found, strict=True), t=times)
        own.pop("v", None)
    return motion


def _made(
    chosen: Plan,
    kernel: Kernel,
    grid: tuple,
    told: tuple,
    happened: Happened | None,
    name: str,
) -> Any:
    """The field of this name; of a motion that ends within a step the number and time of its last
    node stand behind the grid.
    """
    h, t0, steps, iterations, residual, *last = grid
    if name == "stats":
        more = dict(zip(TOLD, told, strict=False))
        made = last[0] if last else steps
        return stats_of(chosen, kernel, made, (int(iterations), residual), more)
    if name == "functions":
        return steps_again(chosen.rule, in_gear)
    if name == "u":
        return np.empty((steps, 1, 0))
    if name == "fictitious":
        return None
    if name == "events":
        return () if happened is None else _events(*happened, h, last[1] if last else None)
    k = np.arange((last[0] if last else steps) + 1, dtype=np.int64)
    x = k if name == "k" else h * k + t0
    if last:
        x[-1] = last[0] - 1 if name == "k" else last[1]
    return x


def _events(*found: Any) -> tuple[Event, ...]:
    from varint.integration.events.short_search import events_along  # where some are asked for

    return events_along(*found)

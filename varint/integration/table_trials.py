"""Runs for a wanted accuracy whose controls follow a table, whose rows follow one another.

All runs that prove the error are made by one call of the core, which takes the controls of each
step from the table; each row has as many steps, so that nodes lie where controls jump. Rows are
mostly shorter than the steps that the motion asks for: a rule that needs fewer of these saves
nothing there, but of those that take as much work the one of the highest order proves the error by
two runs.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from time import perf_counter
from typing import Any

import numpy as np

from varint.codegen.few_steps import TOLD, place_of
from varint.codegen.kernel import Kernel, address_of
from varint.codegen.refined_runs import with_table
from varint.codegen.two_runs import NO_RATES, NOT_SHORT, Places, places_of
from varint.integration.backend import runs_by_stages
from varint.integration.choice import Choice
from varint.integration.compiled_loop import kernel_of, native_kernel
from varint.integration.even_motion import Made, made_of, proved_motion
from varint.integration.gears import BY_STAGES, Gears, gears_of, kernel_after, kernel_now, scheme_of
from varint.integration.linear_run import MAPPED, driven_kernel
from varint.integration.plain_start import Room, moves_freely, rooms
from varint.integration.plan import plan
from varint.integration.problem import InitialValueProblem
from varint.integration.rule_choice import FEWEST, Priced, candidates, first_steps, priced
from varint.integration.second_looks import has_switches
from varint.integration.short_doubts import looked_at
from varint.integration.short_refinement import refined_first
from varint.integration.short_trials import course_by
from varint.integration.small_motions import is_looked_at
from varint.results.trajectory import Trajectory
from varint.rules.polynomials import lagrange_values
from varint.rules.rule import Rule, gauss
from varint.scene.memory import per_scene
from varint.scene.system import System

# the wanted error over that of a first run that is good enough for one of twice its steps to prove
# it; steps of all runs over those of the first one then, and where more of them show an order
BELOW, SHOWN, SEARCHED = 2.0, 3.0, 7.0


@dataclass(eq=False)
class Loop:
    """Of a scene and a rule: what is known of the rule, its places in a step, the gears, or the
    loop that has none, and the kernel that ran last with how motions are made by it.
    """

    price: Priced
    places: np.ndarray
    gears: Gears | None
    alone: Kernel | None
    last: tuple[Kernel | None, Made | None] = (None, None)


Chosen = tuple[Loop, int]  # and the steps of its first run


@dataclass(frozen=True, eq=False)
class Known:
    """Of a scene and a rule: coordinates and controls, loops that rows of one value may take, and
    the one that rows of a value at each node of the rule take, so many nodes; rooms that nobody
    uses, whether momenta will do for a start, the last local numbers of a start as bytes and the
    fastest frequency of these, and the last choice with what it was made for.
    """

    n: int
    controls: int
    loops: tuple[Loop, ...]
    at_nodes: tuple[Loop, ...]
    nodes: int
    rooms: list[Room]
    by_momentum: bool
    last: list[tuple[bytes, float | None]]
    chosen: list[tuple[tuple, Chosen | None]]


@per_scene
def known_of(system: System, rule: Rule | None) -> Known | None:
    """None where another way is to be taken, whatever the table."""
    s, own = system.structure, plan(system, rule).rule
    if not (s.controls and moves_freely(system) and is_looked_at(system)):
        return None
    if has_switches(system):
        return None
    driven = rule is None and driven_kernel(system, MAPPED) is not None
    if not (rule or driven or runs_by_stages(system, gauss(8), "auto")):
        return None
    rules = candidates(system, False, True) if rule is None else {own: 1.0}
    loops, at_nodes = _loops(system, priced(rules)), _loops(system, priced({own: 1.0}))
    begin = rooms(system, True), s.quadratic_kinetic, [(b"", 0.0)], [((), None)]
    if not loops:
        return None
    return Known(s.n, s.controls, loops, at_nodes, len(own.nodes), *begin)  # type: ignore[arg-type]


def _loops(system: System, rules: tuple[Priced, ...]) -> tuple[Loop, ...]:
    """Those that make all of a step at once, or are the map of a linear motion."""
    found = []
    for price in rules:
        rule, gears, alone = price.rule, None, driven_kernel(system, price.rule)
        if alone is None and scheme_of(system, rule) is BY_STAGES:
            gears = gears_of(system, rule, BY_STAGES)
        if gears or alone:
            found.append(Loop(price, np.array(rule.nodes), gears, alone))
    return tuple(found)


def by_table(
    system: System,
    known: Known,
    table: np.ndarray,
    places: Places,
    c: np.ndarray,
    asked: tuple[float, float, float, float],
    backend: str,
    began: float,
) -> Trajectory | int:
    """The motion from the start that is there under the controls of a table, (rows, 1 or r, k), for
    t0, a duration, how far the fastest small motions turn and a wanted error; NOT_PROVED or
    NOT_SHORT where runs do not show that soon, or another loop should go on.
    """
    t0, duration, radians, tol = asked
    loop, first = _chosen_now(system, known, table, radians, tol)
    kernel = _kernel_for(system, loop, backend)
    made = None if kernel is None else _made_now(system, loop, kernel)
    if made is None:
        return NOT_SHORT
    course = with_table(made.course, table, loop.places)
    make = partial(_made, made.make, loop.price.rule, table)
    made = made._replace(course=course, head=course.head, make=make)
    now, how = perf_counter(), (t0, duration, first, radians, tol, NO_RATES, began)
    found = proved_motion()(made, places, system, c, *how)
    if loop.gears and kernel is loop.gears.low:
        kernel_after(loop.gears, perf_counter() - now, 0.0)
    if isinstance(found, tuple):
        motion, estimate = found
        return looked_at(motion, estimate, tol, False)
    return found


def by_table_trials(
    system: System,
    rule: Rule | None,
    start: InitialValueProblem,
    mass: np.ndarray,
    tol: float,
    radians: float,
    backend: str,
    began: float,
) -> Choice | None:
    """The choice that `by_table` makes of a problem of a step in each row; None where it makes
    none. `mass` is the diagonal of the mass matrix at the start.
    """
    known = known_of(system, rule)
    if known is None or not fits(known, start.u):
        return None
    n = len(mass)
    room = np.concatenate((start.q0, start.p0, mass, start.c, np.zeros(TOLD)))
    at, told = address_of(room), 3 * n + start.c.size
    place = place_of(at, at + 24 * n, at + 8 * told, room[told:].data)
    asked = start.t0, start.h * start.steps, radians, tol
    places = places_of(place, at + 16 * n, 1)
    motion = by_table(system, known, start.u, places, start.c, asked, backend, began)
    if isinstance(motion, int):
        return None
    estimate, runs = motion.stats["error_estimate"], motion.stats["runs"]
    return Choice(motion.rule, len(motion) - 1, motion, estimate, runs, True, True)


def fits(known: Known, table: np.ndarray) -> bool:
    """Whether a table (rows, 1 or r, k) has rows that follow one another, and a loop takes them."""
    rows, each, controls = table.shape
    at_nodes = each == known.nodes and bool(known.at_nodes)
    return rows > 1 and controls == known.controls and (each == 1 or at_nodes)


def _kernel_for(system: System, loop: Loop, backend: str) -> Kernel | None:
    """The loop that runs; None where there is none of this kind."""
    if loop.gears is None:
        return None if backend == "compiled" else loop.alone
    if backend == "auto":
        return kernel_now(loop.gears)
    return (kernel_of if backend == "compiled" else native_kernel)(system, loop.price.rule)


def _made_now(system: System, loop: Loop, kernel: Kernel) -> Made | None:
    """How motions are made by a kernel of the loop; None where the core cannot make them."""
    if loop.last[0] is not kernel:
        rule = loop.price.rule
        course = course_by(system, rule, kernel)
        loop.last = kernel, None if course is None else made_of(course, plan(system, rule))
    return loop.last[1]


def _chosen_now(
    system: System, known: Known, table: np.ndarray, radians: float, tol: float
) -> Chosen:
    """`_chosen`, of which the last one is remembered."""
    asked, last = (len(table), table.shape[1], radians, tol), known.chosen[0]
    if last[0] != asked or last[1] is None:
        loops = known.loops if table.shape[1] == 1 else known.at_nodes
        found = _chosen(system, loops, len(table), radians, tol)
        known.chosen[0] = asked, found
        return found
    return last[1]


def _chosen(
    system: System, loops: tuple[Loop, ...], rows: int, radians: float, tol: float
) -> Chosen:
    """The loop that takes least work to prove an error, and how many steps its first run has, as
    many in each row; of rules that take as much the one of the highest order.
    """
    best: tuple[tuple[float, float], Chosen] | None = None
    for loop in loops:
        price = loop.price
        asked = max(refined_first(system, price, radians, tol), FEWEST)
        first = rows * math.ceil(asked / rows)
        shown = first_steps(price, radians, tol / (BELOW * price.more)) <= first
        cost = price.work * first * (SHOWN if shown else SEARCHED), price.root
        if best is None or cost < best[0]:
            best = cost, (loop, first)
    assert best is not None
    return best[1]


def _made(make: Callable[..., Any], rule: Rule, table: np.ndarray, grid: tuple, *how: Any) -> Any:
    """The field of a motion whose name is the last of what is given."""
    return controls_of_steps(rule, table, grid[2]) if how[-1] == "u" else make(grid, *how)


def controls_of_steps(rule: Rule, table: np.ndarray, steps: int) -> np.ndarray:
    """Those of so many steps, as many in each row of a table (rows, 1 or r, k): the same all along
    a row, or the polynomial through those at the rule's nodes in it.
    """
    parts = steps // len(table)
    if table.shape[1] == 1:
        return np.repeat(table, parts, axis=0)
    nodes = np.array(rule.nodes)
    at = ((np.arange(parts)[:, None] + nodes) / parts).ravel()
    u = np.einsum("pi,kij->kpj", lagrange_values(nodes, at), table)
    return np.ascontiguousarray(u.reshape(steps, len(nodes), -1))

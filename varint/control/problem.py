"""Phases and links as one sparse program, built once and solved as often as wanted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from time import perf_counter

import casadi as ca
import numpy as np

from varint.assembly import Kernels, Program, assembled
from varint.compiled.functions import compiled_functions, compiled_where_it_pays
from varint.control.contradictions import refuse_contradictions
from varint.control.ends import offsets
from varint.control.leg import Leg, leg
from varint.control.links import Link, Linked, linked
from varint.control.onto import ends_on_manifold
from varint.control.phase import Checked, Phase, checked
from varint.errors import InputError, converted
from varint.grid import checked_steps
from varint.parameters import number, whole
from varint.system import System


@dataclass(frozen=True, eq=False)
class Problem:
    """A discrete optimal control problem min f(x, p), g_low ≤ g(x, p) ≤ g_high, x_low ≤ x ≤ x_high."""

    legs: list[Leg]
    links: list[Linked]  # with what periodic ends ask for
    program: Program
    p: np.ndarray
    x_low: np.ndarray
    x_high: np.ndarray
    g_low: np.ndarray
    g_high: np.ndarray
    seconds: float
    kernels: Kernels | None = None
    given_links: tuple[Link, ...] = ()

    @property
    def unknowns(self) -> int:
        """Number of unknowns."""
        return len(self.x_low)


def problem(
    phases: Sequence[Phase],
    links: Sequence[Link],
    t0: float,
    backend: str = "interpreted",
    solves: float = 1,
    later: bool = False,
) -> Problem:
    """Transcribe the phases; those after a phase of free duration begin at an unknown time.

    `backend`, `solves`: how the kernels run, and how often the problem will be solved; see `kernels_by`. `later`: the
    state at the start will be given with every solve.
    """
    began, kernels = perf_counter(), kernels_by(backend, solves)
    t0 = number("t0", t0)
    checks = [checked(phase) for phase in phases]
    given_links = converted(lambda: tuple(links), lambda: f"links takes a list of varint.Link, got {links!r}")
    links = [*given_links, *(_periodic(i, x.end.periodic) for i, x in enumerate(checks) if x.end.periodic is not None)]
    for link in links:
        if not isinstance(link, Link):
            raise InputError(f"links takes a list of varint.Link, got {link!r}")
        before, after = whole("before of a link", link.before, 0), whole("after of a link", link.after, 0)
        if not (before < len(checks) and after < len(checks)):
            raise InputError(f"a link joins phases {link.before} and {link.after}; there are {len(checks)}: 0 …")
    legs: list[Leg] = []
    x = p = g = 0
    free_start = False
    for phase in checks:
        checked_steps(max(t0, t0 + phase.duration[0], key=abs), phase.shortest_step, 1)
        refuse_contradictions(phase, t0)
        tied = (later and not legs) or any(link.after == len(legs) and _ties_all(link, phase.system) for link in links)
        one = leg(phase, t0, free_start, tied, _judged_at(phase, t0), x, p, g)
        legs.append(one)
        x, p, g = one.slots.end, p + len(one.data), one.rows.end
        t0, free_start = t0 + phase.duration[0], free_start or phase.free_duration
    ties: list[Linked] = []
    for link in links:
        tie = linked(link, legs, x, g)
        ties.append(tie)
        x, g = x + tie.unknowns, g + tie.rows
    elements = [e for one in legs for e in one.elements] + [e for tie in ties for e in tie.elements]
    program = assembled(elements, x, p, g, kernels)
    return Problem(
        legs=legs,
        links=ties,
        program=program,
        p=np.concatenate([one.data for one in legs]),
        x_low=np.concatenate([*(one.x_low for one in legs), *(np.full(t.unknowns, -np.inf) for t in ties)]),
        x_high=np.concatenate([*(one.x_high for one in legs), *(np.full(t.unknowns, np.inf) for t in ties)]),
        g_low=np.concatenate([*(one.g_low for one in legs), *(np.zeros(t.rows) for t in ties)]),
        g_high=np.concatenate([*(one.g_high for one in legs), *(np.zeros(t.rows) for t in ties)]),
        seconds=perf_counter() - began,
        kernels=kernels,
        given_links=given_links,
    )


ITERATIONS = 20  # of a solver, about
CALLS = 2, 2, 1, 1  # of value, gradient, Jacobian and Hessian an iteration
BACKENDS = ("auto", "compiled", "interpreted")


def kernels_by(backend: str, solves: float = 1) -> Kernels | None:
    """How kernels are run: compiled, interpreted, or ("auto") compiled where that pays over so many solves."""
    if backend not in BACKENDS:
        raise InputError(f"backend={backend!r} is unknown; known: {list(BACKENDS)}")
    if backend == "interpreted":
        return None

    def kernels(made: list[ca.Function], copies: int) -> list[ca.Function]:
        if backend == "compiled":
            return compiled_functions(made)
        return compiled_where_it_pays(made, [copies * solves * ITERATIONS * calls for calls in CALLS])

    return kernels


def _judged_at(phase: Checked, t0: float) -> np.ndarray:
    """Ends (2, n) where the ranks of the constraints are judged: on the constraints, if they can be reached."""
    ends = end_positions(phase)
    if not phase.system.structure.constraints:
        return ends
    moves = np.array([end.q[1] < end.q[2] for end in (phase.start, phase.end)])
    return ends_on_manifold(phase.system, ends, t0 + phase.duration[0] * np.arange(2), phase.c, moves)[0]


def _ties_all(link: Link, system: System) -> bool:
    given, names = link.offset, system.names
    return given is None or not np.isnan(offsets("offset of a link", given, len(names), names)).any()


def _periodic(i: int, offset: np.ndarray) -> Link:
    """q_0 = q_N − offset, v_0 = v_N."""
    return Link(i, i, offset=[None if np.isnan(y) else -y for y in offset], time=False)


def end_positions(phase: Checked) -> np.ndarray:
    """Coordinates at both ends as far as they are given, else those of the other end, else 0; within bounds, (2, n)."""
    start, end = phase.start.q[0].copy(), phase.end.q[0].copy()
    offset = np.zeros(len(start)) if phase.end.periodic is None else np.nan_to_num(phase.end.periodic)
    start = np.where(np.isnan(start), end - offset, start)
    end = np.where(np.isnan(end), start + offset, end)
    return np.clip(np.nan_to_num(np.array([start, end])), *phase.bounds.q)

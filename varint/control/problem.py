"""Phases and links as one sparse program, built once and solved as often as wanted."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from time import perf_counter
from typing import Any

import casadi as ca
import numpy as np

from varint.codegen.functions import compiled_functions, compiled_where_it_pays
from varint.control.constrained_guess import move_ends_onto_constraints
from varint.control.ends import offsets
from varint.control.feasibility import check_feasibility
from varint.control.links import Link, LinkTranscription, transcribe_link, with_touching
from varint.control.phase import CheckedPhase, Phase, check_phase
from varint.control.transcription import PhaseTranscription, transcribe_phase
from varint.errors import InputError, parsed_or_refused
from varint.nlp.assembly import ITERATIONS, Kernels, assemble
from varint.nlp.program import NonlinearProgram
from varint.nlp.solver import Solver
from varint.numerics.limits import check_steps
from varint.results.trajectory import Trajectory
from varint.scene.inputs import number, positive_integer
from varint.scene.system import System


@dataclass(frozen=True, eq=False)
class ControlProblem:
    """A discrete optimal control problem: its phases and links, and the program that they add up
    to.
    """

    phases: list[PhaseTranscription]
    links: list[LinkTranscription]  # with what periodic ends ask for
    nlp: NonlinearProgram
    seconds: float
    kernels: Kernels | None = None
    given_links: tuple[Link, ...] = ()
    solver: Solver | None = None  # once it is built
    again: Callable[[Trajectory, ControlProblem], Any] | None = None  # how it is solved anew

    @property
    def unknowns(self) -> int:
        """Number of unknowns."""
        return self.nlp.unknowns

    def interval_kernels(self, part: PhaseTranscription) -> tuple[ca.Function, ...]:
        """Value, gradient, Jacobian and Hessian of one interval of a phase."""
        before = [x for x in self.phases if x.first_datum < part.first_datum]
        return self.nlp.program.terms[sum(len(x.elements) for x in before)]


def transcribe(
    phases: Sequence[Phase],
    links: Sequence[Link],
    t0: float,
    backend: str = "interpreted",
    solves: float = 1,
    later: bool = False,
) -> ControlProblem:
    """Transcribe the phases; those after a phase of free duration begin at an unknown time.

    `backend`, `solves`: how the kernels run, and how often the problem will be solved; see
    `choose_kernels`. `later`: the state at the start will be given with every solve.
    """
    began, kernels = perf_counter(), choose_kernels(backend, solves)
    t0 = number("t0", t0)
    checks = [check_phase(phase) for phase in phases]
    given_links = parsed_or_refused(
        lambda: tuple(links), lambda: f"links takes a list of varint.Link, got {links!r}"
    )
    links = [
        *given_links,
        *(_periodic(i, x.end.periodic) for i, x in enumerate(checks) if x.end.periodic is not None),
    ]
    for link in links:
        if not isinstance(link, Link):
            raise InputError(f"links takes a list of varint.Link, got {link!r}")
        before, after = (
            positive_integer("before of a link", link.before, 0),
            positive_integer("after of a link", link.after, 0),
        )
        if not (before < len(checks) and after < len(checks)):
            raise InputError(
                f"a link joins phases {link.before} and {link.after}; there are {len(checks)}: 0 …"
            )
    checks = with_touching(checks, links)
    transcriptions: list[PhaseTranscription] = []
    x = p = g = 0
    free_start = False
    for phase in checks:
        check_steps(max(t0, t0 + phase.duration[0], key=abs), phase.shortest_step, 1)
        check_feasibility(phase, t0)
        tied = (later and not transcriptions) or any(
            link.after == len(transcriptions) and _ties_all(link, phase.system) for link in links
        )
        transcription = transcribe_phase(
            phase, t0, free_start, tied, _judged_at(phase, t0), x, p, g
        )
        transcriptions.append(transcription)
        x, p, g = transcription.slots.end, p + len(transcription.data), transcription.rows.end
        t0, free_start = t0 + phase.duration[0], free_start or phase.free_duration
    ties: list[LinkTranscription] = []
    for link in links:
        tie = transcribe_link(link, transcriptions, x, g)
        ties.append(tie)
        x, g = x + tie.unknowns, g + tie.rows
    elements = [e for part in transcriptions for e in part.elements]
    elements += [e for tie in ties for e in tie.elements]
    program = assemble(elements, x, p, g, kernels, solves)
    nlp = NonlinearProgram(
        program=program,
        p=np.concatenate([part.data for part in transcriptions]),
        x_low=np.concatenate(
            [
                *(part.x_low for part in transcriptions),
                *(t.x_low for t in ties),
            ]
        ),
        x_high=np.concatenate(
            [
                *(part.x_high for part in transcriptions),
                *(np.full(t.unknowns, np.inf) for t in ties),
            ]
        ),
        g_low=np.concatenate(
            [*(part.g_low for part in transcriptions), *(np.zeros(t.rows) for t in ties)]
        ),
        g_high=np.concatenate(
            [*(part.g_high for part in transcriptions), *(np.zeros(t.rows) for t in ties)]
        ),
    )
    return ControlProblem(transcriptions, ties, nlp, perf_counter() - began, kernels, given_links)


CALLS = 2, 2, 1, 1  # of value, gradient, Jacobian and Hessian an iteration
BACKENDS = ("auto", "compiled", "interpreted")


def choose_kernels(backend: str, solves: float = 1) -> Kernels | None:
    """How kernels are run: compiled, interpreted, or ("auto") compiled where that pays over so
    many solves.
    """
    if backend not in BACKENDS:
        raise InputError(f"backend={backend!r} is unknown; known: {list(BACKENDS)}")
    if backend == "interpreted":
        return None

    def kernels(made: list[ca.Function], copies: int) -> list[ca.Function]:
        if backend == "compiled":
            return compiled_functions(made)
        return compiled_where_it_pays(
            made, [copies * solves * ITERATIONS * calls for calls in CALLS]
        )

    return kernels


def _judged_at(phase: CheckedPhase, t0: float) -> np.ndarray:
    """Ends (2, n) where the ranks of the constraints are judged: on the constraints, if they can
    be reached.
    """
    ends = guess_ends(phase)
    if not phase.system.structure.constraints:
        return ends
    moves = np.array([end.q[1] < end.q[2] for end in (phase.start, phase.end)])
    return move_ends_onto_constraints(
        phase.system, ends, t0 + phase.duration[0] * np.arange(2), phase.c, moves
    )[0]


def _ties_all(link: Link, system: System) -> bool:
    given, names = link.offset, system.names
    return (
        given is None or not np.isnan(offsets("offset of a link", given, len(names), names)).any()
    )


def _periodic(i: int, offset: np.ndarray) -> Link:
    """q_0 = q_N − offset, v_0 = v_N."""
    return Link(i, i, offset=[None if np.isnan(y) else -y for y in offset], time=False)


def guess_ends(phase: CheckedPhase) -> np.ndarray:
    """Coordinates at both ends as far as they are given, else those of the other end, else 0;
    within bounds, (2, n).
    """
    start, end = phase.start.q[0].copy(), phase.end.q[0].copy()
    offset = (
        np.zeros(len(start)) if phase.end.periodic is None else np.nan_to_num(phase.end.periodic)
    )
    start = np.where(np.isnan(start), end - offset, start)
    end = np.where(np.isnan(end), start + offset, end)
    return np.clip(np.nan_to_num(np.array([start, end])), *phase.bounds.q)

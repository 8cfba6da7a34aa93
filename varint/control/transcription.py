"""One phase as part of a large sparse program: where its unknowns, data and rows sit, their bounds,
its elements.

Unknowns by stage: q_k, λ_k, u_k, inner points, inner λ, …, q_N, λ_N, then the end velocities and
what is shared (start time, duration, parameters, as far as they are free). Rows by stage: momentum
matching p⁺_{k−1} − p⁻_k = 0 at node k, inner rows, constraints, path bounds. Ends: ∂L/∂v(q_0, v_0)
− p⁻_0 = 0 and p⁺_{N−1} − ∂L/∂v(q_N, v_N) = 0.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np

from varint.control.end_rows import find_kept_rows
from varint.control.kernels import (
    IntervalTerm,
    Shared,
    end_term,
    interval_term,
    shared_symbols,
)
from varint.control.layout import (
    Rows,
    Slots,
    bound_unknowns,
    place_rows,
    place_unknowns,
)
from varint.control.phase import CheckedPhase
from varint.nlp.assembly import Element


@dataclass(frozen=True, eq=False)
class PhaseFunctions:
    """What is evaluated at a solution, built when first asked for and kept whatever numbers the
    problem is solved with.
    """

    phase: CheckedPhase

    @cached_property
    def at_end(self) -> ca.Function:
        """(q, v, states, slacks, t, c) → (terminal cost, momentum) at the end."""
        s, phase = self.phase.system, self.phase
        inputs = [s.q, s.v, phase.states.symbols(s), phase.end_slacks.symbols, s.t, s.c]
        outputs = [ca.densify(phase.terminal), ca.densify(s.momentum)]
        return ca.Function("terminal", inputs, outputs)

    @cached_property
    def momentum(self) -> ca.Function:
        """(q, v, t, c) → ∂L/∂v."""
        s = self.phase.system
        return ca.Function("momentum", [s.q, s.v, s.t, s.c], [ca.densify(s.momentum)])

    @cached_property
    def slacks(self) -> ca.Function:
        """(q, v, u, rates, t, c) → what the slacks at a node are."""
        s, rates = self.phase.system, self.phase.rates.symbols
        values = ca.densify(self.phase.slacks.values)
        return ca.Function("slacks", [s.q, s.v, s.control, rates, s.t, s.c], [values])

    @cached_property
    def end_slacks(self) -> ca.Function:
        """(q, v, states, t, c) → what the slacks at the end are."""
        s, phase = self.phase.system, self.phase
        values = ca.densify(phase.end_slacks.values)
        return ca.Function("end_slacks", [s.q, s.v, phase.states.symbols(s), s.t, s.c], [values])

    @cached_property
    def slack_slopes(self) -> ca.Function:
        """(q, v, u, rates, t, c, slacks) → slopes of the running cost in the largest values."""
        s, own = self.phase.system, self.phase.slacks
        largest = ca.vertcat(*(x.symbol for x in own.largest))
        inputs = [s.q, s.v, s.control, self.phase.rates.symbols, s.t, s.c, own.symbols]
        return ca.Function(
            "slack_slopes", inputs, [ca.densify(ca.gradient(self.phase.cost, largest))]
        )


@dataclass(frozen=True, eq=False)
class PhaseTranscription:
    """A phase in the program."""

    phase: CheckedPhase
    slots: Slots
    rows: Rows
    interval: IntervalTerm
    shared: Shared
    functions: PhaseFunctions
    data: np.ndarray  # s_k, w_k, then t0, T, c: the program's constants of this phase
    first_datum: int
    x_low: np.ndarray
    x_high: np.ndarray
    g_low: np.ndarray
    g_high: np.ndarray
    elements: list[Element]

    @property
    def first_row(self) -> int:
        """Where its rows begin."""
        return self.rows.end - len(self.g_low)

    @property
    def first_shared(self) -> int:
        """Where t0, T and c begin among the program's constants."""
        return self.first_datum + 2 * self.phase.steps

    @property
    def t0(self) -> float:
        """The start time, or its guess."""
        return float(self.data[2 * self.phase.steps])

    def shared_values(self, x: np.ndarray, constants: np.ndarray | None = None) -> np.ndarray:
        """t0, T and c at a point x, or the program's constants where they are fixed."""
        own = self.data if constants is None else constants[self.first_datum :][: len(self.data)]
        places = self.slots.shared
        return np.where(places >= 0, x[places], own[2 * self.phase.steps :])


def transcribe_phase(
    phase: CheckedPhase,
    t0: float,
    free_start: bool,
    tied: bool,
    q_ends: np.ndarray,
    x: int,
    p: int,
    g: int,
) -> PhaseTranscription:
    """Place a phase behind x unknowns, p data and g rows.

    `free_start`: the start time is an unknown; `tied`: a link gives all of the start;
    `q_ends` (2, n): where constraint ranks at the ends are judged.
    """
    shared = shared_symbols(phase)
    term = interval_term(phase, shared)
    ends = [end_term(phase, shared, last) for last in (False, True)]
    slots = place_unknowns(phase, free_start, x)
    kept = [
        find_kept_rows(phase, t0, tied, q_ends[0], False),
        find_kept_rows(phase, t0, False, q_ends[1], True),
    ]
    rows, low, high = place_rows(phase, term, ends, kept, g)
    steps = np.diff(phase.mesh)
    data = np.concatenate([phase.mesh[:-1], steps, [t0, phase.duration[0]], phase.c])
    x_low, x_high = bound_unknowns(phase, slots, x)
    elements = _elements(phase, term, ends, slots, rows, shared, p)
    return PhaseTranscription(
        phase=phase,
        slots=slots,
        rows=rows,
        interval=term,
        shared=shared,
        functions=PhaseFunctions(phase),
        data=data,
        first_datum=p,
        x_low=x_low,
        x_high=x_high,
        g_low=low,
        g_high=high,
        elements=elements,
    )


def pick(column: ca.SX, places: np.ndarray) -> ca.SX:
    """Entries of a column as a column, also where there are none (an empty index has a shape of
    its own).
    """
    return ca.vertcat(ca.SX(0, 1), *(column[int(i)] for i in places))


def _elements(
    phase, term: IntervalTerm, ends, slots: Slots, rows: Rows, shared: Shared, p: int
) -> list[Element]:
    """The interval, the two ends and, where asked for, the periodic link."""
    count, free = phase.steps, slots.shared >= 0
    symbols = shared.column
    unknown, known = (pick(symbols, np.flatnonzero(is_one)) for is_one in (free, ~free))
    fixed_data = p + 2 * count + np.flatnonzero(~free)

    def element(variables, x, mesh, step, cost, shares, g) -> Element:
        copies = len(x)
        return Element(
            variables=ca.vertcat(*variables, unknown),
            constants=ca.vertcat(mesh, known),
            cost=cost,
            rows=ca.vertcat(*shares),
            x=np.hstack([x, np.tile(slots.shared[free], (copies, 1))]),
            p=np.hstack(
                [p + step[:, None], p + count + step[:, None], np.tile(fixed_data, (copies, 1))]
            ),
            g=np.hstack(g),
        )

    stride = term.stage.numel()
    stages = slots.q[:-1, :1] + np.arange(stride)
    found = [
        element(
            [term.stage, term.after],
            np.hstack([stages, slots.after]),
            term.mesh,
            np.arange(count),
            term.cost,
            [term.shares],
            [rows.of_intervals],
        )
    ]
    first, last = ends
    x_first, x_last = (
        np.hstack([slots.q[0], slots.v[0], slots.states[0]]),
        np.hstack([slots.q[-1], slots.v[1], slots.states[-1], slots.lam[-1], slots.end_slack]),
    )
    found.append(
        element(
            [first.q, first.v, first.states],
            x_first[None],
            first.mesh,
            np.array([0]),
            first.cost,
            [first.momentum, first.gap, first.hidden, first.rows, first.points],
            [rows.momentum[:1], rows.start[None]],
        )
    )
    found.append(
        element(
            [last.q, last.v, last.states, last.lam, last.slack],
            x_last[None],
            last.mesh,
            np.array([count - 1]),
            last.cost,
            [-last.momentum, -last.states, last.hidden, last.rows],
            [rows.momentum[-1:], rows.states[-1:], rows.last[None]],
        )
    )
    return found


def control_points(x: np.ndarray, transcription: PhaseTranscription) -> np.ndarray:
    """Positions at the control points of every step, (N, d + 1, n)."""
    slots = transcription.slots
    return np.concatenate(
        [x[slots.q[:-1]][:, None], x[slots.inner], x[slots.q[1:]][:, None]], axis=1
    )


def controls_at_nodes(x: np.ndarray, transcription: PhaseTranscription) -> np.ndarray:
    """Controls at the quadrature nodes of every step, (N, r, k); (N, 1, k) where they are
    constant.
    """
    phase, u = transcription.phase, x[transcription.slots.u]
    if phase.linear:
        return u[:-1] + np.array(phase.rule.nodes)[:, None] * (u[1:] - u[:-1])
    return u[: phase.steps]


def control_samples(x: np.ndarray, transcription: PhaseTranscription) -> np.ndarray:
    """Controls at `control_places` of every step, (N, places, k)."""
    phase, u = transcription.phase, x[transcription.slots.u]
    return np.concatenate([u[:-1], u[1:]], axis=1) if phase.linear else u[: phase.steps]

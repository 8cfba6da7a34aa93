"""Where the unknowns and the rows of a phase sit in the program, and their bounds."""

from __future__ import annotations

from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from varint.control.end_rows import bounded_at_end
from varint.control.kernels import EndTerm, IntervalTerm
from varint.control.phase import CheckedPhase


class Slots(NamedTuple):
    """Indices of a phase's quantities among the unknowns; a shared quantity that is fixed has
    index −1.
    """

    q: np.ndarray  # (N + 1, n)
    lam: np.ndarray  # (N + 1, m + non-holonomic rows)
    states: np.ndarray  # (N + 1, m)
    u: np.ndarray  # (N, samples, k); (N + 1, 1, k) where the last node has controls
    inner: np.ndarray  # (N, d − 1, n)
    lam_inner: np.ndarray  # (N, d − 1, m)
    slack: np.ndarray  # (N, r, slacks)
    v: np.ndarray  # (2, n)
    end_slack: np.ndarray  # (slacks at the end,)
    shared: np.ndarray  # (2 + number of parameters,): t0, T, c
    end: int

    @property
    def after(self) -> np.ndarray:
        """What of the next node an interval needs, (N, n or n + k)."""
        steps = len(self.q) - 1
        closing = self.u[1:].reshape(steps, -1) if len(self.u) > steps else self.q[1:, :0]
        return np.hstack([self.q[1:], closing])


class Rows(NamedTuple):
    """Indices of a phase's rows; −1: left out."""

    momentum: np.ndarray  # (N + 1, n)
    inner: np.ndarray  # (N, n (d − 1))
    gaps: np.ndarray  # (N, m d + non-holonomic rows)
    nodes: np.ndarray  # (N, r b)
    points: np.ndarray  # (N, d a)
    steps: np.ndarray  # (N, s)
    state_inner: np.ndarray  # (N, r m)
    states: np.ndarray  # (N, m): balance of the states over step k
    integrals: np.ndarray  # (i,)
    start: np.ndarray  # gap, hidden, conditions, points at node 0
    last: np.ndarray  # hidden, conditions
    end: int

    @property
    def of_intervals(self) -> np.ndarray:
        """Rows to which the shares of every interval belong, in the order of
        `IntervalTerm.shares`.
        """
        before = np.vstack([np.full_like(self.states[:1], -1), self.states[:-1]])
        return np.hstack(
            [
                self.momentum[:-1],
                self.inner,
                self.gaps,
                self.nodes,
                self.points,
                self.steps,
                self.state_inner,
                before,
                self.states,
                np.tile(self.integrals, (len(self.inner), 1)),
                self.momentum[1:],
            ]
        )


def place_unknowns(phase: CheckedPhase, free_start: bool, x: int) -> Slots:
    """Indices of the unknowns of a phase behind x others: stage by stage, then the end velocities
    and what is shared.
    """
    s, count, degree = phase.system.structure, phase.steps, phase.rule.degree
    shapes = {
        "q": (s.n,),
        "lam": (s.velocity_rows,),
        "states": (len(phase.states.index),),
        "u": (phase.samples, s.controls),
        "inner": (degree - 1, s.n),
        "lam_inner": (degree - 1, s.constraints),
        "slack": (len(phase.rule.nodes), phase.slacks.count),
    }
    sizes = [int(np.prod(shape)) for shape in shapes.values()]
    stages = x + np.arange((count + 1) * sum(sizes)).reshape(count + 1, -1)
    parts = np.split(stages, np.cumsum(sizes)[:-1], axis=1)
    at = {
        name: part.reshape(count + 1, *shape)
        for (name, shape), part in zip(shapes.items(), parts, strict=True)
    }
    # the last node has coordinates, multipliers and states, but no step behind it
    closing = phase.closing_controls
    before_v = s.n + s.velocity_rows + len(phase.states.index) + closing
    v = stages[-1, 0] + before_v + np.arange(2 * s.n).reshape(2, s.n)
    end_slack = v[-1, -1] + 1 + np.arange(phase.end_slacks.count)
    first = v[-1, -1] + 1 + len(end_slack)
    is_free = np.concatenate(
        [[free_start, phase.free_duration], phase.c_low < phase.c_high]
    ).astype(bool)
    return Slots(
        q=at["q"],
        lam=at["lam"],
        states=at["states"],
        u=at["u"] if closing else at["u"][:-1],
        inner=at["inner"][:-1],
        lam_inner=at["lam_inner"][:-1],
        slack=at["slack"][:-1],
        v=v,
        end_slack=end_slack,
        shared=np.where(is_free, first + np.cumsum(is_free) - 1, -1),
        end=int(first + is_free.sum()),
    )


class Block(NamedTuple):
    """Rows of one kind, copies × rows of a copy: their bounds, and which of them are imposed."""

    low: np.ndarray
    high: np.ndarray
    kept: np.ndarray


def _block(copies: int, low: np.ndarray, high: np.ndarray, kept: Any = True) -> Block:
    """Equal rows for every copy."""
    shape = (copies, len(low))
    return Block(
        np.broadcast_to(low, shape), np.broadcast_to(high, shape), np.full(shape, kept, dtype=bool)
    )


def _equations(copies: int, rows: ca.SX, kept: Any = True) -> Block:
    """Rows that are zero."""
    zero = np.zeros(rows.numel())
    return _block(copies, zero, zero, kept)


def place_rows(
    phase: CheckedPhase,
    term: IntervalTerm,
    ends: list[EndTerm],
    kept: list[tuple[np.ndarray, np.ndarray]],
    g: int,
) -> tuple[Rows, np.ndarray, np.ndarray]:
    """Indices and bounds of the rows of a phase behind g others, stage by stage, then its ends.

    `kept`: which constraints on coordinates and on velocities are imposed at the start and at the
    end. Rows that would be imposed twice are left out.
    """
    bounds, points, nodes = phase.bounds, phase.rule.degree, len(phase.rule.nodes)
    own, at_end = phase.slacks, phase.end_slacks
    bounded = [bounded_at_end(phase, last) for last in (False, True)]
    first, last = ends
    stage = {
        "momentum": _equations(phase.steps, term.p_minus),
        "inner": _equations(phase.steps, term.inner),
        "gaps": _equations(phase.steps, term.gaps),
        "nodes": _block(
            phase.steps,
            np.tile(np.append(bounds.nodes_low, own.rows_low), nodes),
            np.tile(np.append(bounds.nodes_high, own.rows_high), nodes),
        ),
        "points": _block(
            phase.steps, np.tile(bounds.points_low, points), np.tile(bounds.points_high, points)
        ),
    }
    stage |= {
        "steps": _block(phase.steps, bounds.steps_low, bounds.steps_high),
        "state_inner": _equations(phase.steps, term.state_inner),
        "states": _equations(phase.steps, term.states),
    }
    m = len(kept[1][0])
    stage["gaps"].kept[-1, m * (points - 1) : m * points] = kept[1][0]
    stage["points"].kept.reshape(phase.steps, points, -1)[-1, -1] = bounded[1]
    at_ends = {
        "end_momentum": _equations(1, term.p_minus),
        "start_gap": _equations(1, first.gap, kept[0][0]),
        "start_hidden": _equations(1, first.hidden, kept[0][1]),
        "start_conditions": _block(1, phase.start.low, phase.start.high),
        "start_points": _block(1, bounds.points_low, bounds.points_high, bounded[0]),
        "end_hidden": _equations(1, last.hidden, kept[1][1]),
        "end_conditions": _block(
            1,
            np.append(phase.end.low, at_end.rows_low),
            np.append(phase.end.high, at_end.rows_high),
        ),
        "integrals": _block(1, phase.integrals.low, phase.integrals.high),
    }
    at: dict[str, np.ndarray] = {}
    low, high = [], []
    for blocks in (stage, at_ends):
        imposed = np.hstack([block.kept for block in blocks.values()])
        number = np.where(imposed, g + np.cumsum(imposed).reshape(imposed.shape) - 1, -1)
        edges = np.cumsum([block.kept.shape[1] for block in blocks.values()])[:-1]
        at |= zip(blocks, np.split(number, edges, axis=1), strict=True)
        low.append(np.hstack([block.low for block in blocks.values()])[imposed])
        high.append(np.hstack([block.high for block in blocks.values()])[imposed])
        g += int(imposed.sum())
    start = ("start_gap", "start_hidden", "start_conditions", "start_points")
    rows = Rows(
        momentum=np.vstack([at["momentum"], at["end_momentum"]]),
        inner=at["inner"],
        gaps=at["gaps"],
        nodes=at["nodes"],
        points=at["points"],
        steps=at["steps"],
        state_inner=at["state_inner"],
        states=at["states"],
        integrals=at["integrals"][0],
        start=np.concatenate([at[name][0] for name in start]),
        last=np.concatenate([at[name][0] for name in ("end_hidden", "end_conditions")]),
        end=g,
    )
    return rows, np.concatenate(low), np.concatenate(high)


def bound_unknowns(phase: CheckedPhase, slots: Slots, x: int) -> tuple[np.ndarray, np.ndarray]:
    """Bounds on the unknowns of the phase."""
    low, high = np.full(slots.end - x, -np.inf), np.full(slots.end - x, np.inf)
    bounds, last_q = phase.bounds, slots.q[-1] - x
    for side, array in ((0, low), (1, high)):
        array[slots.q - x] = bounds.q[side]
        array[slots.inner - x] = bounds.q[side]
        array[slots.u - x] = bounds.u[side]
        array[slots.v - x] = bounds.v[side]
        if side == 0:
            array[slots.slack - x] = phase.slacks.low
            array[slots.end_slack - x] = phase.end_slacks.low
        states = bounds.u[side][phase.states.index]
        array[slots.states - x] = states
        tighter = np.maximum if side == 0 else np.minimum
        for end, q, v, z in (
            (phase.start, slots.q[0] - x, slots.v[0] - x, slots.states[0] - x),
            (phase.end, last_q, slots.v[1] - x, slots.states[-1] - x),
        ):
            for given, at in ((end.q, q), (end.v, v), (end.states, z)):
                array[at] = tighter(array[at], given[1 + side])
        free = slots.shared >= 0
        values = np.concatenate(
            [[(-np.inf, np.inf)[side], phase.duration[1 + side]], (phase.c_low, phase.c_high)[side]]
        )
        array[slots.shared[free] - x] = values[free]
    return low, high

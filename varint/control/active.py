"""Bounds along the path: where they are met with equality, and what holds them in the program."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from varint.control.transcription import PhaseTranscription
from varint.nlp.solver import SolverResult

ACTIVE = 1e-6  # of a range: this close to its bound a quantity is at it


@dataclass(frozen=True, eq=False)
class Quantity:
    """What is bounded along the path.

    Attributes
    ----------
    name : str
    low, high : float
    values, times : ndarray (N, m)
        At all places where it is bounded; NaN where it is not.
    held : ndarray of int (N, m)
        The unknown, or the row, that holds each of them; −1: none.
    is_row : bool
        Which of the two.
    """

    name: str
    low: float
    high: float
    values: np.ndarray
    times: np.ndarray
    held: np.ndarray
    is_row: bool

    @property
    def places(self) -> np.ndarray:
        """Each unknown or row once."""
        return np.unique(self.held[self.held >= 0])

    def sides(self) -> list[tuple[str, float, float]]:
        """Its finite bounds: a name, the bound, and the sign of its multiplier."""
        both = ((">=", self.low, -1.0), ("<=", self.high, 1.0))
        return [
            (f"{self.name} {relation} {bound:g}", bound, sign)
            for relation, bound, sign in both
            if np.isfinite(bound)
        ]


def bounded_quantities(part: PhaseTranscription, outcome: SolverResult) -> list[Quantity]:
    """All quantities that are bounded along the path of a phase."""
    phase, slots, rows, rule = part.phase, part.slots, part.rows, part.phase.rule
    s, bounds, x, nlp = phase.system, phase.bounds, outcome.x, outcome.nlp
    t0, duration = part.shared_values(x, nlp.p)[:2]
    begin, size = phase.mesh[:-1, None], np.diff(phase.mesh)[:, None]
    points, nodes, controls = (
        t0 + duration * (begin + size * np.array(at))
        for at in (rule.points, rule.nodes, phase.control_places)
    )
    q = np.concatenate([slots.q[:-1, None], slots.inner, slots.q[1:, None]], axis=1)
    simple = [(name, bounds.q[:, i], points, q[..., i]) for i, name in enumerate(s.names)]
    u = np.concatenate([slots.u[:-1], slots.u[1:]], axis=1) if phase.linear else slots.u
    simple += [
        (name, bounds.u[:, i], controls, u[: phase.steps, :, i])
        for i, name in enumerate(s.control_names)
    ]
    simple += [
        (str(s.v[i]), bounds.v[:, i], np.array([[t0], [t0 + duration]]), slots.v[:, i, None])
        for i in range(len(s.names))
    ]
    found = [
        Quantity(name, float(low), float(high), x[held], at, held, False)
        for name, (low, high), at, held in simple
    ]
    g = np.append(np.array(nlp.program.value(x, nlp.p)[1]).ravel(), np.nan)  # −1: left out
    for i, name in enumerate(bounds.nodes_names):
        held = rows.nodes[:, i :: bounds.at_nodes.numel() + phase.slacks.rows.numel()]
        limits = bounds.nodes_low[i], bounds.nodes_high[i]
        found.append(Quantity(name, *limits, g[held], nodes, held, True))
    middle = t0 + duration * (begin + size / 2)
    for i, name in enumerate(map(str, ca.vertsplit(bounds.at_steps))):
        held = rows.steps[:, i : i + 1]
        limits = bounds.steps_low[i], bounds.steps_high[i]
        found.append(Quantity(name, *limits, g[held], middle, held, True))
    count = bounds.at_points.numel()
    for i, name in enumerate(bounds.points_names):
        first = np.full((phase.steps, 1), -1)  # at node 0 the row stands among those of the start
        first[0] = rows.start[len(rows.start) - count + i]
        held = np.hstack([first, rows.points[:, i::count]])
        limits = bounds.points_low[i], bounds.points_high[i]
        found.append(Quantity(name, *limits, g[held], points, held, True))
    return found


def bounded_integrals(part: PhaseTranscription, outcome: SolverResult) -> list[Quantity]:
    """All integrals that are bounded over a phase; they have no time."""
    own, rows, nlp = part.phase.integrals, part.rows.integrals, outcome.nlp
    g, never = nlp.program.value(outcome.x, nlp.p)[1].full().ravel(), np.full((1, 1), np.nan)
    return [
        Quantity(name, float(low), float(high), g[row, None, None], never, row[None, None], True)
        for name, low, high, row in zip(own.names, own.low, own.high, rows, strict=True)
    ]


def active_bounds(part: PhaseTranscription, outcome: SolverResult) -> dict[str, np.ndarray]:
    """Bounds along the path that are met with equality, and the times where they are."""
    found: dict[str, np.ndarray] = {}
    for quantity in bounded_quantities(part, outcome):
        for name, bound, _ in quantity.sides():
            close = np.abs(quantity.values - bound) <= ACTIVE * max(1.0, abs(bound))
            if close.any():
                before = found.get(name, np.zeros(0))
                found[name] = np.unique(np.append(before, quantity.times[close]))
    return found

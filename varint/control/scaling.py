"""Units that suit a solver: unknowns, rows and cost of the order of one, by powers of ten.

q is measured by its largest start value, v by that over the duration, p by M v, controls by the
force that gains p in the duration, the cost by its order. Scenes in natural units are left alone:
only sizes below 1/`NATURAL` or above `NATURAL` are scaled.
"""

from __future__ import annotations

import numpy as np

from varint.control.problem import ControlProblem
from varint.control.transcription import PhaseTranscription
from varint.nlp.arrangement import Scales

NATURAL = 30.0
DEAR = 1e6  # times the cost of the cheapest control, each used at its size
ROUNDING = 1e-12  # of the largest coordinate: smaller start values are zeros


def choose_scales(problem: ControlProblem, x: np.ndarray) -> Scales:
    """Scales from the start values, the bounds and the derivatives at the start."""
    size, factor = np.ones(problem.unknowns), np.ones(len(problem.nlp.g_low))
    rows, columns, values = _absolute(problem.nlp.program.jacobian(x, problem.nlp.p)[1])
    for transcription in problem.phases:
        _scale_phase(size, factor, transcription, problem, x, (rows, columns, values))
    rows, columns, curvature = _absolute(
        problem.nlp.program.hessian(x, problem.nlp.p, 1, np.zeros(len(problem.nlp.g_low)))
    )
    diagonal = np.zeros(len(size))
    diagonal[rows[rows == columns]] = curvature[rows == columns]
    _limit_dear_controls(size, problem, diagonal)
    order = float((diagonal * size**2).sum())
    slope = np.abs(np.array(problem.nlp.program.gradient(x, problem.nlp.p)[1]).ravel()) * size
    return Scales(size, 1 / _power(max(order, float(slope.max(initial=0.0)))), factor)


def _limit_dear_controls(size: np.ndarray, problem: ControlProblem, curvature: np.ndarray) -> None:
    """A control that hardly acts, measured by the force it would have to give, would cost so much
    that no tolerance sees the cost of the others: it is measured by what costs as much as they do.
    """
    for transcription in problem.phases:
        u = transcription.slots.u
        groups = [u[..., i].ravel() for i in range(u.shape[2])]
        costs = np.array([(curvature[at] * size[at] ** 2).sum() for at in groups])
        least = costs[costs > 0].min(initial=np.inf)
        for at, cost in zip(groups, costs, strict=True):
            if cost > DEAR * least:
                size[at] *= 10.0 ** np.round(np.log10(least / cost) / 2)


def _scale_phase(
    size, factor, transcription: PhaseTranscription, problem: ControlProblem, x, jacobian
) -> None:
    """Write the scales of one phase."""
    slots, rows = transcription.slots, transcription.rows
    free_t, duration = slots.shared[1], transcription.phase.duration[0]
    if free_t >= 0:
        size[free_t] = _power(duration)
    for i in slots.shared[2:][slots.shared[2:] >= 0]:
        size[i] = _power(abs(x[i]))
    n = slots.q.shape[1]
    reach = np.array([_reach(problem, x, slots.q[:, i]) for i in range(n)])
    reach = np.where(reach > ROUNDING * reach.max(initial=0.0), reach, 1.0)
    q = np.array([_power(y) for y in reach])
    speed = reach / duration
    v = np.array([_power(y) for y in speed])
    size[slots.q], size[slots.inner], size[slots.v] = q, q, v
    row, column, value = jacobian
    entries = np.zeros((n, n))
    for i in range(n):
        for j in range(n):
            at = (row == rows.momentum[0, i]) & (column == slots.v[0, j])
            entries[i, j] = value[at].sum()
    momentum = (entries * speed).sum(axis=1)
    momentum = np.where(momentum > ROUNDING * momentum.max(initial=0.0), momentum, 1.0)
    p = np.array([_power(y) for y in momentum])
    factor[rows.momentum], factor[rows.inner] = 1 / p, 1 / np.tile(p, rows.inner.shape[1] // n)
    kind = np.full(len(factor), np.inf)
    kind[rows.momentum] = momentum
    for group in (slots.u, slots.lam[:, None], slots.lam_inner):
        for i in range(group.shape[2]):
            acts = np.isin(column, group[..., i].ravel())
            strongest = float((value[acts] / kind[row[acts]]).max(initial=0.0)) * len(group)
            size[group[..., i]] = _power(1 / strongest) if strongest > 0 else 1.0
    if len(slots.slack.ravel()) + len(slots.end_slack):
        _scale_slacks(size, factor, transcription, problem, x, jacobian)


def _scale_slacks(
    size, factor, transcription: PhaseTranscription, problem: ControlProblem, x, jacobian
) -> None:
    """Slacks are measured by what stands in their rows beside them, on a path that moves by the
    sizes of all else, and so are these rows.
    """
    slots, (row, column, _), nlp = transcription.slots, jacobian, problem.nlp
    moved = x + size * np.linspace(1, 2, len(x))
    moved[slots.slack], moved[slots.end_slack] = 0.0, 0.0
    values = np.abs(nlp.program.value(moved, nlp.p)[1].full().ravel())
    for side in (nlp.g_low, nlp.g_high):
        values = np.maximum(values, np.where(np.isfinite(side), np.abs(side), 0))
    kinds = [slots.slack[..., i].ravel() for i in range(slots.slack.shape[2])]
    for places in [*kinds, *slots.end_slack[:, None]]:
        own = np.unique(row[np.isin(column, places)])
        size[places] = _power(float(values[own].max(initial=0.0)))
        factor[own] = 1 / size[places[0]]


def _reach(problem: ControlProblem, x: np.ndarray, index: np.ndarray) -> float:
    """Size of a coordinate: its largest start value, or its smallest finite bound where that is
    0.
    """
    found = float(np.abs(x[index]).max(initial=0.0))
    sides = np.abs(np.concatenate([problem.nlp.x_low[index], problem.nlp.x_high[index]]))
    sides = sides[np.isfinite(sides) & (sides > 0)]
    return found if found > 0 or not len(sides) else float(sides.min())


def _power(size: float) -> float:
    """The power of ten next to a size; 1 for natural sizes and for 0."""
    if not np.isfinite(size) or size == 0 or 1 / NATURAL <= size <= NATURAL:
        return 1.0
    return float(10.0 ** np.round(np.log10(size)))


def _absolute(matrix) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rows, columns = (np.array(part, dtype=int) for part in matrix.sparsity().get_triplet())
    return rows, columns, np.abs(np.array(matrix.nonzeros()))

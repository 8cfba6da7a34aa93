"""The controls of a solution played back in parts of its steps, all parts at once.

Newton's method on the whole chain of smaller steps, from the path itself. The unknowns of a part
are y, its inner points and its end q₁; position and momentum (q, p) are handed on,

    p − p⁻(q, y) = 0,   inner rows (q, y) = 0,   (q, p) ← (q₁, p⁺(q, y)).

Rows and slopes are those of the program's own interval, for all parts in one call; y is eliminated
from all of them at once, and what is left is a recursion of 2n numbers. Slopes are kept while they
serve: near a motion those of the path do. It is the discrete motion of `simulate`, without a step
function of the scene.
"""

from __future__ import annotations

from typing import NamedTuple

import casadi as ca
import numpy as np

from varint.control.piecewise import Piecewise
from varint.control.transcription import PhaseTranscription
from varint.numerics.arrays import over_columns

ROUNDS = 20
SLOW = 0.1  # a correction that is not smaller than that of the last one asks for new slopes
ENOUGH = 1e-3  # of the distance from the path: what it is known to
ROUNDING = 1e-11  # of the range of a coordinate: corrections below that are rounding


class Interval(NamedTuple):
    """An interval's functions of (stage, after, free shared; mesh, fixed shared): its value with
    the rows last, their Jacobian; where p⁻, inner rows and p⁺ are among the rows, and q0, inner
    points and q1 among the unknowns.
    """

    value: ca.Function
    jacobian: ca.Function
    p_minus: np.ndarray
    inner: np.ndarray
    p_plus: np.ndarray
    points: np.ndarray


def interval_of(part: PhaseTranscription, terms: tuple[ca.Function, ...]) -> Interval:
    """Those of a phase, from the kernels of its interval's element."""
    slots, n, stride = part.slots, part.slots.q.shape[1], part.interval.stage.numel()
    inner, rows = slots.inner[0].ravel() - slots.q[0, 0], part.interval.shares.numel()
    return Interval(
        value=terms[0],
        jacobian=terms[2],
        p_minus=np.arange(n),
        inner=n + np.arange(inner.size),
        p_plus=np.arange(rows - n, rows),
        points=np.concatenate([np.arange(n), inner, stride + np.arange(n)]),
    )


def in_parts(
    part: PhaseTranscription,
    terms: tuple[ca.Function, ...],
    shared: np.ndarray,
    path: Piecewise,
    controls: Piecewise,
    p0: np.ndarray,
    parts: int,
    extent: np.ndarray,
) -> np.ndarray | None:
    """Positions at the ends of the steps, (N + 1, n), by equal parts of each.

    Parameters
    ----------
    part : PhaseTranscription
    terms : tuple of Function
        Kernels of its interval, see `Program.terms`.
    shared : ndarray
        t0, T, c.
    path, controls : Piecewise
        The path is where the iteration begins; the controls are played back.
    p0 : ndarray (n,)
        Momentum at the start.
    parts : int
        Of each step.
    extent : ndarray (n,)
        Range of each coordinate, positive: what corrections are measured by.

    Returns
    -------
    ndarray or None
        None for scenes with constraints or rows on velocities, and where the iteration does not
        converge, as from a path that is far from a motion.
    """
    if part.phase.system.structure.velocity_rows:
        return None
    own, n = interval_of(part, terms), len(p0)
    z, d = _columns(part, shared, path, controls, parts)
    nodes = np.vstack([path.values[:, 0], path.values[-1:, -1]])
    before, slopes = np.inf, None
    for _ in range(ROUNDS):
        slopes = _slopes(own, z, d, n) if slopes is None else slopes
        if slopes is None:
            return None
        rows = over_columns(own.value, z, d)[1]
        p_plus = rows[:, own.p_plus]
        # the program's row is −p⁻
        gap = np.hstack([np.vstack([p0, p_plus[:-1]]) + rows[:, own.p_minus], -rows[:, own.inner]])
        change = slopes.change(gap)
        z[:, own.points] += change
        correction = np.abs(change[:, -n:] / extent).max()
        ends = np.vstack([nodes[:1], z[parts - 1 :: parts, own.points[-n:]]])
        if correction <= max(ROUNDING, ENOUGH * np.abs((ends - nodes) / extent).max()):
            return ends
        if not correction < before:
            return None
        slopes = slopes if correction < SLOW * before else None
        before = correction
    return None


class Slopes(NamedTuple):
    """∂y of every part: by the gap in its rows, by q and p at its start; p⁺ by q and y."""

    by_gap: np.ndarray
    by_start: np.ndarray
    p_by_q: np.ndarray
    p_by_y: np.ndarray

    def change(self, gap: np.ndarray) -> np.ndarray:
        """Changes of q0, inner points and q1 of every part that close the gaps, (parts, …)."""
        n = self.p_by_q.shape[2]
        alone = (self.by_gap @ gap[:, :, None])[:, :, 0]
        ends = np.concatenate([self.by_start[:, -n:], self.p_by_y @ self.by_start], axis=1)
        ends[:, n:, :n] += self.p_by_q
        begins, moved = np.zeros((len(gap), 2 * n)), np.zeros(2 * n)
        pushed = np.hstack([alone[:, -n:], (self.p_by_y @ alone[:, :, None])[:, :, 0]])
        for k, (one, own) in enumerate(zip(ends, pushed, strict=True)):
            begins[k] = moved
            moved = own + one @ moved
        y = alone + (self.by_start @ begins[:, :, None])[:, :, 0]
        return np.hstack([begins[:, :n], y])


def _slopes(own: Interval, z: np.ndarray, d: np.ndarray, n: int) -> Slopes | None:
    """None where a part's rows do not determine its points."""
    row, column = own.jacobian.sparsity_out(0).get_triplet()
    whole = np.zeros((len(z), *own.jacobian.size_out(0)))
    whole[:, row, column] = over_columns(own.jacobian, z, d)[0]
    whole = whole[:, :, own.points]
    rows = np.concatenate([-whole[:, own.p_minus], whole[:, own.inner]], axis=1)
    p_plus = whole[:, own.p_plus]
    try:
        by_gap = np.linalg.inv(rows[:, :, n:])
    except np.linalg.LinAlgError:
        return None
    by_start = np.concatenate([-by_gap @ rows[:, :, :n], by_gap[:, :, :n]], axis=2)
    return Slopes(by_gap, by_start, p_plus[:, :, :n], p_plus[:, :, n:])


def _columns(
    part: PhaseTranscription,
    shared: np.ndarray,
    path: Piecewise,
    controls: Piecewise,
    parts: int,
) -> tuple[np.ndarray, np.ndarray]:
    """Unknowns and constants of the interval's element for all parts, one row each."""
    slots, begins = part.slots, np.arange(parts)[:, None]
    count, first, stride = parts * part.phase.steps, slots.q[0, 0], part.interval.stage.numel()

    def within(piece: Piecewise) -> np.ndarray:
        places = ((begins + piece.points) / parts).ravel()
        return piece.within_steps(places).reshape(count, len(piece.points), -1)

    points, u, free = within(path), within(controls), slots.shared >= 0
    n = points.shape[2]
    z = np.zeros((count, stride + slots.after.shape[1] + free.sum()))
    z[:, :n], z[:, stride : stride + n] = points[:, 0], points[:, -1]
    z[:, slots.inner[0].ravel() - first] = points[:, 1:-1].reshape(count, -1)
    if part.phase.linear:
        z[:, stride + n : stride + slots.after.shape[1]], u = u[:, 1], u[:, :1]
    z[:, slots.u[0].ravel() - first] = u.reshape(count, -1)
    z[:, z.shape[1] - free.sum() :] = shared[free]
    widths = np.repeat(np.diff(path.mesh) / parts, parts)
    starts = np.repeat(path.mesh[:-1], parts) + widths * np.tile(begins[:, 0], part.phase.steps)
    return z, np.column_stack([starts, widths, np.tile(shared[~free], (count, 1))])

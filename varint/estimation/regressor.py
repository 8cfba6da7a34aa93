"""Parameters from the data without a run: Hamilton's principle for the motion that was seen.

For every φ that vanishes at the ends of a window, ∫ (∂L/∂v·φ' + (∂L/∂q + F)·φ) dt = 0 along a true
motion. Along the measured one these are equations for the parameters, linear where L and F are: one
step of least squares solves them from any guess. Nothing is differentiated twice.
"""

from __future__ import annotations

from typing import NamedTuple

import casadi as ca
import numpy as np

from varint.estimation.begin import begun
from varint.estimation.inertias import is_positive
from varint.estimation.problem import Estimation, Motion
from varint.estimation.seen import NEAR, Seen, seen_states, shown_path
from varint.numerics.arrays import over_columns
from varint.scene.memory import per_system
from varint.scene.system import System

PASSES = 10  # of Gauss–Newton, where parameters enter non-linearly
WINDOWS = 60  # at most: of several values each, overlapping by halves
RANK = 1e-6  # relative singular value below which noisy data tell nothing
SETTLED = 1e-8  # relative change of the parameters that ends the passes
HOMOGENEOUS = 1e-8  # relative: what is left of the equations with all unknown parameters zero


class Points(NamedTuple):
    """The path at quadrature points (T,), and what weighs φ' and φ of every window (windows, T)."""

    q: np.ndarray
    v: np.ndarray
    t: np.ndarray
    u: np.ndarray
    rise: np.ndarray
    bump: np.ndarray


def from_the_data(p: Estimation) -> Estimation | None:
    """The problem with guesses of parameters and starts that the data show; None where they do not
    show all coordinates, or the equations do not say anything.
    """
    s = p.system.structure
    if s.constraints or s.nonholonomic or s.contacts:
        return None
    shown = [seen_states(p, motion) for motion in p.motions]
    n = s.n
    if any(seen is None or len(np.unique(seen.t)) < NEAR for parts in shown for seen in parts[:n]):
        return None
    c = _parameters(p, shown)
    if c is None:
        return None
    motions = []
    for motion, parts in zip(p.motions, shown, strict=True):
        start = motion.start.copy() if motion.begin is None else begun(motion.begin, c)[0]
        seen = np.concatenate(shown_path(parts, np.array([motion.t0])), 1)
        start[p.free] = np.clip(seen[0], *_ends(p))[p.free]
        if not is_positive(p.system, start[None], np.array([motion.t0]), c):
            return None
        motions.append(motion._replace(start=start))
    return p._replace(c=c, motions=tuple(motions))


def _ends(p: Estimation) -> tuple[np.ndarray, np.ndarray]:
    """Bounds of all of (q0, v0)."""
    wide = np.full(2 * p.system.structure.n, np.inf)
    low, high = -wide, wide
    low[p.free], high[p.free] = p.lower[len(p.theta) :], p.upper[len(p.theta) :]
    return low, high


def _parameters(p: Estimation, shown: list[list[Seen | None]]) -> np.ndarray | None:
    """c with the unknown parameters by least squares on the equations; None where there are
    none.
    """
    many = len(p.theta)
    if not many:
        return p.c
    scenes = [_windows(p, m, parts) for m, parts in zip(p.motions, shown, strict=True)]
    low, high = p.lower[:many], p.upper[:many]
    c = p.c.copy()
    left, slope = _equations(p, scenes, c)
    if not len(left) or not np.isfinite(slope).all():
        return None
    size = np.maximum(np.abs(c[p.theta]), 1e-3)
    told = np.abs(slope * size).max(axis=0) > 0
    if np.abs(slope @ c[p.theta] - left).max() < HOMOGENEOUS * np.abs(slope * size).max():
        told[np.flatnonzero(told)[:1]] = False  # the scale is free: one keeps its guess
    for _ in range(PASSES):
        moved = np.zeros(many)
        scaled = (slope * size)[:, told]
        moved[told] = -np.linalg.lstsq(scaled, left, rcond=RANK)[0] * size[told]
        trial = c.copy()
        trial[p.theta] = np.clip(c[p.theta] + moved, low, high)
        after, of_after = _equations(p, scenes, trial)
        if not np.isfinite(of_after).all() or not after @ after < left @ left:
            break
        settled = np.abs(trial - c).max() <= SETTLED * np.abs(size).max()
        c, left, slope = trial, after, of_after
        if settled:
            break
    return c


def _windows(p: Estimation, motion: Motion, parts: list[Seen | None]) -> Points:
    """Windows that each hold several values of every coordinate, and the path at the rule's nodes
    of the steps within them.
    """
    shown = [x for x in parts[: p.system.structure.n] if x is not None]
    nodes, weights = np.array(p.rule.nodes), np.array(p.rule.weights)
    t = motion.t0 + p.h * (np.arange(motion.steps)[:, None] + nodes)
    first, last = (f(x.t[i] for x in shown) for f, i in ((max, 0), (min, -1)))
    apart = max(np.diff(x.t).mean() for x in shown)
    half = max(min(NEAR * apart, (last - first) / 2), p.h)
    count = int(np.clip(2 * (last - first) / half - 3, 0, WINDOWS))
    centres = np.linspace(first + half, last - half, count)
    full = np.array(
        [
            min(((x.t > b - half) & (x.t < b + half)).sum() for x in shown) >= NEAR / 2
            for b in centres
        ],
        dtype=bool,
    )
    s = (t.ravel() - centres[full][:, None]) / half
    inside = np.abs(s) < 1
    bump = np.where(inside, (1 - s**2) ** 3, 0.0)
    rise = np.where(inside, -6 * s * (1 - s**2) ** 2, 0.0) / half
    many = np.tile(p.h * weights, motion.steps)
    here = inside.any(axis=0)
    q, v = shown_path(parts, t.ravel()[here])
    u = np.broadcast_to(motion.u, (motion.steps, len(nodes), motion.u.shape[2]))
    u = u.reshape(len(here), -1)[here]
    return Points(q, v, t.ravel()[here], u, (rise * many)[:, here], (bump * many)[:, here])


def _equations(p: Estimation, scenes: list[Points], c: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """∫ (∂L/∂v φ' + (∂L/∂q + F) φ) dt of all windows, and its derivatives by the unknowns."""
    n, left, slopes = p.system.structure.n, [], []
    for x in scenes:
        flat = over_columns(principle(p.system), x.q, x.v, x.t[:, None], x.u, c)
        of_c = [y.reshape(len(x.t), -1, n).transpose(0, 2, 1)[:, :, p.theta] for y in flat[2:]]
        left.append((x.rise @ flat[0] + x.bump @ flat[1]).ravel())
        slope = np.einsum("wt,tnc->wnc", x.rise, of_c[0])
        slope += np.einsum("wt,tnc->wnc", x.bump, of_c[1])
        slopes.append(slope.reshape(-1, len(p.theta)))
    return np.concatenate(left), np.concatenate(slopes)


@per_system
def principle(system: System) -> ca.Function:
    """(q, v, t, u, c) → ∂L/∂v, ∂L/∂q + F and their derivatives with respect to c."""
    s = system
    rates = [s.momentum, s.generalised_force]
    slopes = [ca.densify(ca.jacobian(x, s.c)) for x in rates]
    outputs = [*(ca.densify(x) for x in rates), *slopes]
    return ca.Function("principle", [s.q, s.v, s.t, s.control, s.c], outputs, {"cse": True})

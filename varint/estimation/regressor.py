"""Parameters from the data without a run: Hamilton's principle for the motion that was seen.

For every φ that vanishes at the ends of a window, ∫ (∂L/∂v·φ' + (∂L/∂q + F)·φ) dt = 0 along a true
motion. Along the measured one these are equations for the parameters, linear where L and F are: one
step of least squares solves them from any guess. Nothing is differentiated twice.
"""

from __future__ import annotations

from collections.abc import Callable
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
POOR = 0.5  # of momenta or forces: what is left where no motion was found
TINY = 1e-300
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
    c, balance = _improved(p, scenes, p.c.copy(), plainly)
    if balance is not None and balance.poor:
        better, after = _improved(p, scenes, p.c.copy(), by_momenta)
        if after is not None and not after.poor:
            return better
    return None if balance is None else c


class Balance(NamedTuple):
    """What momenta and forces give in all windows (N,), and their slopes by the unknowns (N, k)."""

    momenta: np.ndarray
    forces: np.ndarray
    of_momenta: np.ndarray
    of_forces: np.ndarray

    @property
    def poor(self) -> bool:
        """Whether they are far from balanced, whatever the scale of the Lagrangian."""
        sizes = np.linalg.norm(self.momenta), np.linalg.norm(self.forces)
        return bool(np.linalg.norm(self.momenta + self.forces) > POOR * max(sizes))


Form = Callable[[Balance], tuple[np.ndarray, np.ndarray]]


def plainly(x: Balance) -> tuple[np.ndarray, np.ndarray]:
    """What is left, linear where L and F are."""
    return x.momenta + x.forces, x.of_momenta + x.of_forces


def by_momenta(x: Balance) -> tuple[np.ndarray, np.ndarray]:
    """The same in units of the momenta: a small Lagrangian, as of a short pendulum, leaves little
    and is no solution.
    """
    left, slope = plainly(x)
    size = max(float(np.linalg.norm(x.momenta)), TINY)
    along = x.momenta @ x.of_momenta / size**2
    return left / size, (slope - np.outer(left, along)) / size


def _improved(
    p: Estimation, scenes: list[Points], c: np.ndarray, form: Form
) -> tuple[np.ndarray, Balance | None]:
    """c after passes of Gauss–Newton, and what its equations leave; None where they say nothing."""
    many = len(p.theta)
    low, high = p.lower[:many], p.upper[:many]
    balance = _equations(p, scenes, c)
    left, slope = form(balance)
    if not len(left) or not np.isfinite(slope).all():
        return c, None
    size = np.maximum(np.abs(c[p.theta]), 1e-3)
    told = np.abs(slope * size).max(axis=0) > 0
    if form is plainly and _scale_is_free(slope, left, c[p.theta], size):
        told[np.flatnonzero(told)[:1]] = False  # one keeps its guess
    for _ in range(PASSES):
        moved = np.zeros(many)
        scaled = (slope * size)[:, told]
        moved[told] = -np.linalg.lstsq(scaled, left, rcond=RANK)[0] * size[told]
        trial = c.copy()
        trial[p.theta] = np.clip(c[p.theta] + moved, low, high)
        there = _equations(p, scenes, trial)
        after, of_after = form(there)
        if not np.isfinite(of_after).all() or not after @ after < left @ left:
            break
        settled = np.abs(trial - c).max() <= SETTLED * np.abs(size).max()
        c, balance, left, slope = trial, there, after, of_after
        if settled:
            break
    return c, balance


def _scale_is_free(
    slope: np.ndarray, left: np.ndarray, theta: np.ndarray, size: np.ndarray
) -> bool:
    """Whether all of the equations grow with the unknowns."""
    return bool(np.abs(slope @ theta - left).max() < HOMOGENEOUS * np.abs(slope * size).max())


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


def _equations(p: Estimation, scenes: list[Points], c: np.ndarray) -> Balance:
    """∫ ∂L/∂v φ' dt and ∫ (∂L/∂q + F) φ dt of all windows, and derivatives by the unknowns."""
    n, many, found = p.system.structure.n, len(p.theta), list[tuple[np.ndarray, ...]]()
    for x in scenes:
        flat = over_columns(principle(p.system), x.q, x.v, x.t[:, None], x.u, c)
        of_c = [y.reshape(len(x.t), -1, n).transpose(0, 2, 1)[:, :, p.theta] for y in flat[2:]]
        slopes = (
            np.einsum("wt,tnc->wnc", weights, of).reshape(-1, many)
            for weights, of in zip((x.rise, x.bump), of_c, strict=True)
        )
        found.append(((x.rise @ flat[0]).ravel(), (x.bump @ flat[1]).ravel(), *slopes))
    return Balance(*(np.concatenate(parts) for parts in zip(*found, strict=True)))


@per_system
def principle(system: System) -> ca.Function:
    """(q, v, t, u, c) → ∂L/∂v, ∂L/∂q + F and their derivatives with respect to c."""
    s = system
    rates = [s.momentum, s.generalised_force]
    slopes = [ca.densify(ca.jacobian(x, s.c)) for x in rates]
    outputs = [*(ca.densify(x) for x in rates), *slopes]
    return ca.Function("principle", [s.q, s.v, s.t, s.control, s.c], outputs, {"cse": True})

"""The motion near an instant, from states around it: Hermite's polynomials for the coordinates,
Lagrange's for velocities and momenta (Berrut & Trefethen, SIAM Review 46 (2004), §3).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from varint.integration.events.roots import Points
from varint.results.trajectory import Trajectory

AROUND = 6  # nodes that tell where the motion is between two of them, to h¹²
NEAR = 1e-9  # of a piece: the way from an instant on which slopes alone are needed
LEFT_OUT = 8 * np.finfo(float).eps  # what is added at most: what is left out is a part of it


class Surroundings(NamedTuple):
    """States around some instants each: times (m, M), the weights of Lagrange's polynomials and
    their slopes ℓ_j′(t_j) there, q, v and p (m, M, n), and how long the pieces are, (M,).
    """

    t: np.ndarray
    weight: np.ndarray
    slope: np.ndarray
    q: np.ndarray
    v: np.ndarray
    p: np.ndarray
    w: np.ndarray

    def at(self, which: np.ndarray) -> Surroundings:
        """Those of some of the instants."""
        return Surroundings(*(a[..., which] if a.ndim < 3 else a[:, which] for a in self))

    def motion(self, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """q and v (M, n) at times (M,), both by Hermite's polynomials."""
        return self._hermite(t, *self._lagrange(t))

    def moved(self, there: Points, t: np.ndarray) -> tuple[Points, np.ndarray]:
        """Instants of the motion moved to other times, and where that is done up to round-off.

        By the slopes of the polynomials that go through the instants too (Newton's next term): what
        that term adds is small, and what it leaves out is less. Coordinates move as the velocities
        say, by which the times were found.
        """
        by = (t - there.t)[:, None]
        one, rise = self._lagrange(there.t)
        found, good = [], np.abs(by[:, 0]) <= NEAR * self.w
        with np.errstate(all="ignore"):  # at a node
            apart = 1 / (there.t - self.t)
            turn, most = apart.sum(0)[:, None], np.abs(apart).sum(0)
            for x, known, (guess, slope), times in (
                (there.q, self.q, self._hermite(there.t, one, rise), 2),
                (there.v, self.v, (_mix(one, self.v), _mix(rise, self.v)), 1),
                (there.p, self.p, (_mix(one, self.p), _mix(rise, self.p)), 1),
            ):
                off = times * (x - guess) * by
                found.append(x + by * slope + off * turn)
                good &= np.abs(off).max(axis=1) * most <= LEFT_OUT * np.abs(known).max(axis=(0, 2))
            sideways = np.abs(found[0] - there.q - by * there.v).max(axis=1)
        good &= sideways <= LEFT_OUT * np.abs(self.q).max(axis=(0, 2))
        return there._replace(t=t, q=found[0], v=found[1], p=found[2]), good

    def _lagrange(self, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """ℓ_j(t) and ℓ_j′(t), (m, M): products of all distances but one, from both sides."""
        count, away = len(self.t), t - self.t
        value, slope = np.ones_like(away), np.zeros_like(away)
        before, after = np.ones((2, *t.shape)), np.ones((2, *t.shape))
        before[1] = after[1] = 0.0
        for j in range(count):
            for side, i in ((before, j), (after, count - 1 - j)):
                slope[i] = slope[i] * side[0] + value[i] * side[1]
                value[i] *= side[0]
                side[1] = side[1] * away[i] + side[0]
                side[0] *= away[i]
        return self.weight * value, self.weight * slope

    def _hermite(
        self, t: np.ndarray, one: np.ndarray, rise: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Value and slope of the polynomials through values and slopes of the coordinates."""
        away, square, double = t - self.t, one**2, 2 * one * rise
        straight = 1 - 2 * self.slope * away
        steep = straight * double - 2 * self.slope * square
        q = _mix(straight * square, self.q) + _mix(away * square, self.v)
        return q, _mix(steep, self.q) + _mix(square + away * double, self.v)


def _mix(weights: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Σ_j of weights (m, M) and numbers (m, M, n)."""
    return np.einsum("jm,jmn->mn", weights, x)


def nodes_around(motion: Trajectory, node: np.ndarray) -> Surroundings | None:
    """The nodes around intervals that begin at some; None where the motion may be abrupt."""
    if len(motion) < AROUND or motion.system.structure.contacts:
        return None
    first = np.clip(node - AROUND // 2 + 1, 0, len(motion) - AROUND)
    at = first + np.arange(AROUND)[:, None]
    t, w = motion.t[at], np.abs(motion.t[node + 1] - motion.t[node])
    if not (np.diff(t, axis=0) * motion.h > 0).all():
        return None
    return _through(t, motion.q[at], motion.v[at], motion.p[at], w)


def surroundings(motion: Trajectory, left: Points, right: Points) -> Surroundings:
    """The states around pieces of a motion: nodes where it is smooth, else the pieces' ends."""
    around = nodes_around(motion, left.node)
    if around is not None:
        return around
    t, q, v, p = (np.stack(x) for x in zip(left[1:5], right[1:5], strict=True))
    return _through(t, q, v, p, np.abs(right.t - left.t))


def _through(
    t: np.ndarray, q: np.ndarray, v: np.ndarray, p: np.ndarray, w: np.ndarray
) -> Surroundings:
    apart, each = t[:, None] - t, np.arange(len(t))
    apart[each, each] = 1.0
    return Surroundings(t, 1 / apart.prod(1), (1 / apart).sum(1) - 1, q, v, p, w)

"""A trial path: control points, multipliers and end momenta, before anything is asked of them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from varint.rules.rule import Rule


@dataclass(frozen=True, eq=False)
class Iterate:
    """A trial path: starts (N, n) of the steps, increments (N, d, n), multipliers (N d + 1, m),
    end momenta (2, n).
    """

    starts: np.ndarray
    increments: np.ndarray
    multipliers: np.ndarray
    momenta: np.ndarray
    duration: float

    @property
    def end(self) -> np.ndarray:
        """q_N."""
        return self.starts[-1] + self.increments[-1, -1]

    @property
    def points(self) -> np.ndarray:
        """All control points, (N d + 1, n)."""
        steps, _, n = self.increments.shape
        inside = self.starts[:, None] + np.concatenate(
            [np.zeros((steps, 1, n)), self.increments[:, :-1]], axis=1
        )
        return np.concatenate([inside.reshape(-1, n), self.end[None]])

    def moved(self, change: np.ndarray) -> Iterate:
        """The iterate after a change of all unknowns."""
        steps, d, n = self.increments.shape
        m, count = self.multipliers.shape[1], steps * d + 1
        blocks = change[: count * (n + m)].reshape(count, n + m)
        q = blocks[:, :n]
        rest = change[count * (n + m) :]
        return Iterate(
            starts=self.starts + q[:-1:d],
            increments=self.increments + (q[1:].reshape(steps, d, n) - q[:-1:d, None]),
            multipliers=self.multipliers + blocks[:, n:],
            momenta=self.momenta + rest[: 2 * n].reshape(2, n),
            duration=self.duration + float(rest[2 * n :].sum()),
        )


def iterate_through(points: np.ndarray, degree: int, multipliers: int, duration: float) -> Iterate:
    """Iterate through the control points (N d + 1, n), with multipliers and end momenta zero."""
    count, n = points.shape
    starts = points[:-1:degree]
    increments = points[1:].reshape(len(starts), degree, n) - starts[:, None]
    return Iterate(
        starts.copy(), increments, np.zeros((count, multipliers)), np.zeros((2, n)), duration
    )


def point_times(rule: Rule) -> np.ndarray:
    """Control points of a step in units of h, (d + 1,), of Galerkin rules and compositions
    alike.
    """
    return np.array(rule.points or rule.nodes)


def with_duration(iterate: Iterate, duration: float) -> Iterate:
    """The same path, run through in another time; multipliers are forces and scale with its
    square.
    """
    ratio = iterate.duration / duration
    return replace(
        iterate,
        duration=duration,
        momenta=ratio * iterate.momenta,
        multipliers=ratio**2 * iterate.multipliers,
    )


def extrapolate(before: Iterate, last: Iterate, duration: float) -> Iterate:
    """The iterate of another duration on the straight line through two of a family."""
    ratio = (duration - last.duration) / (last.duration - before.duration)

    def ahead(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        return x + ratio * (x - y)

    return Iterate(
        ahead(last.starts, before.starts),
        ahead(last.increments, before.increments),
        ahead(last.multipliers, before.multipliers),
        ahead(last.momenta, before.momenta),
        duration,
    )

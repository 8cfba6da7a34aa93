"""Unknown starts of unit quaternions: equations that leave of their four numbers three.

|q|² = 1 and q·q̇ = 0 are rows beside the defects between segments, so that steps, covariance and
what the data leave open are those of rotation vectors.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from varint.estimation.problem import Estimation


def ray_row_count(p: Estimation) -> int:
    """Number of the equations in all experiments."""
    wholes = [_free_parts(p, group) for group in p.system.rays]
    return len(p.motions) * sum(q + v for q, v in wholes)


def ray_rows(p: Estimation, starts: Sequence[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """½ (|q|² − 1) and q·q̇ of the starts (q0, v0) of all experiments, and their derivatives by z,
    where all of the group is unknown.
    """
    n, many = p.system.structure.n, len(p.theta)
    values, slopes = [], []
    for e, start in enumerate(starts):
        q, v = np.split(start, 2)
        column = np.full(2 * n, -1)
        column[p.free] = many + e * len(p.free) + np.arange(len(p.free))
        for group in p.system.rays:
            at = np.array(group)
            of_q, of_v = _free_parts(p, group)
            if of_q:
                row = np.zeros(p.size)
                row[column[at]] = q[at]
                values.append((q[at] @ q[at] - 1) / 2)
                slopes.append(row)
            if of_v:
                row = np.zeros(p.size)
                row[column[n + at]] = q[at]
                if of_q:
                    row[column[at]] = v[at]
                values.append(q[at] @ v[at])
                slopes.append(row)
    return np.array(values), np.array(slopes).reshape(len(values), p.size)


def _free_parts(p: Estimation, group: tuple[int, ...]) -> tuple[bool, bool]:
    """Whether the coordinates of a group are unknown, and whether their velocities are."""
    n, at = p.system.structure.n, np.array(group)
    return bool(np.isin(at, p.free).all()), bool(np.isin(n + at, p.free).all())

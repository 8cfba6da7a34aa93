"""An estimation problem with the first of its data alone."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from varint.estimation.problem import ON_NODE, Estimation, Motion

SHARES = (0.125, 0.25, 0.5)  # of the times of every motion


def with_first_part(p: Estimation, share: float) -> Estimation:
    """The problem without what was measured later, in one segment."""
    return p._replace(motions=tuple(_first_part(p, m, share) for m in p.motions))


def _first_part(p: Estimation, motion: Motion, share: float) -> Motion:
    count = math.ceil(share * len(motion.times))
    times, data = motion.times[:count], []
    for m in motion.data:
        data.append(replace(m, values=np.where(m.t[:, None] > times[-1], np.nan, m.values)))
    steps = max(math.ceil((times[-1] - motion.t0) / p.h - ON_NODE), 1)
    return motion._replace(
        data=tuple(data),
        steps=steps,
        u=motion.u[:steps],
        cuts=np.array([0, steps]),
        times=times,
        rows=tuple(np.minimum(rows, count - 1) for rows in motion.rows),
    )


def with_values(p: Estimation, z: np.ndarray) -> Estimation:
    """The problem with these unknowns, those with names, as guesses."""
    c, many, width = p.c.copy(), len(p.theta), len(p.free)
    c[p.theta] = z[:many]
    starts = [motion.start.copy() for motion in p.motions]
    for e, start in enumerate(starts):
        start[p.free] = z[many + e * width : many + (e + 1) * width]
    motions = zip(p.motions, starts, strict=True)
    return p._replace(c=c, motions=tuple(m._replace(start=start) for m, start in motions))

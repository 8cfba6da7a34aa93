"""An estimation problem with the first of its data alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from varint.estimation.problem import Estimation, Motion

SHARES = (0.125, 0.25, 0.5)  # of the time of every motion


def with_first_part(p: Estimation, share: float) -> Estimation:
    """The problem without what was measured later."""
    return p._replace(motions=tuple(_first_part(p, m, share) for m in p.motions))


def _first_part(p: Estimation, motion: Motion, share: float) -> Motion:
    steps = max(int(np.ceil(share * motion.steps)), 1)
    end, data = motion.t0 + steps * p.h, []
    for m in motion.data:
        late = np.reshape(m.t > end, (-1, *[1] * (m.values.ndim - 1)))
        data.append(replace(m, values=np.where(late, np.nan, m.values)))
    return motion._replace(data=tuple(data), steps=steps, cuts=np.array([0, steps]))

"""Controls that swing from node to node, where the cost does not care how they are spread.

On an arc where a bound on the state holds (a speed limit in minimum time), or where the control is
singular, only the mean over a step is determined; the values at the nodes of a step may then go up
and down at no cost.
"""

from __future__ import annotations

import numpy as np

from varint.control.piecewise import Piecewise

SEEN = 0.05  # of the range of a control: smaller steps up and down are no swing
CHAIN = 3  # turns at neighbouring nodes: a switch makes two at most
RATE = "a coordinate for it with costs on its velocity and on the control that drives it"
CURE = {True: f'control="constant", or {RATE},', False: f"{RATE}"}


def swinging_controls(u: Piecewise) -> dict[int, np.ndarray]:
    """For each control that swings, the fractions of the duration where it does."""
    steps, samples, _ = u.values.shape
    at = (u.mesh[:-1, None] + np.diff(u.mesh)[:, None] * u.points).ravel()
    found = {}
    for i, values in enumerate(u.values.reshape(steps * samples, -1).T):
        change = np.diff(values)
        least = np.minimum(np.abs(change[:-1]), np.abs(change[1:]))
        turns = (change[:-1] * change[1:] < 0) & (least > SEEN * np.ptp(values))
        swings = np.zeros(len(values), dtype=bool)
        for k in range(len(turns) - CHAIN + 1):
            if turns[k : k + CHAIN].all():
                swings[k : k + CHAIN + 2] = True
        if swings.any():
            found[i] = at[swings]
    return found

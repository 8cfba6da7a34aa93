"""How far a motion goes beyond the bounds on its velocities between the nodes at which these hold.

Where a speed limit is reached within a step, the mean force of the step keeps to it at both
quadrature nodes while values that go up and down pass it in between.
"""

from __future__ import annotations

from collections.abc import Mapping

import casadi as ca
import numpy as np

from varint.control.replay import in_quarters
from varint.numerics.arrays import over_columns
from varint.results.trajectory import Trajectory

SEEN = 1e-6  # of its range: what goes beyond a bound by less keeps to it
FAR = 0.1  # of its range: a bound that is passed by more is no bound of the motion


def excess_between_nodes(motion: Trajectory) -> Mapping[str, float]:
    """The bounded expressions of velocities that go beyond their bounds in the replay of an optimal
    control in shorter steps, and by how much of their range.
    """
    phase = motion.solution.origin.phase
    s, bounds = phase.system, phase.bounds
    chosen = ca.vertcat(s.control, phase.rates.symbols)  # as free between the nodes as they are
    rows = [
        i
        for i, row in enumerate(ca.vertsplit(bounds.at_nodes))
        if ca.depends_on(row, s.v) and not ca.depends_on(row, chosen)
    ]
    again = in_quarters(motion, motion.solution.u) if rows else []
    if not again:
        return {}
    values = ca.Function("bounded", [s.q, s.v, s.t, s.c], [ca.densify(bounds.at_nodes[rows])])
    found = np.concatenate([over_columns(values, x.q, x.v, x.t[:, None], x.c)[0] for x in again])
    off = np.maximum(bounds.nodes_low[rows] - found, found - bounds.nodes_high[rows]).max(axis=0)
    extent = np.ptp(found, axis=0)
    part = off / np.where(extent > 0, extent, 1.0)
    return {bounds.nodes_names[i]: float(x) for i, x in zip(rows, part, strict=True) if x > SEEN}

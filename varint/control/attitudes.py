"""Ends of coordinates of which only the ratio matters, such as unit quaternions."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from varint.scene.system import System


def with_free_lengths(system: System, end: Any) -> Any:
    """The same conditions with rays that are given brought to a direction, their length left free.

    Lengths change in a step by its error, and no control acts on them: |q_N| = 1 would be an
    equation that the path has to pay for. In place of q = q₁ stand Bᵀ q = 0, and of v = v₁ then
    Bᵀ (v − (q·q₁) v₁) = 0, with the columns of B at right angles to q₁.
    """
    q, v, rows = end.q.copy(), end.v.copy(), [end.rows]
    for group in system.rays:
        at = list(group)
        wanted = q[0, at]
        size = np.linalg.norm(wanted)
        if not (q[1, at] == q[2, at]).all() or not size > 0:
            continue
        wanted = wanted / size
        across = ca.DM(np.linalg.svd(wanted[None])[2][1:])
        place, rate = system.q[at], system.v[at]
        q[1:, at] = [[-np.inf], [np.inf]]
        rows.append(ca.mtimes(across, place))
        if (v[1, at] == v[2, at]).all():
            given = v[0, at] / size
            v[1:, at] = [[-np.inf], [np.inf]]
            rows.append(ca.mtimes(across, rate - ca.dot(place, wanted) * given))
    if len(rows) == 1:
        return end
    zeros = np.zeros(sum(row.numel() for row in rows[1:]))
    return end._replace(
        q=q,
        v=v,
        rows=ca.vertcat(*rows),
        low=np.append(end.low, zeros),
        high=np.append(end.high, zeros),
    )

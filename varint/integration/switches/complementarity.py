"""Which of several switches at zero hold a motion: a box-constrained linear complementarity
problem.

With numbers x in [−1, 1] behind the switches what switches changes at the rates r = d + B x. Where
x is inside, r is zero: the switch holds; where x is 1 (−1), r is not negative (positive): the
motion leaves upwards (downwards). Dry friction has B = −S M⁻¹ Sᵀ diag(μ), so that there is one
solution (Cottle, Pang & Stone, The Linear Complementarity Problem, 1992, §3.1), which projected
Gauss–Seidel sweeps come to (§5.2).
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np

from varint.integration.switches.branch import ROUNDED, slidable
from varint.integration.switches.frozen import frozen_scene
from varint.integration.switches.holding import affine_rates
from varint.numerics.arrays import call
from varint.scene.memory import per_system
from varint.scene.system import System

SWEEPS, SETTLED = 400, 1e-13


@per_system
def _rates(system: System) -> ca.Function | None:
    """(q, v, t, c) → d and B of all switches that may hold."""
    frozen = frozen_scene(system)
    assert frozen is not None
    found = affine_rates(frozen, slidable(system))
    if found is None:
        return None
    s = frozen.system
    outputs = [ca.densify(x) for x in found[2:]]
    return ca.Function("rates", [s.q, s.v, s.t, s.c], outputs, {"cse": True})


def numbers_at_zero(
    system: System,
    values: Sequence[float],
    at_zero: Sequence[int],
    direction: float,
    arguments: Sequence[np.ndarray],
) -> np.ndarray | None:
    """The numbers x behind these switches, which may hold; None where none are found.

    `values` are those behind all switches, `arguments` (q, v, t, c).
    """
    function, may_hold = _rates(system), slidable(system)
    if function is None:
        return None
    drift, effect = call(function, *arguments)
    places = [may_hold.index(j) for j in at_zero]
    x = np.array([values[j] for j in may_hold])
    x[places] = 0.0
    matrix = direction * effect.reshape(len(x), len(x)).T[np.ix_(places, range(len(x)))]
    offset = direction * drift[places] + matrix @ x
    matrix = matrix[:, places]
    own, found = matrix.diagonal(), np.zeros(len(places))
    if not (own < 0).all() or not np.isfinite(offset).all():
        return None
    for _ in range(SWEEPS):
        before = found.copy()
        for i in range(len(found)):
            rate = offset[i] + matrix[i] @ found
            found[i] = min(max(found[i] - rate / own[i], -1.0), 1.0)
        if np.abs(found - before).max() <= SETTLED:
            # at the end of what it can hold, where nothing pulls any farther
            rests = np.abs(offset + matrix @ found) <= ROUNDED * np.abs(own)
            return np.where(rests, found * (1 - ROUNDED), found)
    return None

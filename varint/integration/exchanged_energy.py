"""Energies of degenerate scenes, L = ϑ(q, t)·v − H(q, t): H itself, and how much of it the
coordinates exchange.

∂L/∂v·v depends on which of the equivalent ϑ one writes, and is no measure of the motion. What H
changes by when some coordinates are those of another instant and the others are not is one: along
the motion these changes cancel, for H is kept.
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from varint.numerics.arrays import median, over_columns
from varint.results.trajectory import Trajectory
from varint.scene.memory import per_system
from varint.scene.system import System

GROUPS = 8  # of coordinates that are taken from another instant together
RANGE = 2.0  # times the usual change: an oscillator has its energy, as p·v has at most


@np.errstate(all="ignore")  # what is not finite is looked at
def exchanged_energies(motion: Trajectory, i: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Energy at the nodes i of a degenerate scene, and the size of what is exchanged, the same for
    all of them.
    """
    q, t, function = motion.q[i], motion.t[i], _energy_function(motion.system)
    energy = over_columns(function, q, t[:, None], motion.c)[0][:, 0]
    other, sizes = np.roll(q, len(i) // 2 + 1, axis=0), []
    for group in range(min(GROUPS, q.shape[1])):
        mixed = q.copy()
        mixed[:, group::GROUPS] = other[:, group::GROUPS]
        change = np.abs(over_columns(function, mixed, t[:, None], motion.c)[0][:, 0] - energy)
        sizes.append(median(change[np.isfinite(change)]) if np.isfinite(change).any() else 0.0)
    return energy, np.full(len(i), RANGE * sum(sizes))


@per_system
def _energy_function(system: System) -> ca.Function:
    """(q, t, c) → H."""
    s = system
    energy = ca.substitute(s.energy, s.v, ca.SX.zeros(s.v.shape))
    return ca.Function("hamiltonian", [s.q, s.t, s.c], [ca.densify(energy)], {"cse": True})

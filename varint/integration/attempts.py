"""A run for a wanted error, and what its energies say of it."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from varint.integration.energy_check import energies_along, energies_by_velocity
from varint.integration.energy_quantiles import quantiles
from varint.results.trajectory import Trajectory

LAST_DIGIT = 2.0**-52  # of the energy: where p·v is as small as that, as in a moment from rest
SAMPLES = 400  # nodes at which the energy is looked at, and up to as many more


class Attempt(NamedTuple):
    """A run, its `energy_errors`, and what these cannot tell, for it is the energy's last digit;
    the last digit of its liveliest moment, in the same unit.
    """

    run: Any
    swing: list[float]
    hidden: float = 0.0
    digit: float = 0.0


def energy_errors(motion: Trajectory, v: np.ndarray | None = None) -> list[float]:
    """Quantiles of |H − H0| over the middle one of |p·v|, the largest last; infinite where the
    motion is lost. Velocities may be known.

    The largest alone is where a node happens to lie nearest to where it is largest.
    """
    some = slice(None, None, max(1, len(motion) // SAMPLES))
    if motion.active_set is None and v is not None:
        rows = np.stack((motion.q[some], motion.p[some], v[some]), axis=1)
        return quantiles(*energies_by_velocity(motion.system, rows, motion.t[:1], motion.c))
    if motion.active_set is None:
        at = motion.q[some], motion.p[some], motion.t[:1]
        return quantiles(*energies_along(motion.system, *at, motion.c))
    few = motion[some]
    return quantiles(few.energy, np.abs((few.p * few.v).sum(axis=1)))


def attempt_by_energies(run: Any, energy: np.ndarray, moving: np.ndarray) -> Attempt:
    """A run whose energies and |p·v| at nodes are these; they are overwritten."""
    whole, swing = LAST_DIGIT * abs(energy.item(0)), quantiles(energy, moving)
    size = moving.item(len(moving) // 2)
    return Attempt(run, swing, whole / size if size > 0 else 0.0)

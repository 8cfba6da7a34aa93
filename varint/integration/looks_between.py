"""What the nodes of a run say of its error beside the differences to others."""

from __future__ import annotations

import math

import numpy as np

from varint.integration.energy_check import NOTHING
from varint.integration.energy_leap import energy_alarm
from varint.integration.error_scale import error_scales
from varint.integration.hidden import missed_impulse
from varint.integration.round_off import late_rounding
from varint.integration.work_bound import balance_rows, summed_work
from varint.results.trajectory import Trajectory
from varint.rules.rule import Rule


def looked_at_closely(
    rule: Rule, motion: Trajectory, scales: np.ndarray | None, tol: float
) -> float:
    """What the nodes of a run say of its error beside the differences to others: what forces did
    between them, and infinitely much where the energy is astray; what times far from zero round.
    """
    system = motion.system
    if not _balanced(motion) and energy_alarm(motion):
        return math.inf  # few nodes bound the work of forces poorly
    scales = error_scales(system, motion) if scales is None else scales
    missed = missed_impulse(system, rule, motion, scales, tol)
    return max(missed, late_rounding(motion, scales))


def _balanced(motion: Trajectory) -> bool:
    """Whether the energy clearly is that of the start and the work of forces."""
    f = balance_rows(motion.system)
    if f is None or motion.system.structure.controls:
        return False
    t = motion.t
    energy, power = (x[:, 0] for x in f.values(motion.c, motion.q, motion.p, t[:, None]))
    given = summed_work(np.abs(power), t)
    given += NOTHING * np.abs(energy).max()
    return bool((np.abs(energy - energy[0]) <= given).all())

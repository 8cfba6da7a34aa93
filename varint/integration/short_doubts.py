"""Short motions that are proved but for a closer look."""

from __future__ import annotations

import warnings

from varint.codegen.two_runs import NOT_PROVED
from varint.integration.energy_leap import energy_leap
from varint.integration.looks_between import looked_at_closely
from varint.integration.trajectories import with_stats
from varint.integration.two_runs import shows_its_error
from varint.results.trajectory import Trajectory


def looked_at(motion: Trajectory, estimate: float, tol: float, held: bool) -> Trajectory | int:
    """The motion, which constraint rows may hold, with what a closer look says of its error;
    NOT_PROVED where that is too much. A warning where its energy leaps.
    """
    if held and shows_its_error(motion.system):
        if (leap := energy_leap(motion, tol)) and (alarm := leap.alarm()):
            warnings.warn(alarm, stacklevel=5)
        return motion
    estimate = max(estimate, looked_at_closely(motion.rule, motion, None, tol))
    return NOT_PROVED if estimate > tol else with_stats(motion, error_estimate=estimate)

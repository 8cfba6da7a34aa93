"""Whether steps resolve a motion: what is lost then is lost by round-off, not by their length."""

from __future__ import annotations

import numpy as np

from varint.integration.attempts import energy_errors
from varint.integration.small_motions import decay_rates, frequencies
from varint.integration.two_runs import GAIN, MIDDLE
from varint.integration.work_bound import keeps_energy
from varint.results.trajectory import Trajectory
from varint.scene.system import System

RESOLVED = 2**22  # steps, of the length of a decay, that are worth it
SAMPLES = 200  # nodes at which frequencies are looked at


def resolves(motion: Trajectory) -> bool:
    """Whether the steps are short for the fastest small motion anywhere on the way, and for the
    fastest decay that so many steps as are no great effort would resolve.
    """
    some = np.unique(np.linspace(0, len(motion) - 1, SAMPLES).astype(int))
    h, total = abs(motion.h), abs(float(motion.t[-1] - motion.t[0]))
    decays = decay_rates(motion[some])
    within_reach = decays[decays * total < RESOLVED]
    fastest = max(frequencies(motion[some]).max(initial=0.0), within_reach.max(initial=0.0))
    return bool(h * fastest < 1.0)


def strays(system: System, motion: Trajectory, radians: float, far: float) -> bool:
    """Whether steps are so long for so many turns that runs are far apart: a relative error of the
    energy makes one of the phase that grows with the angle turned.
    """
    turned = max(radians, 1.0)  # of degenerate scenes it is not known
    return keeps_energy(system) and GAIN * turned * energy_errors(motion)[MIDDLE] > far

"""Whether steps resolve a motion: what is lost then is lost by round-off, not by their length."""

from __future__ import annotations

import numpy as np

from varint.integration.small_motions import decay_rates, frequencies
from varint.results.trajectory import Trajectory

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

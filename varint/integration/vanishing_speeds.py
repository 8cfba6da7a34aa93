"""Forces that no steps follow as a speed vanishes: friction along v/|v|, whose direction is not
defined at rest, and what is rounded so little that it turns over within a tiny speed.
"""

from __future__ import annotations

import math

import casadi as ca
import numpy as np

from varint.integration.small_motions import decay_rates_at
from varint.numerics.arrays import call
from varint.results.trajectory import Trajectory
from varint.scene.memory import per_scene
from varint.scene.system import System

RESTS = 1e-2  # of its largest one: a speed that vanishes
RESOLVED = 2**24  # steps, of the length of a decay, times coordinates, that are worth it
ROUNDED = "write v/sqrt(v·v + s²) for v/|v|, with a speed s that is small for the motion"


def is_worth_more_steps(motion: Trajectory | None, steps: int) -> bool:
    """Whether a run of so many ended where forces turn over faster than its steps, and those of
    runs that are worth it follow.
    """
    needed = 0.0 if motion is None else rate_at_rest(motion) * abs(motion.h) * steps
    return motion is not None and steps < needed <= RESOLVED / motion.system.structure.n


def rate_at_rest(motion: Trajectory | None) -> float:
    """How fast dampers act where speeds vanish at the end of a motion; 0 where none does, infinite
    where forces are not defined at rest.
    """
    if motion is None or len(motion) < 2 or not motion.system.structure.forced:
        return 0.0
    vanish, system, c = _vanishing(motion), motion.system, motion.c
    if not vanish.any():
        return 0.0
    q, v, t = motion.q[-1], motion.v[-1], motion.t[-1:]
    rest = np.where(vanish, 0.0, v)
    with np.errstate(all="ignore"):
        moving, resting = (call(_force_function(system), q, x, t, c)[0] for x in (v, rest))
        if np.isfinite(moving).all() and not np.isfinite(resting).all():
            return math.inf
        return float(decay_rates_at(system, q[None], rest[None], t[None], c).max(initial=0.0))


def cause_at_rest(motion: Trajectory | None, steps: int) -> str | None:
    """What to say of a motion that ends where speeds vanish, which no run of so many `steps` has
    followed farther; None where that is not the cause.
    """
    rate = rate_at_rest(motion)
    if motion is None or not rate * abs(motion.h) > 1:
        return None
    names = ", ".join(np.array(motion.system.names)[_vanishing(motion)])
    if math.isinf(rate):
        return (
            f"a force divides by the speed of {names}, which comes to rest there, as friction "
            f"along v/|v| does: {ROUNDED}; in one coordinate sign(v) holds what it stops"
        )
    return (
        f"a force turns over within a tiny speed of {names}, which comes to rest there (it decays "
        f"at a rate of {rate:.1e}, in {rate * abs(motion.h) * steps:.0e} steps): round it over "
        "larger speeds; in one coordinate sign(v) holds what it stops"
    )


def _vanishing(motion: Trajectory) -> np.ndarray:
    speeds = np.abs(motion.v)
    return speeds[-1] <= RESTS * speeds.max(axis=0)


@per_scene
def _force_function(system: System) -> ca.Function:
    """(q, v, t, c) → F without controls."""
    s = system
    force = ca.densify(ca.substitute(s.force, s.control, 0 * s.control))
    return ca.Function("force", [s.q, s.v, s.t, s.c], [force], {"cse": True})

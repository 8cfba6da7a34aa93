"""How the period of a drive goes with a parameter of the scene."""

from __future__ import annotations

import casadi as ca
import numpy as np

from varint.errors import InputError
from varint.numerics.arrays import call
from varint.orbits.orbit import Orbit
from varint.scene.memory import per_system
from varint.scene.system import System

CHANGED = 1e-2  # of the parameter: for looking at the drive with another value
SAME = 1e-9  # of the sizes of L, F and g: differences that are round-off
POWERS = (0, -1, 1)  # T ∝ cᵃ: not at all, of a frequency, of a period
TIMES = 7  # at which the drive is looked at


def drive_of(orbit: Orbit, name: str, index: int) -> int:
    """The power a with which the period of the drive goes with a parameter, T ∝ cᵃ.

    Raises
    ------
    InputError
        If it is none of 0, −1 and 1: then orbits of another value would have no period.
    """
    system, n = orbit.system, len(orbit.shooting.shift)
    changed = orbit.at.c.copy()
    changed[index] *= 1 + CHANGED
    x = orbit.at.x[np.arange(TIMES) % len(orbit.at.x)]
    q, v = x[:, :n], np.tile(orbit.v0, (TIMES, 1))
    t = orbit.t0 + orbit.period * np.sqrt(np.arange(2.0, 2.0 + TIMES))
    if not changed[index]:
        raise InputError(f"along={name!r}: it is zero here, so that nothing can go with it")
    for power in POWERS:
        period = orbit.period * (1 + CHANGED) ** power
        there, later = (
            np.array([_terms(system, *one, changed) for one in zip(q, v, times, strict=True)])
            for times in (t, t + period)
        )
        if np.abs(later - there).max() <= SAME * max(float(np.abs(there).max()), 1e-300):
            return power
    raise InputError(
        f"along={name!r}: with another value of it the scene is not periodic with the period of "
        "the orbit, nor with one proportional to it or to its reciprocal; write the drive by one "
        "frequency, as cos(omega t)"
    )


def _terms(system: System, q: np.ndarray, v: np.ndarray, t: float, c: np.ndarray) -> np.ndarray:
    """L, F and g."""
    found: np.ndarray = call(_terms_function(system), q, v, np.array([t]), c)[0]
    return found


@per_system
def _terms_function(system: System) -> ca.Function:
    s = system
    terms = ca.densify(ca.vertcat(s.lagrangian, s.force, s.constraint))
    return ca.Function("terms", [s.q, s.v, s.t, s.c], [terms])

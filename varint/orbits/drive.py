"""The period of a drive: whether a scene repeats after it, how it goes with a parameter."""

from __future__ import annotations

import casadi as ca
import numpy as np

from varint.errors import InputError
from varint.numerics.arrays import call
from varint.orbits.guess import Guess
from varint.orbits.orbit import Orbit
from varint.orbits.phase import velocity_at
from varint.scene.memory import per_system
from varint.scene.system import System

CHANGED = 1e-2  # of the parameter: for looking at the drive with another value
SAME = 1e-9  # of the sizes of momenta, forces and g: differences that are round-off
REPEATS = 1e-8  # of the size of each: periods given to ten digits make less
ROUND_OFF = 1e-13  # of the largest of them: sizes that are none
POWERS = (0, -1, 1)  # T ∝ cᵃ: not at all, of a frequency, of a period
TIMES = 7  # at which the drive is looked at
LOOKS = 64  # times at which a scene is asked whether it repeats
ASIDE = 0.1  # of the coordinates and velocities, or of 1: how far from the guess


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


def require_repeats(system: System, guess: Guess) -> None:
    """Refuse periods after which a scene that depends on time is another one: a motion that closes
    once would not close again.

    Raises
    ------
    InputError
        If momenta or forces at the same q and v are not the same a period later.
    """
    if system.structure.autonomous:
        return
    n, period = len(guess.shift), guess.period
    speeds = velocity_at(system, guess.x, guess.t0, guess.c)[:n]
    at = np.concatenate([guess.x[:n], speeds])
    aside = ASIDE * max(float(np.abs(at).max()), 1.0)
    times = guess.t0 + period * np.modf(np.sqrt(np.arange(2.0, 2.0 + LOOKS)))[0]
    turn = np.arange(1.0, 2 * n + 1)
    states = [at + aside * np.sin(k * k + 1.7 * k * turn) for k in range(LOOKS)]
    there, later = (
        np.array(
            [
                _terms(system, y[:n] + shift, y[n:], t + later, guess.c)
                for y, t in zip(states, times, strict=True)
            ]
        )
        for shift, later in ((0.0, 0.0), (guess.shift, period))
    )
    sound = np.isfinite(there).all(axis=1) & np.isfinite(later).all(axis=1)
    size = np.abs(there[sound]).max(axis=0, initial=0.0)
    size = np.maximum(size, ROUND_OFF * max(float(size.max(initial=0.0)), 1e-300))
    apart = float((np.abs(later - there)[sound] / size).max(initial=0.0))
    if apart > REPEATS:
        raise InputError(
            f"period={period:.12g}, but the scene depends on time and is not the same that much "
            f"later: momenta or forces at the same q and v differ by {apart:.2g} of their sizes, "
            "so that no motion goes on repeating; give the period of the drive, or a multiple of "
            "it, to all digits"
        )


def _terms(system: System, q: np.ndarray, v: np.ndarray, t: float, c: np.ndarray) -> np.ndarray:
    """∂L/∂v, ∂L/∂q + F and the constraints: the motion in q and p follows from them."""
    found: np.ndarray = call(_terms_function(system), q, v, np.array([t]), c)[0]
    return found


@per_system
def _terms_function(system: System) -> ca.Function:
    s = system
    push = ca.vertcat(s.momentum, s.generalised_force)
    terms = ca.densify(ca.vertcat(push, s.constraint, s.nonholonomic))
    return ca.Function("terms", [s.q, s.v, s.t, s.c], [terms])

"""The period of a drive: whether a scene repeats after it, how it goes with a parameter."""

from __future__ import annotations

import warnings
from dataclasses import replace

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
FEW_DIGITS = 1e-3  # of a period: what it may be rounded by
STEP, LAST, MOST_CORRECTIONS = 1e-7, 1e-15, 12  # of a period: for slopes, and where its search ends
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


def with_repeats(system: System, guess: Guess) -> Guess:
    """The guess with a period after which the scene is the same: its own, or the one that it gives
    a few digits of.

    Warns
    -----
    UserWarning
        If another period is taken, with both.

    Raises
    ------
    InputError
        If momenta or forces at the same q and v are not the same a period later: a motion that
        closes once would not close again.
    """
    if system.structure.autonomous:
        return guess
    apart = _largest(_changes(system, guess, guess.period))
    if apart <= REPEATS:
        return guess
    period = _repeat_near(system, guess)
    if period is None:
        raise InputError(
            f"period={guess.period:.12g}, but the scene depends on time and is not the same that "
            f"much later: momenta or forces at the same q and v differ by {apart:.2g} of their "
            "sizes, so that no motion goes on repeating; give the period of the drive, or a "
            "multiple of it"
        )
    warnings.warn(
        f"period={guess.period:.12g} is taken for {period:.16g}, after which the scene is the same",
        stacklevel=4,
    )
    return replace(guess, period=period)


def _repeat_near(system: System, guess: Guess) -> float | None:
    """The period within a thousandth of the guessed one after which the scene is the same, by
    Newton's method on all that changes; None where there is none.
    """
    period = guess.period
    for _ in range(MOST_CORRECTIONS):
        left = _changes(system, guess, period)
        slope = (_changes(system, guess, period * (1 + STEP)) - left) / (period * STEP)
        step = -float(slope @ left) / max(float(slope @ slope), 1e-300)
        period += step
        if not abs(period - guess.period) <= FEW_DIGITS * abs(guess.period):
            return None
        if abs(step) <= LAST * abs(period):
            break
    return period if _largest(_changes(system, guess, period)) <= REPEATS else None


def _changes(system: System, guess: Guess, period: float) -> np.ndarray:
    """By how much momenta and forces differ a period later, at 64 states and times, in their own
    sizes; where they are no numbers, by nothing.
    """
    n = len(guess.shift)
    speeds = velocity_at(system, guess.x, guess.t0, guess.c)[:n]
    at = np.concatenate([guess.x[:n], speeds])
    aside = ASIDE * max(float(np.abs(at).max()), 1.0)
    times = guess.t0 + guess.period * np.modf(np.sqrt(np.arange(2.0, 2.0 + LOOKS)))[0]
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
    return np.where(sound[:, None], (later - there) / size, 0.0).ravel()


def _largest(changes: np.ndarray) -> float:
    return float(np.abs(changes).max(initial=0.0))


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

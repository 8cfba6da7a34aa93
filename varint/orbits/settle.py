"""The cycle that a motion with friction runs into, wherever it began, or the answer to a drive."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from varint.errors import ConvergenceError
from varint.integration.simulate import simulate
from varint.orbits.guess import Guess
from varint.orbits.phase import units_of, velocity_at
from varint.orbits.shooting import Shooting
from varint.results.trajectory import Trajectory
from varint.scene.system import parameters_by_name

STEPS = (2**9, 2**11, 2**13, 2**15)  # of the guessed period, each where fewer do not tell the cycle
TURNS = 4  # guessed periods at a time
STROBES, MOST_STROBES = 16, 512  # periods of a drive at a time
MOST_TURNS = 32
RETURNED = 1e-3  # of the ranges: a motion that comes back so near is on its cycle
AGREE = 1e-3  # relative: periods with fewer and with more steps


def settles(shooting: Shooting, guess: Guess) -> bool:
    """Whether a motion from the guess may come to a cycle by itself: nothing is conserved, nothing
    drives, and no motion was given.
    """
    free = shooting.autonomous and not shooting.integrals.names
    return free and guess.motion is None and not shooting.shift.any()


def answers(shooting: Shooting, guess: Guess) -> bool:
    """Whether a motion from the guess may come to what answers a drive with friction."""
    driven = not shooting.autonomous and shooting.system.structure.forced
    return driven and guess.motion is None and not shooting.shift.any()


def answered(shooting: Shooting, guess: Guess) -> Guess | None:
    """A start to which the motion comes back after a period of the drive; None where it comes to
    none, as without friction, or in chaos.
    """
    steps, x, t0 = STEPS[0], guess.x, guess.t0
    for _ in range(MOST_STROBES // STROBES):
        try:
            motion = _followed(shooting, guess, x, t0, guess.period / steps, STROBES * steps)
        except ConvergenceError:
            return None
        y = np.hstack([motion.q, motion.p])
        x, t0 = y[-1], float(motion.t[-1])
        back = np.abs(y[-1] - y[-1 - steps]) / units_of(y[-1 - steps :]).scale
        if back.max() < RETURNED:
            return replace(guess, x=x)
    return None


def _followed(
    shooting: Shooting, guess: Guess, x: np.ndarray, t0: float, h: float, steps: int
) -> Trajectory:
    q = x[: len(x) // 2]
    return simulate(
        shooting.system,
        shooting.rule,
        q0=q,
        v0=velocity_at(shooting.system, x, t0, guess.c)[: len(q)],
        h=h,
        steps=steps,
        t0=t0,
        params=parameters_by_name(shooting.system, guess.c),
        progress=False,
    )


def settled(shooting: Shooting, guess: Guess) -> Guess | None:
    """A motion of one turn of the cycle, from where it is nearest to the guess; None where the
    motion comes to none.
    """
    found: list[Guess | None] = []
    for steps in STEPS:
        try:
            found.append(_turn(shooting, guess, steps))
        except ConvergenceError:  # the motion cannot be run with these steps
            continue
        if len(found) < 2:
            continue
        before, last = found[-2:]
        if before is None and last is None:
            return None
        if before and last and abs(last.period - before.period) < AGREE * last.period:
            return last
    return None


def _turn(shooting: Shooting, guess: Guess, steps: int) -> Guess | None:
    """The same, with so many steps of a guessed period."""
    h, x = guess.period / steps, guess.x
    for _ in range(MOST_TURNS // TURNS):
        motion = _followed(shooting, guess, x, guess.t0, h, TURNS * steps)
        x = np.concatenate([motion.q[-1], motion.p[-1]])
        found = _last_turn(motion, guess)
        if found is not None:
            return found
    return None


def _last_turn(motion: Trajectory, guess: Guess) -> Guess | None:
    """The last turn of a motion whose end has been where it was a turn before."""
    x, t = np.hstack([motion.q, motion.p]), motion.t
    scale = units_of(x[len(x) // 2 :]).scale
    y = x / scale
    ahead = (y - y[-1]) @ (y[-1] - y[-2])  # of the plane through the end, across the motion
    through = np.flatnonzero((ahead[:-2] < 0) & (ahead[1:-1] >= 0))
    parts = -ahead[through] / (ahead[through + 1] - ahead[through])
    there = y[through] + parts[:, None] * (y[through + 1] - y[through])
    back = np.flatnonzero(np.abs(there - y[-1]).max(axis=1) < RETURNED)
    if not len(back):
        return None
    k, part = through[back[-1]], parts[back[-1]]
    period = float(t[-1] - t[k] - part * (t[k + 1] - t[k]))
    late = int(np.searchsorted(t, t[-1] - period, side="right")) - 1
    first = int(np.searchsorted(t, t[late] - period))
    start = first + int(np.abs(y[first : late + 1] - guess.x / scale).max(axis=1).argmin())
    turn = motion[start:]
    return Guess(x[start], period, float(t[start]), guess.c, np.zeros_like(motion.q[0]), turn)

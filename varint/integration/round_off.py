"""What round-off of a run grows to: a limit that no number of steps mends.

Errors of regular motions grow with the square of time at most. Those of chaotic ones grow beyond
that, and every run of a search begins with the same rounded momentum: no two of them differ by what
becomes of it. Runs from starts whose last digits are others show it, and what the round-off of
their steps becomes with it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache

import numpy as np

from varint.results.trajectory import Trajectory

ROUNDED = 2e-15  # relative error of the energy that is round-off
# of the phase: what round-off of the energy of steps, a random walk, makes of it in a radian;
# Kepler's motion, pendulums and a quartic well, 20 to 20,000 periods, have a tenth to half of it
ROUNDING = 5e-17
# of differences from the middle to the end, where they grow with the square of time; what grows
# more is taken for a growth of all errors: what iterations leave in a step, and round-off, grow too
SECULAR_GROWTH = 4.0
GROWS = 100.0  # times more than errors of regular motions: what the start is rounded by counts
MAGNIFIED = 1e4  # what an encounter makes of the start's rounding, over what of its own errors
UNEVEN = 10.0  # errors that grow are as uneven, and between shared nodes as much larger, at most
CHANCE = 4.0  # of a difference that is round-off: two random walks may come to lie close
# of the motion's size, for every step where a small oscillation takes one: a passage that takes so
# many times shorter steps than the start is as many times faster, and magnifies last digits by that
PASSED = 4e-15
# times the largest difference of a run from `WAYS` such ones: of 192 chaotic motions five in a
# hundred had an error above that and above as much of what runs of twice the steps differ by, half
# of them had a fifth of it; so far below an error one of them says enough
PARTED, FAR_BELOW = 2.0, 1 / 32
WAYS = 2
# of the last digit of times: explicit time acts at rounded ones, alike in all runs; of 720 motions
# over forces from times of 1e5 to 1e12 none erred by more than that
LATE = 3.0 * 2.0**-52
# times as fast against its scale as small motions turn may one be: nearer to zero none is asked
LATELY = 7.0


def growth_of(apart: float, early: float, made: float = 0.0) -> float:
    """How much more errors grow than those of a regular motion, by the largest difference of two
    runs and what an early one lets expect in the middle.

    An error that is `made` late, where bodies meet that have come from afar, has not grown from an
    early one: steps cannot make less than what the energy of the coarser run is off by.
    """
    return apart / max(SECULAR_GROWTH * max(early, ROUNDED), made)


def magnified(apart: float, early: float, made: float) -> float:
    """How much the rounding of the start may have grown beside: an encounter magnifies it by more
    than what is made there.
    """
    return min(growth_of(apart, early), MAGNIFIED * growth_of(apart, early, made))


def rounding(apart: float, radians: float, steps: int, growth: float = 1.0) -> float:
    """As much of the difference of two runs as round-off may have made in so many radians and
    steps, where errors grow by as much: this does not shrink with the steps.
    """
    return min(apart, ROUNDING * radians * math.sqrt(steps) * growth)


def likely_rounding(radians: float, steps: int, growth: float) -> float:
    """What round-off is likely to have grown to where errors grow by as much: below a wanted error
    no run from another start need show it.
    """
    return CHANCE * ROUNDING * max(radians, steps) * math.sqrt(steps) * growth


def passed_by(slower: float, apart: float, beyond: float, tol: float) -> float:
    """What passages make of last digits that take so many times shorter steps than a small
    oscillation: whole where that is below the wanted error, elsewhere what two runs may show of it.
    """
    passed = PASSED * slower
    return beyond * (passed if beyond * passed <= tol else min(passed, CHANCE * apart))


def late_rounding(motion: Trajectory, scales: np.ndarray) -> float:
    """What the motion does in the last digits of its times, where a scene depends on them."""
    if motion.system.structure.autonomous:
        return 0.0
    fastest = np.abs(motion.v).max(axis=0) / scales
    return LATE * float(np.abs(motion.t[[0, -1]]).max() * fastest.max(initial=0.0))


def iterated_by(each: float, apart: float, growth: float, beyond: float) -> float:
    """What iterations leave, which is `each` where errors do not grow: no more than two runs show,
    which leave about as much both.
    """
    return max(each, beyond * min(each * growth * min(growth, UNEVEN), CHANCE * apart))


def with_other_digits(q: np.ndarray, p: np.ndarray, way: int) -> tuple[np.ndarray, np.ndarray]:
    """A start (n,), (n,) whose momenta have last digits one up or down, in one of `WAYS`; at rest
    its coordinates have.
    """
    moves = p.any()
    x = p if moves else q
    x = np.where(x == 0, x, np.nextafter(x, _ends(q.size, way)))
    return (q, x) if moves else (x, p)


def with_other_times(h: float, way: int) -> float:
    """Steps whose last digit is one up or down, in one of `WAYS`: what depends on time acts at
    rounded ones.
    """
    return math.nextafter(h, -math.inf if way else math.inf)


@lru_cache(maxsize=64)
def _ends(n: int, way: int) -> np.ndarray:
    """Where last digits move to."""
    i = np.arange(n)
    return np.inf * (-((-1.0) ** i) if way else (-1.0) ** (i // 2))


def parted(apart: Callable[[int], float], known: float, tol: float) -> tuple[float, int]:
    """What round-off makes of a run, by how far it is `apart` from the one whose start differs in
    one of `WAYS`, and how many of them were made: one tells enough where it is far below the error
    that is `known`, or more than tol where that is more still.
    """
    most, way = 0.0, 0
    for way in range(WAYS):
        most = max(most, PARTED * apart(way))
        if most < FAR_BELOW * known or tol < most <= known:
            break
    return most, way + 1

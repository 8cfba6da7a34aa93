"""The first switch that a smooth piece of a motion comes to: a margin that falls to zero."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from varint.integration.switches.branch import BranchScene
from varint.integration.switches.loop import Loop, one_part
from varint.numerics.limits import ROOT_ITERATIONS

# of the way there: an error would change the energy at every switch
LOCATED = 4 * np.finfo(float).eps
CLOSE, SURELY = 4 * np.finfo(float).eps, 8  # of |t|, where time is rounded, after so many turns
# of a margin at the ends of a step: a cubic that dips below it is looked at more closely; steps
# that turn the fastest motion by at most a radian are followed to 1/384
DIP = 0.1
AMONG = np.linspace(0.1, 0.9, 9)[:, None, None]  # instants at which a cubic is looked at
RISE = AMONG**2 * (3 - 2 * AMONG)
TURNS = 12  # instants at which the lowest point of a dip is looked for
INSIDE = (2.0**-4, 2.0**-8, 2.0**-12, 2.0**-16)  # of the first step: soon after the last switch


class Nodes(NamedTuple):
    """Nodes of a piece: times and (q, p, v), (N + 1, 3, n), the first of which is the last switch
    or, if not `begins`, lies inside the branch.
    """

    t: np.ndarray
    states: np.ndarray
    begins: bool


class Crossing(NamedTuple):
    """Step in which a margin falls to zero, when, the state there, and which one it is."""

    step: int
    t: float
    state: np.ndarray
    margin: int


class NoWayIn(Exception):
    """The motion does not enter the branch that was chosen for it."""


def first_crossing(scene: BranchScene, loop: Loop, nodes: Nodes) -> Crossing | None:
    """The first zero of a margin along the nodes; None where all stay positive.

    Raises
    ------
    NoWayIn
        If a margin is negative from the first node on.
    """
    t, states, begins = nodes
    if not scene.watched or len(t) < 2:
        return None
    at = states[:, 0], states[:, 2], t[:, None]
    value, rate = scene.margins_along(loop.c, *at)
    w = (t[1:] - t[:-1])[:, None]
    rate_before, rate_after = rate[:-1] * w, rate[1:] * w
    before, after = value[:-1], value[1:]
    dips = (before > 0) & (after > 0) & (rate_before < 0) & (rate_after > 0)
    if dips.any():
        dips &= _lowest(before, after, rate_before, rate_after) < DIP * np.maximum(before, after)
    # what stays at zero moves along the switch
    seen = dips | ~(after >= 0) | ((after == 0) & (before > 0))
    for k in np.flatnonzero(seen.any(axis=1)):
        at_k, h = float(t[k]), float(t[k + 1] - t[k])
        step = step_from(scene, loop, states[k], at_k, h)
        ends = before[k], after[k], rate_before[k], rate_after[k]
        found: Crossing | None = None
        for margin in np.flatnonzero(seen[k]).tolist():
            numbers = [float(x[margin]) for x in ends]
            one = zero_in_step(step, margin, numbers, begins and k == 0)
            if one is not None and (found is None or abs(one[0]) < abs(found.t - step.t)):
                found = Crossing(int(k), step.t + one[0], one[1], margin)
        if found is not None:
            return found
    return None


class Step(NamedTuple):
    """A step of a piece, and shorter ones from its first node."""

    scene: BranchScene
    loop: Loop
    t: float
    h: float
    start: np.ndarray
    told: np.ndarray

    def part(self, s: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """State, margins and their rates, by this step, after a fraction of it."""
        state = one_part(self.loop, self.start, self.t, s * self.h, self.told)
        if state is None:
            raise NoWayIn
        at = state[:1], state[2:], np.array([[self.t + s * self.h]])
        value, rate = self.scene.margins_along(self.loop.c, *at)
        return state, value[0], rate[0] * self.h


def step_from(scene: BranchScene, loop: Loop, state: np.ndarray, t: float, h: float) -> Step:
    """A step from a state (3, n)."""
    told = loop.told
    if told.size:  # the sizes are those of the piece
        told = np.concatenate([told[: -state.shape[1]], state[2]])
    return Step(scene, loop, t, h, state, told)


def zero_in_step(
    step: Step, margin: int, ends: list[float], begins: bool
) -> tuple[float, np.ndarray] | None:
    """Time within the step at which a margin falls to zero, and the state there."""
    before, after, rate_before, rate_after = ends
    low = 0.0
    if not before > 0:
        if not begins:
            raise NoWayIn
        for low in INSIDE:
            _, values, rates = step.part(low)
            if values[margin] > 0:
                before, rate_before = float(values[margin]), float(rates[margin])
                break
        else:
            raise NoWayIn
    high = 1.0
    if after > 0:
        dip = _dip(step, margin, (low, high), (rate_before, rate_after))
        if dip is None:
            return None
        high, after, rate_after = dip
    width = high - low
    s = low + width * _root(before, after, rate_before * width, rate_after * width)
    step_size = math.inf
    rounded = max(CLOSE * abs(step.t / step.h), LOCATED)
    for i in range(ROOT_ITERATIONS):
        state, values, rates = step.part(s)
        value, rate = float(values[margin]), float(rates[margin])
        low, high = (s, high) if value > 0 else (low, s)
        ahead = s - value / rate if rate < 0 else (low + high) / 2
        if not low <= ahead <= high or i > ROOT_ITERATIONS // 2:
            ahead = (low + high) / 2
        step_size, last = abs(ahead - s), step_size
        stalls = i >= SURELY or (i > 1 and step_size > last / 2)  # it is round-off that moves it
        close = rounded if stalls else LOCATED * s
        if value == 0 or step_size <= close or high - low <= close:
            break
        s = ahead
    return s * step.h, state


def _dip(
    step: Step, margin: int, between: tuple[float, float], rates: tuple[float, float]
) -> tuple[float, float, float] | None:
    """An instant at which a margin that falls and rises again is not positive, with its value and
    rate; None where it stays positive.
    """
    (a, b), (fa, fb) = between, rates
    for _ in range(TURNS):
        s = min(max((a * fb - b * fa) / (fb - fa), a + (b - a) / 16), b - (b - a) / 16)
        _, values, slopes = step.part(s)
        value, slope = float(values[margin]), float(slopes[margin])
        if not value > 0:
            return s, value, slope
        if slope < 0:
            a, fa = s, slope
        else:
            b, fb = s, slope
        # no lower than its tangents at both ends allow
        if value > abs(slope) * (b - a):
            return None
    return None


def _lowest(
    before: np.ndarray, after: np.ndarray, rate_before: np.ndarray, rate_after: np.ndarray
) -> np.ndarray:
    """Where cubics with these ends are lowest, roughly: at nine instants."""
    s, rest = AMONG, 1 - AMONG
    value = before + RISE * (after - before) + s * rest * (rest * rate_before - s * rate_after)
    return np.asarray(value.min(axis=0))


def _root(before: float, after: float, rate_before: float, rate_after: float) -> float:
    """Zero in [0, 1] of the cubic with these ends, the first positive and the last not."""
    low, high = 0.0, 1.0
    bend, twist = 3 * (after - before) - 2 * rate_before - rate_after, 0.0
    twist = rate_before + rate_after - 2 * (after - before)
    s = before / (before - after)
    for _ in range(8):
        value = before + s * (rate_before + s * (bend + s * twist))
        slope = rate_before + s * (2 * bend + s * 3 * twist)
        low, high = (s, high) if value > 0 else (low, s)
        s = s - value / slope if slope else low
        if not low < s < high:
            s = (low + high) / 2
    return s

"""What the stages of two runs tell of the error that the finer one has left.

Where energies tell nothing, the difference of two runs is the error of the coarser one, and only a
third run says how much less the finer one errs. Stages say it sooner. Let d be the highest Legendre
coefficients of what a step's stages have, beside the largest size of that along the motion. A Gauss
step errs by the product of what its polynomial misses of the motion and what one of the same degree
misses of how errors go on from there; the second is as smooth as the first or smoother, so steps
make about d². Where d has fallen by a factor everywhere along the motion, the error has fallen by
its square.

Counted on is less: four times what the worst part of the motion says, more where the coarser run
does not resolve the motion (of a passage that is as narrow as its steps d may have fallen by half
of the factor), never more than 0.85 of the rule's order, and never less than the sum of the finer
run's own d². What two runs say without that is counted on where it is enough. An order that runs
have shown which do not resolve the motion is not counted on beyond what d² says. Of 428,000 random
calls over forces of 31 kinds five were silently wrong, by up to 4.6 times what was asked, four of
them of a spring with a narrow bend; of 145,000 by differences alone three, by up to ten times.

Steps before the first node that two runs share hide transients from them and are done once more in
parts, but where d² of these steps show that they make a hundredth of what is wanted.

The first run's d² also say how many steps the second one is to have, and whether its error will
seem to grow (a motion from rest makes most of it late), so that its iterations are to leave less.

Source: Hairer, Lubich & Wanner, Geometric Numerical Integration, II.1.4 (superconvergence) and the
theorem of Alekseev and Gröbner.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from varint.integration.round_off import growth_of
from varint.integration.run_distance import with_early

RATIOS = 1.5, 2.0  # of the steps of two runs: where the next one may prove the error, and else
SHARED = 6  # parts of two runs at least that show an order, or whose stages do
COUNTED = 0.85  # of the rule's order at most
ALIKE = 4.0  # times the square of what stages say
TOLD = 0.01  # d of a run of which squares tell; of more they tell less, as the square of that
FAINT = 1e-4  # of the largest d: what steps make there is nothing beside
MADE = 0.03  # of the sum of d²: what the steps of most scenes make, within two digits
AIM = 24.0  # times less than what is wanted is aimed at
LONGER = 3.0  # times as many steps at most
FORESEEN = 1e4  # growth of errors at most that is made of late ones
CLEARLY = 0.1  # of the wanted error: two runs will show it without stages
EXTRA = 4.0  # times less than foreseen iterations are to leave
LEAST_MADE = 0.25  # of that a run errs by at least
MOST_UNRESOLVED = 12.0  # times as much at most behind one that does not resolve the motion
BEGINS = 100.0  # times less than what is wanted is made in the first steps where that is clear
ROUND_OFF = 1e-12  # of the largest unknowns of their kind: rows that tell nothing
UNRESOLVED = 0.05  # d of a run that may be lucky: the next one is not compared with it alone


class Shown(NamedTuple):
    """A run of so many equal steps, and d of each of them; of a linear map none."""

    steps: int
    d: np.ndarray


def shown_by(seen: np.ndarray, steps: int, n: int) -> Shown:
    """By what has been seen of the rows of unknowns of n coordinates (`LoopResult.seen`)."""
    if not seen.size:
        return Shown(steps, seen)
    high, sizes = seen.reshape(steps, 2, -1).transpose(1, 0, 2)
    largest = sizes.max(axis=0)
    usual = largest.reshape(-1, n).max(axis=1).repeat(n)
    with np.errstate(divide="ignore"):
        share = np.where(largest > ROUND_OFF * usual, 1 / largest, 0.0)
    return Shown(steps, (high * share).max(axis=1))


def made_by_stages(d: np.ndarray) -> tuple[float, float]:
    """What the steps of a run are likely to make, and how much more this seems to grow than the
    error of a regular motion, because most of it is made late: `growth_of`.
    """
    made, early = with_early(np.append(0.0, np.cumsum(MADE * d**2))[:, None])
    return made, min(max(growth_of(made, early), 1.0), FORESEEN)


def left_by_stages(before: Shown, now: Shown, apart: float, order: int) -> float:
    """Error of the finer one of two runs that far apart; infinite where stages tell nothing."""
    parts = math.gcd(before.steps, now.steps)
    if not (before.d.size and now.d.size and parts >= SHARED):
        return math.inf
    coarse, fine = (x.d.reshape(parts, -1).max(axis=1) for x in (before, now))
    faint = FAINT * coarse.max()
    around = np.pad(coarse, 1)  # what a step does not show by chance its neighbours do
    coarse = np.maximum(np.maximum(around[:-2], around[2:]), coarse)
    counts = (coarse > faint) | ~(fine <= faint)
    fallen = (fine[counts] / coarse[counts]).max(initial=0.0)
    unresolved = before.d.max() / TOLD
    shown = ALIKE * (1 + unresolved**2) * fallen**2
    left = max(shown, (now.steps / before.steps) ** (-COUNTED * order))
    if not left < 0.5:
        return math.inf
    return float(max(apart * left / (1 - left), made_by_stages(now.d)[0]))


def least_by_stages(before: Shown, now: Shown) -> float:
    """Error of a run at least: orders of runs that do not resolve the motion may be luck."""
    if not (before.d.size and now.d.size):
        return 0.0
    more = min(1 + (before.d.max() / TOLD) ** 2, MOST_UNRESOLVED)
    return float(LEAST_MADE * more * made_by_stages(now.d)[0])


def begins_clearly(before: Shown, now: Shown, few: int, tol: float, order: int) -> bool:
    """Whether stages show that nothing is made in so many first steps of the finer one of two runs,
    before the first node that both have; those of the coarser one where the finer one's have not
    been looked at, and so many times less where they resolve the motion.
    """
    seen = now if now.d.size else before
    if not seen.d.size:
        return False
    ratio = seen.steps / now.steps
    some = math.ceil(few * ratio)
    most = float(seen.d[:some].max())
    fallen = ratio ** (COUNTED * order) if most <= TOLD else 1.0
    return BEGINS * MADE * some * most**2 * fallen <= tol


def ratio_to(steps: int, error: float, wanted: float, order: int) -> float:
    """How many times as many steps prove an error, where runs of these err by so much."""
    needed, (near, far) = _needed(error, wanted, order), RATIOS
    for ratio in (near, far, (far + LONGER) / 2, LONGER):
        more = steps * ratio
        if not (needed <= ratio or ratio == LONGER) or not more.is_integer():
            continue
        if ratio == near or math.gcd(steps, int(more)) >= SHARED:
            return ratio
    return far


def planned_by_stages(first: Shown, tol: float, order: int) -> tuple[float, float, bool]:
    """How many times as many steps the run behind a first one has; how much its iterations are to
    leave less; whether stages are to tell its error, which two runs alone may not show.
    """
    made, uneven = made_by_stages(first.d)
    near, far = RATIOS
    if first.d.max() > UNRESOLVED:  # the run behind the second one may prove it
        ratio = far if _needed(made, tol, order) > near**2 else near
    else:
        ratio = ratio_to(first.steps, made, tol, order)
    tells = bool(ratio > near or made > CLEARLY * tol)
    return ratio, EXTRA * uneven if tells else 1.0, tells


def _needed(error: float, wanted: float, order: int) -> float:
    """How many times as many steps err by so much less that this is proved."""
    return (AIM * error / wanted) ** (1 / (COUNTED * order))

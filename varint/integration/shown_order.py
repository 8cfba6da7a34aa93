"""How much runs with more steps have left of an error, by the order that they have shown."""

from __future__ import annotations

import math

CAUTION = 0.75  # of the order that was seen is counted on
LESS = 0.5  # of it where runs have nearly as many steps
NEARLY = 2.0  # times as many are so no more
LEAST_ORDER = 0.5  # is counted on whatever runs show
TELLS = 0.1  # difference of two runs that tells of an order


def part_left(ratio: float, order: float, best: float) -> float:
    """Part of an error that so many times as many steps leave.

    An order far below the `best`, the rule's, is that of steps that do not resolve the motion yet,
    and the next one may be another: the lower, the less of it is counted on.
    """
    sure = max(order * (order / best), LEAST_ORDER)
    return float(ratio ** (-(CAUTION if ratio >= NEARLY else LESS) * sure))


def left_by_order(
    previous: tuple[float, float], apart: float, ratio: float, best: int, floor: float
) -> float:
    """The same by the order that a difference shows after the previous one, of so many times as
    many steps; below the floor differences tell nothing.
    """
    before, finer = previous
    order = LEAST_ORDER
    if before < TELLS:
        drop = math.log(max(before, floor) / max(apart, floor)) / math.log(finer)
        order = min(max(drop, LEAST_ORDER), best)
    return part_left(ratio, order, best)


def left_of_pair(longer: float, ratio: float, order: int) -> float:
    """What the order leaves of the difference of two runs, the finer of `longer` times the steps,
    in that of the finer and one of `ratio` times its steps.
    """
    return longer**-order * (1 - ratio**-order) / (1 - longer**-order)

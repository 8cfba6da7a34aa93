"""Limits of a proof by two runs in the order of c/proof.h."""

from __future__ import annotations

import math

import numpy as np

import varint.integration.round_off as limited
import varint.integration.shown_order as shown
import varint.integration.two_runs as decided
from varint.integration.attempts import SAMPLES
from varint.integration.compiled_loop import POOR
from varint.integration.energy_quantiles import QUANTILES
from varint.integration.problem import LEVEL
from varint.integration.rule_choice import SECULAR

_NAMES = (
    *("ROUGH", "HALF", "FLOOR", "LOST", "GAIN", "MARGIN", "SAFETY", "SPREAD", "EVIDENCE"),
    *("ROUNDED", "NO_SHRINKAGE", "NOT_WORSE", "ROUNDING", "STALLED", "PART_CLOSE", "CAUTION"),
    *("LEAST", "GOOD", "MOST", "FAR", "CLEAR", "SECULAR_GROWTH", "LEFT", "UNEVEN"),
    *("CHANCE", "GROWS", "WAYS", "PARTED", "FAR_BELOW", "MAGNIFIED", "AGAIN"),
    *("SAMPLES", "LONG", "PARTS", "ATTEMPTS"),
    *("WATCHED", "FIRST_PART", "FEWEST", "SEEN_PARTS", "SLOW"),
    *("SAME_ROUNDING", "SAME_CHANCE", "SAME_STEP"),
)
_LAST = "STILL", "CONVERGES"

_SHOWN = shown.CAUTION, shown.LESS, shown.NEARLY, shown.LEAST_ORDER, shown.TELLS


def proof_limits(
    attempts: int = decided.ATTEMPTS,
    watched: int = decided.WATCHED,
    closer: float = 1.0,
    foreseen: float = 1.0,
    hopeless: float = math.inf,
    ways: int = limited.WAYS,
    pairs: int = 1,
) -> np.ndarray:
    """Those of runs whose `Course` has these numbers, given up where round-off makes so many times
    what is wanted; in how many ways the last digits of their start may be others; how many
    differences show an error.
    """
    own = {"SAMPLES": SAMPLES, "ATTEMPTS": attempts, "WATCHED": watched, "WAYS": ways}
    known = vars(limited) | vars(decided) | own
    others = POOR, SECULAR, LEVEL, closer, foreseen, hopeless, pairs, decided.BY_CHANCE, *_SHOWN
    last = (known[x] for x in _LAST)
    return np.array([*(float(known[x]) for x in _NAMES), *others, *last, *QUANTILES])

"""Places to look at expressions: any that are not special.

The generators of `random` are there at once; `numpy.random` takes longer to import than a short
run.
"""

from __future__ import annotations

from random import Random

import numpy as np


def normal_numbers(random: Random, count: int) -> np.ndarray:
    """So many independent normal numbers, (count,)."""
    return np.array([random.gauss(0.0, 1.0) for _ in range(count)])


def uniform_numbers(random: Random, low: float, high: float, count: int) -> np.ndarray:
    """So many independent numbers between two, (count,)."""
    return np.array([random.uniform(low, high) for _ in range(count)])

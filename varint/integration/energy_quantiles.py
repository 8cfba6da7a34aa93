"""Quantiles of the energy errors of a run."""

from __future__ import annotations

import math

import numpy as np

QUANTILES = (0.25, 0.5, 0.75, 0.9, 1.0)


def quantiles(energy: np.ndarray, moving: np.ndarray) -> list[float]:
    """`energy_errors` of energies and |p·v| at nodes; they are overwritten."""
    energy -= energy[0]
    error = np.abs(energy, out=energy)[1:]
    error.sort()
    moving.sort()
    last, size = len(error) - 1, moving.item(len(moving) // 2)
    if not (math.isfinite(error.item(last)) and size > 0):  # no number is the last one
        return [math.inf] * len(QUANTILES)
    return [error.item(round(part * last)) / size for part in QUANTILES]

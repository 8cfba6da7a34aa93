"""Kepler's equation, of ellipses and hyperbolas."""

from __future__ import annotations

import numpy as np

KEPLER_STEPS = 12  # Newton steps; 6 to 8 reach round-off at e = 0.99
HYPERBOLIC_STEPS = 30  # from the far side, where M/e ≫ 1 is met in a few


def eccentric_anomaly(M: np.ndarray, e: np.ndarray | float) -> np.ndarray:
    """E with E − e sin E = M, for 0 ≤ e < 1, by Newton's method.

    Examples
    --------
    >>> from varint.orbits.anomalies import eccentric_anomaly
    >>> float(eccentric_anomaly(0.1 - 0.9 * 0.09983341664682815, 0.9).round(14))
    0.1
    """
    turns = np.round(np.asarray(M) / (2 * np.pi))
    M = M - 2 * np.pi * turns
    E = M + 0.85 * e * np.sign(M)
    for _ in range(KEPLER_STEPS):
        E = E - (E - e * np.sin(E) - M) / (1 - e * np.cos(E))
    return E + 2 * np.pi * turns


def hyperbolic_anomaly(M: np.ndarray, e: np.ndarray | float) -> np.ndarray:
    """F with e sinh F − F = M, for e > 1, by Newton's method from asinh(M/e), on the near side.

    Examples
    --------
    >>> import numpy as np
    >>> from varint.orbits.anomalies import hyperbolic_anomaly
    >>> float(hyperbolic_anomaly(1.5 * np.sinh(2.0) - 2.0, 1.5).round(14))
    2.0
    """
    F = np.arcsinh(np.asarray(M) / e)
    for _ in range(HYPERBOLIC_STEPS):
        F = F - (e * np.sinh(F) - F - M) / (e * np.cosh(F) - 1)
    return F

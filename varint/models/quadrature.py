"""Integrals of smooth periodic functions to round-off, and motions that a quadrature solves.

The trapezoidal rule converges geometrically on periodic functions: a Fourier series of the
integrand, integrated term by term, gives t(φ) of a one-dimensional motion in its phase φ, turning
points included, and Newton's method φ(t). Elliptic functions are the case dφ/du = √(1 − k² sin² φ),
so none need to be imported.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from varint.errors import InputError

FEWEST, MOST = 64, 2**16  # samples per period; the most resolves a distance of 1e-7 to a separatrix
NEWTON_STEPS = 8  # from a start interpolated in the table; 3 suffice


class PeriodicIntegral:
    """F(φ) = ∫₀^φ f dφ of a smooth function f with period 2π.

    Parameters
    ----------
    f : callable
        Function of an array of phases.

    Raises
    ------
    InputError
        If f is too sharp to be resolved: the motion runs too close to a separatrix or a collision.

    Examples
    --------
    >>> import numpy as np
    >>> from varint.models.quadrature import PeriodicIntegral
    >>> F = PeriodicIntegral(lambda phi: 1 / (2 + np.cos(phi)))
    >>> round(float(F.period * np.sqrt(3) / (2 * np.pi)), 14)
    1.0
    """

    def __init__(self, f: Callable[[np.ndarray], np.ndarray]):
        n = FEWEST
        while True:
            series = np.fft.rfft(f(2 * np.pi * np.arange(n) / n) + np.zeros(n)) / n
            size = np.abs(series)
            if size[-n // 8 :].max() <= 4e-16 * size.max():
                break
            n *= 2
            if n > MOST:
                raise InputError(
                    "this motion has no closed form to round-off: too close to a separatrix or "
                    "collision"
                )
        kept = np.flatnonzero(size > 1e-17 * size.max())[-1] + 1
        harmonics = np.arange(1, kept)
        self._f = f
        self._mean = series[0].real
        self._terms = np.concatenate([[0], 2 * series[1:kept] / (1j * harmonics)])
        self._offset = self._terms.sum().real
        self._nodes = 2 * np.pi * np.arange(4 * kept + 1) / (4 * kept)

    @property
    def period(self) -> float:
        """F(2π), the increase over one turn."""
        return float(2 * np.pi * self._mean)

    def __call__(self, phi: np.ndarray | float) -> np.ndarray:
        return (
            self._mean * np.asarray(phi)
            + np.polyval(self._terms[::-1], np.exp(1j * np.asarray(phi))).real
            - self._offset
        )

    def inverse(self, value: np.ndarray | float) -> np.ndarray:
        """φ with F(φ) = value, for a positive f."""
        turns, rest = np.divmod(np.asarray(value, dtype=float), self.period)
        phi = np.interp(rest, self(self._nodes), self._nodes)
        for _ in range(NEWTON_STEPS):
            phi = phi - (self(phi) - rest) / self._f(phi)
        return phi + 2 * np.pi * turns

"""Free quantities of a problem: a guess and the bounds between which the solver may choose."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from varint.errors import InputError
from varint.scene.inputs import array_of_numbers


@dataclass(frozen=True, eq=False)
class Free:
    """A quantity that the solver chooses; see `free`."""

    guess: np.ndarray
    lower: np.ndarray
    upper: np.ndarray

    def __repr__(self) -> str:
        return f"free({', '.join(repr(x.tolist()) for x in (self.guess, self.lower, self.upper))})"


def free(guess: Any, lower: Any, upper: Any) -> Free:
    """A quantity to be found: lower ≤ x ≤ upper, starting from a guess.

    Stands in place of a number: for a duration, an end coordinate or velocity, or the value of a
    parameter.

    Parameters
    ----------
    guess : float or array
        Where the solver starts.
    lower, upper : float or array, or None
        Bounds; None is no bound, as −∞ or ∞. The lower one of a duration must be positive.

    Returns
    -------
    Free

    Raises
    ------
    InputError
        If a bound is NaN, the bounds contradict each other or the guess lies outside.

    Examples
    --------
    >>> import varint as vi
    >>> vi.free(2.0, 0.1, 10.0)
    free(2.0, 0.1, 10.0)
    """
    try:
        bounds = _bound(lower, -np.inf), _bound(upper, np.inf)
        values = [array_of_numbers(x) for x in (guess, *bounds)]
        shape = np.broadcast_shapes(*(x.shape for x in values))
    except (TypeError, ValueError):
        raise InputError(
            f"free(guess, lower, upper) takes numbers, got {guess!r}, {lower!r}, {upper!r}"
        ) from None
    if values[0].shape != shape:
        raise InputError(
            f"free(): the guess has shape {values[0].shape}, its bounds {shape}; one number each"
        )
    x, low, high = (np.broadcast_to(v, shape) for v in values)
    if np.isnan(low).any() or np.isnan(high).any() or not np.isfinite(x).all():
        raise InputError(
            f"free(guess, lower, upper) needs numbers, got {guess!r}, {lower!r}, {upper!r}"
        )
    if (low > high).any():
        raise InputError(f"free(): the lower bound {lower!r} exceeds the upper bound {upper!r}")
    if (x < low).any() or (x > high).any():
        raise InputError(f"free(): the guess {guess!r} lies outside {lower!r} … {upper!r}")
    return Free(x, low, high)


def _bound(given: Any, without: float) -> Any:
    """A bound, or several; where None is given, the infinity that is none."""
    if isinstance(given, (list, tuple)):
        return [_bound(x, without) for x in given]
    return without if given is None else given


def window(value: float | Free) -> tuple[float, float, float]:
    """(guess, lower, upper) of a number or a free number; a number is its own bounds."""
    if isinstance(value, Free):
        return float(value.guess), float(value.lower), float(value.upper)
    return float(value), float(value), float(value)

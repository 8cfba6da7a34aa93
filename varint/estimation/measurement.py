"""What was measured: expressions of the state at times, with their spread."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from varint.errors import InputError
from varint.scene.free import Free
from varint.scene.inputs import finite_array, times_of
from varint.scene.travel import as_fields


@dataclass(frozen=True, eq=False)
class Measurement:
    """Values of an expression of the state at some times, y_j = ψ(q, v, t_j) + noise of spread σ.

    Parameters
    ----------
    expression : SX (o,)
        ψ, of q, v, t and parameters; a constant bias of a sensor is a parameter of the system that
        stands in it.
    t : array (M,)
        Times, in any order; they need not be nodes.
    values : array (M,) or (M, o)
        What was measured; NaN where a value is missing.
    sigma : float or array
        Standard deviation of the noise, one number or one each; ``vi.free(guess, 0, inf)`` where it
        is not known, which `fit` estimates.
    jitter : float or Free
        Noise beside σ, of the star or the sensor: the variance is σ² + jitter². With
        ``vi.free(guess, 0, inf)`` `fit` estimates it.

    Raises
    ------
    InputError
        If the shapes do not match, or sigma is not positive where there is no jitter.

    Examples
    --------
    >>> import varint as vi
    >>> q, v = vi.coordinates("theta")
    >>> vi.Measurement(q, [0.0, 0.5], [1.0, 0.9], sigma=0.01)
    Measurement(theta: 2 values from t = 0 to 0.5)
    """

    expression: Any
    t: np.ndarray
    values: np.ndarray
    sigma: Any = 1.0
    jitter: Any = 0.0

    def __post_init__(self) -> None:
        t, values = times_of(self.t), np.array(self.values, dtype=float)
        values = values[:, None] if values.ndim == 1 else values
        if not np.isfinite(t).all() or values.ndim != 2 or len(values) != len(t):
            raise InputError(
                f"a measurement has {t.size} finite times and values of shape "
                f"{np.shape(self.values)}; give a value, or a row of values, for each time"
            )
        known, jitter = self._noise()
        sigma = finite_array("sigma", known)
        if sigma.ndim == 1 and len(sigma) == len(t) != values.shape[1]:
            sigma = sigma[:, None]
        least = jitter.guess if isinstance(jitter, Free) else jitter
        if not (np.hypot(sigma, least) > 0).all() or (sigma < 0).any() or sigma.ndim > 2:
            raise InputError(
                f"sigma must be positive, got {self.sigma!r}, or zero beside a positive jitter"
            )
        if np.broadcast_shapes(sigma.shape, values.shape) != values.shape:
            raise InputError(
                f"sigma has shape {sigma.shape}; it must be one number, one a time, or of the "
                f"shape {values.shape} of the values"
            )
        spread = np.broadcast_to(sigma, values.shape)
        given = (("t", t), ("values", values), ("sigma", spread), ("jitter", jitter))
        for name, x in given:
            object.__setattr__(self, name, x)

    def __reduce__(self) -> tuple[type[Measurement], tuple[Any, ...]]:
        """To another process its expression goes with symbols of the same names."""
        return Measurement, as_fields(self)

    def __copy__(self) -> Measurement:
        return replace(self)

    def __deepcopy__(self, memo: Any) -> Measurement:
        """With arrays of its own, of the same symbols."""
        return replace(self)

    def _noise(self) -> tuple[Any, Any]:
        """σ and the jitter; an unknown σ is a jitter beside none."""
        sigma, jitter = self.sigma, self.jitter
        if isinstance(sigma, Free):
            if isinstance(jitter, Free) or jitter != 0:
                raise InputError("sigma and jitter cannot both be unknown: give one of them")
            sigma, jitter = 0.0, sigma
        level = jitter.guess if isinstance(jitter, Free) else finite_array("jitter", jitter)
        least = jitter.lower if isinstance(jitter, Free) else level
        if level.ndim or float(least) < 0 or not np.isfinite(level):
            raise InputError(f"jitter must be one number that is not negative, got {jitter!r}")
        return sigma, jitter if isinstance(jitter, Free) else float(level)

    @property
    def level(self) -> float:
        """The jitter, or its guess where it is unknown."""
        return float(self.jitter.guess if isinstance(self.jitter, Free) else self.jitter)

    @property
    def spread(self) -> np.ndarray:
        """√(σ² + jitter²), in the shape of the values."""
        return np.hypot(self.sigma, self.level)

    def __repr__(self) -> str:
        count = int(np.isfinite(self.values).sum())
        return (
            f"Measurement({self.expression}: {count} values from t = {self.t.min():g} to "
            f"{self.t.max():g})"
        )


@dataclass(frozen=True, eq=False)
class Experiment:
    """Measurements of one motion: several experiments share parameters, not their start.

    Attributes
    ----------
    data : sequence of Measurement
    q0, v0 : array (n,)
        Start, or a guess of it where it is unknown.
    t0 : float
        Time of the start.
    u : array, optional
        Controls as in `simulate`.
    """

    data: Any
    q0: Any
    v0: Any
    t0: float = 0.0
    u: Any = None

"""What was measured: expressions of the state at times, with their spread."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from varint.errors import InputError
from varint.scene.inputs import finite_array, times_of


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
        Standard deviation of the noise, one number or one each.

    Raises
    ------
    InputError
        If the shapes do not match or sigma is not positive.

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

    def __post_init__(self) -> None:
        t, values = times_of(self.t), np.array(self.values, dtype=float)
        values = values[:, None] if values.ndim == 1 else values
        if not np.isfinite(t).all() or values.ndim != 2 or len(values) != len(t):
            raise InputError(
                f"a measurement has {t.size} finite times and values of shape "
                f"{np.shape(self.values)}; give a value, or a row of values, for each time"
            )
        sigma = finite_array("sigma", self.sigma)
        if sigma.ndim == 1 and len(sigma) == len(t) != values.shape[1]:
            sigma = sigma[:, None]
        if not (sigma > 0).all() or sigma.ndim > 2:
            raise InputError(f"sigma must be positive, got {self.sigma!r}")
        if np.broadcast_shapes(sigma.shape, values.shape) != values.shape:
            raise InputError(
                f"sigma has shape {sigma.shape}; it must be one number, one a time, or of the "
                f"shape {values.shape} of the values"
            )
        spread = np.broadcast_to(sigma, values.shape)
        for name, x in (("t", t), ("values", values), ("sigma", spread)):
            object.__setattr__(self, name, x)

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

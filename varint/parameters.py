"""Named constants that stay symbolic, with the values that stand for them."""

from __future__ import annotations

import math
from typing import Any

import casadi as ca
import numpy as np

from varint.errors import InputError, converted


class Parameters:
    """Named constants that stay symbolic, with default values.

    ``c = Parameters(length=1.0, g=9.81)`` gives the symbols ``c.length`` and ``c.g``; other values are set per run by
    ``params=dict(length=2.0)`` without building anything anew. Arrays make vectors and matrices of symbols.

    Parameters
    ----------
    **defaults : float or array
        Default value of each parameter (at most two dimensions).

    Examples
    --------
    >>> import varint as vi
    >>> c = vi.Parameters(length=1.0, g=9.81)
    >>> c.length * c.g
    SX((length*g))
    """

    def __init__(self, **defaults: Any):
        values = {}
        for name, default in defaults.items():
            value = finite_array(f"parameter {name!r}", default)
            if value.ndim > 2:
                raise InputError(f"parameter {name!r} has shape {value.shape}; at most two dimensions are possible")
            values[name] = value
        self._defaults = values
        self._symbols = {name: ca.SX.sym(name, *_symbol_shape(value)) for name, value in values.items()}

    def __getattr__(self, name: str) -> ca.SX:
        if name.startswith("_"):
            raise AttributeError(name)
        try:
            return self._symbols[name]
        except KeyError:
            raise AttributeError(f"unknown parameters [{name!r}]; known: {sorted(self._symbols)}") from None

    def __repr__(self) -> str:
        return f"Parameters({', '.join(f'{k}={v.tolist()}' for k, v in self._defaults.items())})"


def finite_array(what: str, value: Any) -> np.ndarray:
    """value as an array of finite numbers."""
    array = converted(
        lambda: np.array(value, dtype=float), lambda: f"{what} must be a number or an array of numbers, got {value!r}"
    )
    if not np.isfinite(array).all():
        raise InputError(f"{what} is not finite: {value!r}")
    return array


def number(what: str, x: Any) -> float:
    """x as a finite number."""
    value = x if type(x) is float else converted(lambda: float(x), lambda: f"{what} must be a number, got {x!r}")
    if not math.isfinite(value):
        raise InputError(f"{what} must be finite, got {x!r}")
    return value


def whole(what: str, x: Any, least: int = 1) -> int:
    """x as a whole number that is not too small."""
    if not isinstance(x, (int, np.integer)) or isinstance(x, bool) or x < least:
        raise InputError(f"{what} must be a whole number, at least {least}, got {x!r}")
    return int(x)


def generator(seed: Any) -> np.random.Generator:
    """Random numbers of a seed."""
    return converted(
        lambda: np.random.default_rng(seed), lambda: f"seed must be a whole number, at least 0, got {seed!r}"
    )


def guesses_of(starts: Any) -> list[Any]:
    """The guesses that many starts begin with."""
    if isinstance(starts, str):
        raise InputError(f"starts must be a number or a list of guesses, got {starts!r}")
    return converted(lambda: list(starts), lambda: f"starts must be a number or a list of guesses, got {starts!r}")


def _symbol_shape(value: np.ndarray) -> tuple[int, int]:
    return (value.shape[0], value.shape[1] if value.ndim == 2 else 1) if value.ndim else (1, 1)

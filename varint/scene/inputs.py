"""What users hand over as numbers, checked and converted where it enters."""

from __future__ import annotations

import math
from typing import Any

import casadi as ca
import numpy as np

from varint.errors import InputError, parsed_or_refused
from varint.numerics.arrays import finite

FLOAT = np.dtype(float)


LONGEST = 80  # characters of a value that a message shows


def shown(x: Any) -> str:
    """x as a message shows it: the middle of what is long is left out."""
    try:
        text = repr(x)
    except ValueError:  # a whole number of thousands of digits, which Python does not write
        return f"what cannot be written, of type {type(x).__name__}"
    half = LONGEST // 2
    return text if len(text) <= LONGEST else f"{text[:half]}...{text[-half:]}"


def finite_array(what: str, value: Any) -> np.ndarray:
    """value as an array of finite numbers; words are none, even of digits."""
    array = parsed_or_refused(
        lambda: array_of_numbers(value),
        lambda: f"{what} must be a number or an array of numbers, got {shown(value)}",
    )
    if not np.isfinite(array).all():
        raise InputError(f"{what} is not finite: {shown(value)}")
    return array


def array_of_numbers(value: Any) -> np.ndarray:
    """value as an own array; a TypeError where it holds words or complex numbers."""
    array = np.array(value)
    if array.dtype.kind in "SUc":
        raise TypeError
    return array.astype(float)


def control_values(u: Any, shapes: str = "") -> np.ndarray:
    """Controls as an own array of finite numbers, with a word on where others belong; `shapes`:
    those that a message names.
    """
    try:
        values = np.array(u, dtype=float)
    except (TypeError, ValueError, RuntimeError):
        values = None
    if values is not None and np.isfinite(values).all():
        return values
    if _depends(u):
        raise InputError(
            f"u must be numbers{shapes}, got {shown(u)}: a feedback or a function of time belongs "
            "into the scene, System(..., force=), as an expression of q, v and time()"
        )
    if values is None:
        raise InputError(f"u must be numbers{shapes}, got {type(u).__name__}")
    raise InputError("u is not finite everywhere")


def _depends(u: Any) -> bool:
    """Whether it, or a part of it, is a function or an expression of symbols."""
    if isinstance(u, (list, tuple, np.ndarray)):
        return any(map(_depends, u))
    return callable(u) or (isinstance(u, (ca.SX, ca.MX)) and not u.is_constant())


def float_of(x: Any) -> float:
    """x as a float; a TypeError where it is a word, even of digits."""
    if isinstance(x, (str, bytes, bytearray)):
        raise TypeError
    return float(x)


def number(what: str, x: Any) -> float:
    """x as a finite number; words are none, even of digits."""
    complaint = f"{what} must be a number, got "
    value = (
        x
        if type(x) is float
        else parsed_or_refused(lambda: float_of(x), lambda: complaint + shown(x))
    )
    if not math.isfinite(value):
        raise InputError(f"{what} must be finite, got {x!r}")
    return value


def positive_integer(what: str, x: Any, least: int = 1) -> int:
    """x as a whole number that is not too small."""
    if not isinstance(x, (int, np.integer)) or isinstance(x, bool) or x < least:
        raise InputError(f"{what} must be a whole number, at least {least}, got {x!r}")
    return int(x)


def generator(seed: Any) -> np.random.Generator:
    """Random numbers of a seed."""
    return parsed_or_refused(
        lambda: np.random.default_rng(seed),
        lambda: f"seed must be a whole number, at least 0, got {seed!r}",
    )


def guesses_of(starts: Any) -> list[Any]:
    """The guesses that many starts begin with."""
    if isinstance(starts, str):
        raise InputError(f"starts must be a number or a list of guesses, got {starts!r}")
    return parsed_or_refused(
        lambda: list(starts),
        lambda: f"starts must be a number or a list of guesses, got {starts!r}",
    )


def vector(what: str, x: Any, n: int, names: tuple[str, ...]) -> np.ndarray:
    """x as n finite numbers."""
    value = parsed_or_refused(
        lambda: array_of_numbers(x),
        lambda: f"{what} must be {n} numbers, one for each of {list(names)}, got {shown(x)}",
    )
    if value.ndim == 0 and n == 1:
        value = value.reshape(1)
    if value.shape != (n,):
        raise InputError(
            f"{what} has shape {value.shape}; it must be ({n},), one number for each of "
            f"{list(names)}"
        )
    if not finite(value):
        bad = [names[i] for i in np.flatnonzero(~np.isfinite(value))]
        raise InputError(f"{what} is not finite in {bad}: {value}")
    return value


def times_of(t: Any) -> np.ndarray:
    """Times as numbers (k,), or an error that says what they must be."""
    if type(t) is np.ndarray and t.dtype is FLOAT and t.ndim == 1 and t.size:
        return t
    times = parsed_or_refused(
        lambda: np.atleast_1d(array_of_numbers(t)),
        lambda: f"a time or several (k,) must be given, got {shown(t)}",
    )
    if times.ndim > 1 or not times.size:
        raise InputError(
            f"a time or several (k,) must be given, got an array of shape {times.shape}"
        )
    return times

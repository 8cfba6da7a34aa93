"""Checked expressions: what costs, bounds and end conditions may be made of."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from varint.errors import InputError, parsed_or_refused
from varint.numerics.arrays import finite
from varint.numerics.operations import constants_of
from varint.scene.epigraph import refuse_largest
from varint.scene.inputs import shown


def column(what: str, expression: Any, allowed: ca.SX, words: str) -> ca.SX:
    """A dense column of SX expressions of the allowed symbols."""
    if isinstance(expression, ca.MX):
        raise InputError(f"{what} is an MX; write it with the system's SX symbols")
    expression = parsed_or_refused(
        lambda: ca.densify(ca.vec(ca.SX(expression))),
        lambda: f"{what} must be a number or a CasADi SX expression, got {expression!r}",
    )
    refuse_largest(what, expression, allowed)
    known = {s.element_hash() for s in ca.symvar(allowed)}
    unknown = sorted(s.name() for s in ca.symvar(expression) if s.element_hash() not in known)
    if unknown:
        raise InputError(
            f"{what} depends on {unknown}; it may depend on {words} of its own system only"
        )
    numbers = constants_of(expression)
    if not finite(numbers):
        raise InputError(
            f"{what} is not finite: {shown(expression)} holds {numbers[~np.isfinite(numbers)][0]}; "
            "math.cos(q), float(q) and the like lose the symbol: take ca.cos(q), and leave out "
            "what is infinite"
        )
    return expression


def scalar(what: str, expression: Any, allowed: ca.SX, words: str) -> ca.SX:
    """A scalar SX expression of the allowed symbols."""
    found = column(what, expression, allowed, words)
    if found.numel() != 1:
        raise InputError(f"{what} has {found.numel()} components; it must be one number")
    return found


def limits(what: str, lower: Any, upper: Any, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Lower and upper bounds as arrays (count,); None is no bound."""
    sides = []
    for name, value, default in (("lower", lower, -np.inf), ("upper", upper, np.inf)):
        try:
            side = np.array(default if value is None else value, dtype=float)
            side = np.broadcast_to(side.ravel() if side.ndim > 1 else side, (count,))
        except (TypeError, ValueError, RuntimeError):
            raise InputError(
                f"the {name} bound of {what} must be one number or {count}, got {value!r}"
            ) from None
        if np.isnan(side).any():
            raise InputError(f"the {name} bound of {what} is not a number: {value!r}")
        sides.append(side)
    low, high = sides
    if (low > high).any():
        raise InputError(f"the bounds of {what} contradict each other: {lower!r} > {upper!r}")
    return low, high


def triples(what: str, bounds: Any) -> list[tuple[Any, Any, Any]]:
    """A list of (lower, expression, upper)."""
    if isinstance(bounds, tuple) and len(bounds) == 3 and not isinstance(bounds[0], tuple):
        bounds = [bounds]
    try:
        found = [tuple(b) for b in bounds]
    except TypeError:
        raise InputError(
            f"{what} must be a list of (lower, expression, upper), got {bounds!r}"
        ) from None
    for b in found:
        if len(b) != 3:
            raise InputError(
                f"{what} must be a list of (lower, expression, upper), got an entry of {len(b)}: "
                f"{b!r}"
            )
    return found

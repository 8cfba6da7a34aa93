"""Conditions at the ends of a phase: given, free, bounded, periodic coordinates and velocities; any
expressions.

The end velocities are unknowns of the problem, tied to the path by the Legendre transforms
∂L/∂v(q_0, v_0) = p⁻_0 and ∂L/∂v(q_N, v_N) = p⁺_{N−1}; so a condition on coordinates or velocities
is a plain bound on unknowns.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from varint.control.attitudes import with_free_lengths
from varint.control.states import States
from varint.errors import InputError, parsed_or_refused
from varint.nlp.expressions import column, limits, triples
from varint.scene.free import Free
from varint.scene.inputs import float_of
from varint.scene.parameters import pairs
from varint.scene.system import System

KEYS = ("q", "v", "p", "states", "bounds", "periodic")


class End(NamedTuple):
    """Conditions at one end.

    Attributes
    ----------
    q, v : ndarray (3, n)
        Guess (NaN where there is none), lower and upper bounds of coordinates and velocities.
    states : ndarray (3, m)
        Guess, lower and upper bounds of states beside the mechanics.
    momenta : list of int
        Of which coordinates the momentum is bounded: the first rows, in this order.
    rows : SX (e,)
        Further expressions of q, v, states, t, c.
    low, high : ndarray (e,)
        Their bounds.
    periodic : ndarray (n,) or None
        q and v at the end are those at the start plus this offset (NaN: this coordinate is not
        periodic).
    """

    q: np.ndarray
    v: np.ndarray
    states: np.ndarray
    momenta: list[int]
    rows: ca.SX
    low: np.ndarray
    high: np.ndarray
    periodic: np.ndarray | None


def end_conditions(
    system: System, what: str, given: Mapping[str, Any] | None, states: States
) -> End:
    """Conditions at an end as the user wrote them: dict(q=…, v=…, p=…, bounds=…, periodic=…)."""
    given = {} if given is None else given
    if not isinstance(given, Mapping):
        raise InputError(f"{what} must be a dictionary such as dict(q=[…], v=[…]), got {given!r}")
    unknown = sorted(set(given) - set(KEYS))
    if unknown:
        raise InputError(f"unknown keys {unknown} in {what}; known: {list(KEYS)}")
    s, n = system, system.structure.n
    if what == "start" and "periodic" in given:
        raise InputError("periodic= belongs to the end: end=dict(periodic=True)")
    rows, low, high = [ca.SX(0, 1)], [np.zeros(0)], [np.zeros(0)]
    state = ca.vertcat(s.q, s.v, states.symbols(s), s.t, s.c)
    _, p_low, p_high = _component_bounds(s.names, f"p of {what}", given.get("p"))
    bound = np.flatnonzero(np.isfinite(p_low) | np.isfinite(p_high)).tolist()
    rows.append(ca.vertcat(ca.SX(0, 1), *(s.momentum[i] for i in bound)))
    low.append(p_low[bound])
    high.append(p_high[bound])
    for lower, expression, upper in triples(f"bounds of {what}", given.get("bounds", ())):
        found = column(
            f"an expression in the bounds of {what}",
            expression,
            state,
            "q, v, states, t and the parameters",
        )
        sides = limits(f"{found} at the {what}", lower, upper, found.numel())
        rows.append(found)
        low.append(sides[0])
        high.append(sides[1])
    made = End(
        **bounds_at(system, what, given, states),
        momenta=bound,
        rows=ca.vertcat(*rows),
        low=np.concatenate(low),
        high=np.concatenate(high),
        periodic=_offset(given.get("periodic"), n, system.names),
    )
    return with_free_lengths(system, made) if what == "end" else made


VALUES = ("q", "v", "states")  # conditions that are bounds of unknowns


def bounds_at(
    system: System, what: str, given: Mapping[str, Any], states: States
) -> dict[str, np.ndarray]:
    """Guess, lower and upper bounds (3, …) of what is an unknown at an end."""
    return {
        "q": np.array(_component_bounds(system.names, f"q of {what}", given.get("q"))),
        "v": np.array(_component_bounds(system.names, f"v of {what}", given.get("v"))),
        "states": _state_bounds(system, what, given.get("states"), states),
    }


def _state_bounds(system: System, what: str, given: Any, states: States) -> np.ndarray:
    """Guess, lower and upper bound of each state, from {symbol: value}."""
    names = states.names(system)
    values: list[Any] = [None] * len(names)
    known = [x.element_hash() for x in ca.vertsplit(states.symbols(system))] if names else []
    entries = pairs(f"states of {what}", {} if given is None else given, "{symbol: value}")
    for symbol, value in entries:
        key = symbol.element_hash() if isinstance(symbol, ca.SX) else None
        if key not in known:
            raise InputError(
                f"states of {what} takes values of the states {list(names)}, got {symbol!r}"
            )
        values[known.index(key)] = value
    return np.array(_component_bounds(names, f"states of {what}", values))


def _component_bounds(
    names: Sequence[str], what: str, value: Any
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Guess, lower and upper bound of each component; None leaves it free, `free(…)` bounds it."""
    n = len(names)
    if value is None:
        value = [None] * n
    elif isinstance(value, (ca.DM, np.ndarray)):
        value = np.asarray(value, dtype=float).ravel().tolist()
    elif not isinstance(value, Sequence):
        value = [value]
    if not isinstance(value, Sequence) or isinstance(value, str) or len(value) != n:
        raise InputError(
            f"{what} takes entries, one for each of {list(names)} (None: free), got {value!r}"
        )
    guess, low, high = np.full(n, np.nan), np.full(n, -np.inf), np.full(n, np.inf)
    for i, entry in enumerate(value):
        if entry is None:
            continue
        if isinstance(entry, Free):
            if entry.guess.shape != ():
                raise InputError(f"{what}: {names[i]} takes one number, got {entry}")
            guess[i], low[i], high[i] = float(entry.guess), float(entry.lower), float(entry.upper)
            continue
        guess[i] = low[i] = high[i] = _number(f"{what}: {names[i]}", entry)
        if not np.isfinite(guess[i]):
            raise InputError(f"{what}: {names[i]} is not finite: {entry!r}; None leaves it free")
    return guess, low, high


def _number(what: str, x: Any) -> float:
    return parsed_or_refused(
        lambda: float_of(x), lambda: f"{what} must be a number, None or free(…), got {x!r}"
    )


def _offset(value: Any, n: int, names: Sequence[str]) -> np.ndarray | None:
    if value is None or value is False:
        return None
    if value is True:
        return np.zeros(n)
    return offsets("periodic", value, n, names)


def offsets(what: str, value: Any, n: int, names: Sequence[str]) -> np.ndarray:
    """One number for each coordinate, NaN where the user gave None."""
    wanted = f"{what} takes one finite offset (or None) for each of {list(names)}, got {value!r}"
    entries = (
        value
        if isinstance(value, Sequence)
        else parsed_or_refused(lambda: np.array(value, float).ravel(), lambda: wanted)
    )
    found = parsed_or_refused(
        lambda: np.array([0.0 if x is None else float_of(x) for x in entries]), lambda: wanted
    )
    if found.shape != (n,) or not np.isfinite(found).all():  # a symbol is NaN
        raise InputError(wanted)
    return np.where([x is None for x in entries], np.nan, found)

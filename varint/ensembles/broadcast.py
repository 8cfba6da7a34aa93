"""One row a member, from what users write: arrays that are broadcast along the leading axis."""

from __future__ import annotations

from typing import Any

import numpy as np

from varint.errors import InputError, parsed_or_refused
from varint.rules.rule import Rule
from varint.scene.inputs import control_values
from varint.scene.parameters import ParameterValues
from varint.scene.system import System, given_parameters

MOST_NAMED = 5  # members named in a message


def broadcast_rows(what: str, x: Any, shape: tuple[int, ...], names: Any) -> np.ndarray:
    """x as rows of `shape`: one for all, or one a member."""
    value = parsed_or_refused(
        lambda: np.array(x, dtype=float),
        lambda: f"{what} must be numbers of shape {shape} or (members, …), got {type(x).__name__}",
    )
    if shape == (1,) and value.ndim <= 1:
        value = value.reshape(-1, 1)  # one coordinate: a list of numbers is a list of members
    if value.shape == shape:
        value = value[None]
    if value.ndim != len(shape) + 1 or value.shape[1:] != shape or not len(value):
        raise InputError(
            f"{what} has shape {value.shape}; it must be {shape}, or {('members', *shape)} with "
            "one row a member" + (f" ({', '.join(names)})" if names else "")
        )
    bad = ~np.isfinite(value.reshape(len(value), -1)).all(axis=1)
    if bad.any():
        raise InputError(f"{what} is not finite in {name_members(bad, 0)}")
    return value


def broadcast_parameters(system: System, params: ParameterValues | None) -> dict[str, np.ndarray]:
    """Rows (1 or members, size) of every parameter, in the order of `system.c`."""
    given, found = given_parameters(system, params), {}
    for name, default in system.defaults.items():
        rows = broadcast_rows(f"params[{name!r}]", given.get(name, default), default.shape, None)
        # column by column
        found[name] = rows.transpose(0, *reversed(range(1, rows.ndim))).reshape(len(rows), -1)
    return found


def shaped_parameter(system: System, name: str, x: np.ndarray) -> np.ndarray:
    return x.reshape(system.defaults[name].shape, order="F")


def broadcast_controls(system: System, rule: Rule, u: Any, steps: int) -> np.ndarray:
    """Controls (1 or members, steps, k) or (…, steps, r, k): a leading axis only before a whole
    table.
    """
    k, r = system.structure.controls, len(rule.nodes)
    value = control_values(u)
    tables = [(steps, k), (steps, r, k)]
    shared, each = (
        value.shape in [*tables, (k,), ()] or value.ndim < 2,
        value.ndim > 2 and value.shape[1:] in tables,
    )
    if shared and each:
        raise InputError(
            f"u with shape {value.shape} may be one table ({steps}, {r}, {k}) for all or ({steps}, "
            f"{k}) for each of {len(value)} members; give it as (members, {steps}, {r}, {k})"
        )
    return value if each else value[None]


def broadcast_tables(system: System, u: Any) -> np.ndarray:
    """Controls of runs whose steps are chosen, (1 or members, rows, k) or (…, rows, r, k): a
    leading axis only before a whole table, which has one row where they are the same all the time.
    """
    k = system.structure.controls
    value = control_values(u)
    if value.shape in ((), (k,)):
        value = value.reshape(1, -1)
    elif value.ndim == 1 and k == 1:
        value = value[:, None]
    if k and (value.ndim not in (2, 3, 4) or value.shape[-1] != k or 0 in value.shape):
        raise InputError(
            f"u has shape {np.shape(u)}; where steps are chosen it must be ({k},), (rows, {k}) or "
            f"(members, rows, {k})"
        )
    return value[None] if value.ndim < 3 else value


def name_members(bad: np.ndarray, first: int) -> str:
    numbers = np.flatnonzero(bad) + first
    more = f", … ({len(numbers)} in all)" if len(numbers) > MOST_NAMED else ""
    return f"members {numbers[:MOST_NAMED].tolist()}{more}"

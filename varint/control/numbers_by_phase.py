"""Other numbers for a problem of several phases: which of them belong to which phase."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from varint.control.problem import ControlProblem
from varint.errors import InputError
from varint.scene.parameters import ParameterValues, values_by_name
from varint.scene.system import given_parameters

KEYS = ("start", "end", "params", "duration")


def changes_by_phase(
    problem: ControlProblem,
    start: Mapping[str, Any] | None,
    end: Mapping[str, Any] | None,
    params: ParameterValues | None,
    duration: float | None,
    phases: Mapping[int, Mapping[str, Any]] | None,
) -> list[dict[str, Any]]:
    """What changes in each phase: the start is that of the first, the end that of the last,
    parameters are those of all phases that know them; `phases` has the numbers of one phase each.
    """
    last, changes = len(problem.phases) - 1, _checked(problem, phases)
    if duration is not None and last:
        raise InputError(
            f"duration= is that of the only phase; this problem has {last + 1}: "
            "phases={0: dict(duration=…)}"
        )
    for k, what, value in ((0, "start", start), (last, "end", end), (0, "duration", duration)):
        if value is not None and what in changes[k]:
            raise InputError(f"{what} is given twice: by {what}= and by phases={{{k}: …}}")
        if value is not None:
            changes[k][what] = value
    for k, given in enumerate(_parameters(problem, params)):
        if given:
            own = given_parameters(problem.phases[k].phase.system, changes[k].get("params"))
            changes[k]["params"] = {**given, **own}
    return changes


def _checked(problem: ControlProblem, phases: Any) -> list[dict[str, Any]]:
    count = len(problem.phases)
    changes: list[dict[str, Any]] = [{} for _ in range(count)]
    if phases is not None and not isinstance(phases, Mapping):
        raise InputError(f"phases must be numbers by phase, {{0: dict(end=…)}}, got {phases!r}")
    for k, change in (phases or {}).items():
        if isinstance(k, bool) or not isinstance(k, int) or not 0 <= k < count:
            raise InputError(f"phases= has numbers of phase {k!r}; there are {count}: 0 …")
        if not isinstance(change, Mapping) or not set(change) <= set(KEYS):
            raise InputError(
                f"phases={{{k}: …}} takes a dictionary with some of {list(KEYS)}, got {change!r}"
            )
        changes[k] = {what: value for what, value in change.items() if value is not None}
    return changes


def _parameters(problem: ControlProblem, params: ParameterValues | None) -> list[dict[str, Any]]:
    """Of parameters given for all phases, those that each of them has."""
    given = {} if params is None else values_by_name(params)
    systems = [part.phase.system for part in problem.phases]
    known = {name: None for system in systems for name in system.defaults}
    if unknown := [name for name in given if name not in known]:
        raise InputError(f"unknown parameters {unknown}; known: {list(known)}")
    return [{name: x for name, x in given.items() if name in y.defaults} for y in systems]

"""Other numbers in a problem that is built: ends, duration, start time, parameters.

What is given and what is free stays; the unknowns, the rows and their derivatives are the same.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np

from varint.control.ends import VALUES, End, bounds_at, end_conditions
from varint.control.feasibility import check_feasibility
from varint.control.layout import bound_unknowns
from varint.control.numbers_by_phase import changes_by_phase
from varint.control.phase import CheckedPhase, start_of
from varint.control.problem import ControlProblem
from varint.control.transcription import PhaseTranscription
from varint.errors import InputError
from varint.nlp.program import NonlinearProgram
from varint.numerics.limits import check_steps
from varint.scene.inputs import number
from varint.scene.parameters import ParameterValues
from varint.scene.system import (
    given_parameters,
    parameter_values,
    parameters_by_name,
)


def with_numbers(
    problem: ControlProblem,
    start: Mapping[str, Any] | None = None,
    end: Mapping[str, Any] | None = None,
    params: ParameterValues | None = None,
    duration: float | None = None,
    t0: float | None = None,
    phases: Mapping[int, Mapping[str, Any]] | None = None,
) -> ControlProblem:
    """The problem with these numbers; what is not named stays as it was. The start is that of the
    first phase, the end that of the last, parameters are those of all phases that know them;
    `phases` has the numbers of one phase each.
    """
    changes = changes_by_phase(problem, start, end, params, duration, phases)
    for k, change in enumerate(changes):
        if change or not k:
            problem = _with_numbers_of(problem, k, **change, t0=None if k else t0)
    return _with_start_times(problem)


def _with_start_times(problem: ControlProblem) -> ControlProblem:
    """Each phase begins when the one before ends, as far as both times are given; a guess of them
    otherwise.
    """
    data, phases = problem.nlp.p.copy(), list(problem.phases)
    for k in range(1, len(phases)):
        before, part = phases[k - 1], phases[k]
        t0 = before.t0 + before.phase.duration[0]
        data[part.first_shared] = t0
        phases[k] = replace(part, data=data[part.first_datum :][: len(part.data)])
    return replace(problem, phases=phases, nlp=replace(problem.nlp, p=data))


def _with_numbers_of(
    problem: ControlProblem,
    k: int,
    start: Mapping[str, Any] | None = None,
    end: Mapping[str, Any] | None = None,
    params: ParameterValues | None = None,
    duration: float | None = None,
    t0: float | None = None,
) -> ControlProblem:
    """The problem with these numbers in one phase."""
    part, nlp = problem.phases[k], problem.nlp
    phase, system = part.phase, part.phase.system
    given = phase.given
    changed: dict[str, Any] = {}
    for what, known, now, new in (
        ("start", start_of(given), phase.start, start),
        ("end", given.end or {}, phase.end, end),
    ):
        if new is not None:
            if not isinstance(new, Mapping):
                raise InputError(
                    f"{what} must be a dictionary such as dict(q=[…], v=[…]), got {new!r}"
                )
            merged = {**known, **new}
            changed[what] = _end(phase, what, now, merged, set(new))
            if what == "start":
                given = replace(given, start=merged, q0=None, v0=None, p0=None)
            else:
                given = replace(given, end=merged)
    if duration is not None:
        if phase.free_duration:
            raise InputError("the duration is free: the solver chooses it; leave duration= out")
        if not number("the duration", duration) > 0:
            raise InputError(f"the duration must be positive, got {duration!r}")
        given = replace(given, duration=duration)
    data = constants(part, nlp.p, t0, params, duration)
    if params is not None:
        c = data[part.first_shared + 2 :][: len(phase.c)]
        low, high = (
            np.where(phase.c_low < phase.c_high, x, c) for x in (phase.c_low, phase.c_high)
        )
        changed |= dict(c=c, c_low=low, c_high=high)
        own = given_parameters(system, given.params)
        given = replace(given, params={**own, **given_parameters(system, params)})
    if duration is not None:
        changed["duration"] = (float(duration),) * 3
    phase = replace(phase, given=given, **changed)
    check_feasibility(phase, float(data[part.first_shared]))
    g_low, g_high = _row_bounds(part, phase, nlp)
    first, last = int(part.slots.q[0, 0]), part.slots.end
    x_low, x_high = nlp.x_low.copy(), nlp.x_high.copy()
    x_low[first:last], x_high[first:last] = bound_unknowns(phase, part.slots, first)
    rows = slice(part.first_row, part.rows.end)
    own_part = replace(
        part,
        phase=phase,
        data=data[part.first_datum :][: len(part.data)],
        x_low=x_low[first:last],
        x_high=x_high[first:last],
        g_low=g_low[rows],
        g_high=g_high[rows],
    )
    numbers = replace(nlp, p=data, x_low=x_low, x_high=x_high, g_low=g_low, g_high=g_high)
    phases = [own_part if i == k else other for i, other in enumerate(problem.phases)]
    return replace(problem, phases=phases, nlp=numbers)


def constants(
    part: PhaseTranscription,
    p: np.ndarray,
    t0: float | None = None,
    params: ParameterValues | None = None,
    duration: float | None = None,
) -> np.ndarray:
    """The program's constants p with this start time, these parameters and this duration."""
    data, phase = p.copy(), part.phase
    if t0 is not None:
        check_steps(number("t", t0), phase.shortest_step, 1)
        data[part.first_shared] = t0
    if duration is not None:
        data[part.first_shared + 1] = duration
    if params is not None:
        system = phase.system
        given = given_parameters(system, params)
        if chosen := [name for name in given if name in _free_names(phase)]:
            raise InputError(f"the parameters {chosen} are free: the solver chooses them")
        c = parameter_values(system, {**parameters_by_name(system, phase.c), **given})
        data[part.first_shared + 2 :][: len(c)] = c
    return data


def _free_names(phase: CheckedPhase) -> set[str]:
    names = parameters_by_name(phase.system, phase.c_low < phase.c_high)
    return {name for name, is_free in names.items() if np.any(is_free)}


def _end(
    phase: CheckedPhase, what: str, known: End, merged: Mapping[str, Any], named: set[str]
) -> End:
    """The conditions at an end, if they are of the same kind as those the problem was built
    with.
    """
    system, states = phase.system, phase.states
    plain = named <= set(VALUES) and not system.rays
    if plain:
        at = bounds_at(system, what, merged, states)
        found = known._replace(q=at["q"], v=at["v"], states=at["states"])
    else:
        found = end_conditions(system, what, merged, states)
    for letter, entries, old, new in (
        ("q", system.names, known.q, found.q),
        ("v", system.names, known.v, found.v),
        ("states", states.names(system), known.states, found.states),
    ):
        was, now = old[1] == old[2], new[1] == new[2]
        if not np.array_equal(was, now):
            names = [x for x, y in zip(entries, was != now, strict=True) if y]
            raise InputError(
                f"{letter} of {what}: {names} were {'given' if was[was != now][0] else 'free'} "
                "when the problem was built, and stay so; solve another problem with "
                "optimal_control(…, guess=motion)"
            )
    if plain:
        return found
    same = known.rows.numel() == found.rows.numel() and all(
        ca.is_equal(a, b, 2)
        for a, b in zip(ca.vertsplit(known.rows), ca.vertsplit(found.rows), strict=True)
    )
    periodic = known.periodic is None and found.periodic is None
    if not same or not (periodic or np.array_equal(known.periodic, found.periodic)):  # type: ignore[arg-type]
        raise InputError(
            f"the {what} has conditions of another kind than the problem was built with: "
            "expressions, momenta and periodic offsets stay; only their bounds may change"
        )
    return found


def _row_bounds(
    part: PhaseTranscription, phase: CheckedPhase, nlp: NonlinearProgram
) -> tuple[np.ndarray, np.ndarray]:
    """Bounds of the rows with the conditions at the ends of this phase."""
    low, high = nlp.g_low.copy(), nlp.g_high.copy()
    gaps, held = phase.system.structure.constraints, phase.system.structure.velocity_rows
    for end, rows, skipped in (
        (phase.start, part.rows.start, gaps + held),
        (phase.end, part.rows.last, held),
    ):
        at = rows[skipped:][: len(end.low)]
        low[at[at >= 0]], high[at[at >= 0]] = end.low[at >= 0], end.high[at >= 0]
    return low, high

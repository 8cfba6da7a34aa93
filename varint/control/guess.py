"""Where the solver starts: a straight line, arrays, functions of time, a trajectory or an
earlier solution.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from varint.control.constrained_guess import move_onto_constraints, move_path_onto_constraints
from varint.control.inverse_dynamics import controls_along, states_between_ends
from varint.control.phase import CheckedPhase
from varint.control.piecewise import Piecewise
from varint.control.problem import ControlProblem, guess_ends
from varint.control.slack_values import write_slacks
from varint.control.solution import ControlSolution
from varint.control.transcription import PhaseTranscription
from varint.errors import InputError, parsed_or_refused
from varint.results.trajectory import Trajectory
from varint.scene.inputs import float_of

KEYS = ("q", "u", "duration")
Path = Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True, eq=False)
class Guess:
    """Path and controls as functions of the fraction of the duration, (M,) → (M, n) and (M, k)."""

    q: Path
    u: Path | None
    duration: float
    c: np.ndarray


def build_start(problem: ControlProblem) -> np.ndarray:
    """Start values of all unknowns from the phases' guesses, within their bounds."""
    x = np.zeros(problem.unknowns)
    for transcription in problem.phases:
        write_guess(x, transcription, read_guess(transcription.phase, transcription.t0))
    return np.clip(x, problem.nlp.x_low, problem.nlp.x_high)


def read_guess(phase: CheckedPhase, t0: float) -> Guess:
    """The guess of a phase in whatever form the user gave it."""
    given = phase.guess
    if isinstance(given, Trajectory):
        return _from_trajectory(phase, given)
    if given is None:
        return Guess(_straight(phase, t0), None, phase.duration[0], phase.c)
    if not isinstance(given, Mapping):
        raise InputError(
            f"guess must be a Trajectory or a dictionary with {list(KEYS)}, got "
            f"{type(given).__name__}"
        )
    unknown = sorted(set(given) - set(KEYS))
    if unknown:
        raise InputError(f"unknown keys {unknown} in guess; known: {list(KEYS)}")
    duration = _guessed_duration(given.get("duration", phase.duration[0]))
    s = phase.system.structure
    q = _path("q", given["q"], s.n, t0, duration) if "q" in given else _straight(phase, t0)
    u = _path("u", given["u"], s.controls, t0, duration) if "u" in given else None
    return Guess(q, u, duration, phase.c)


def _guessed_duration(value: Any) -> float:
    try:
        duration = float_of(value)
    except (TypeError, ValueError):
        duration = np.nan
    if not (np.isfinite(duration) and duration > 0):
        raise InputError(f"the guess of the duration must be a positive number, got {value!r}")
    return duration


def _straight(phase: CheckedPhase, t0: float) -> Path:
    """The line between the ends; on a constrained scene a path near it that keeps to the
    constraints.
    """
    first, last = guess_ends(phase)

    def line(s: np.ndarray) -> np.ndarray:
        return (1 - s[:, None]) * first + s[:, None] * last

    if not phase.system.structure.constraints:
        return line
    moves = np.array([end.q[1] < end.q[2] for end in (phase.start, phase.end)])
    return move_path_onto_constraints(phase.system, line, t0, phase.duration[0], phase.c, moves)


def _from_trajectory(phase: CheckedPhase, motion: Trajectory) -> Guess:
    if motion.q.shape[1] != phase.system.structure.n:
        raise InputError(
            f"the guess has {motion.q.shape[1]} coordinates, the system "
            f"{phase.system.structure.n}: {list(phase.system.names)}"
        )
    c = (
        np.where(phase.c_low < phase.c_high, motion.c, phase.c)
        if motion.c.shape == phase.c.shape
        else phase.c
    )
    found = motion.solution
    if isinstance(found, ControlSolution):
        return Guess(found.q, found.u, motion.duration, c)
    u = None
    if motion.u.size and motion.u.shape[-1] == phase.system.structure.controls:
        nodes = np.array(motion.rule.nodes) if motion.u.shape[1] > 1 else np.array([0.5])
        u = Piecewise(np.linspace(0, 1, len(motion.u) + 1), nodes, motion.u)
    return Guess(hermite(motion.t - motion.t[0], motion.q, motion.v), u, motion.duration, c)


def hermite(t: np.ndarray, q: np.ndarray, v: np.ndarray) -> Path:
    """Cubic through positions and velocities at the times t, which begin with 0."""

    def path(s: np.ndarray) -> np.ndarray:
        at = s * t[-1]
        i = np.clip(np.searchsorted(t, at, side="right") - 1, 0, len(t) - 2)
        h = (t[i + 1] - t[i])[:, None]
        x = ((at - t[i])[:, None]) / h
        left, right = (1 - x) ** 2, x**2
        return left * ((1 + 2 * x) * q[i] + h * x * v[i]) + right * (
            (3 - 2 * x) * q[i + 1] - h * (1 - x) * v[i + 1]
        )

    return path


def _path(what: str, given: Any, size: int, t0: float, duration: float) -> Path:
    """A function of time, or samples evenly spaced over the duration, as a path."""
    if callable(given):

        def sampled(s: np.ndarray) -> np.ndarray:
            found = [given(float(t0 + x * duration)) for x in s]
            values = parsed_or_refused(
                lambda: np.array([np.asarray(y, dtype=float).ravel() for y in found]),
                lambda: (
                    f"the guess of {what} must give {size} numbers at any time, got {found[0]!r}"
                ),
            )
            return _checked_samples(what, values if found else np.zeros((0, size)), size)

        return sampled
    try:
        values = np.array(given, dtype=float)
    except (TypeError, ValueError):
        raise InputError(
            f"the guess of {what} must be numbers or a function of time, got {given!r}"
        ) from None
    if values.ndim == 1:
        values = values[None] if len(values) == size else values[:, None]
    if values.ndim == 3:  # (steps, r, k): controls of a trajectory
        values = values.mean(axis=1)
    values = _checked_samples(what, values, size)
    places = np.linspace(0, 1, len(values)) if len(values) > 1 else np.zeros(1)
    return lambda s: np.array([np.interp(s, places, column) for column in values.T]).T


def _checked_samples(what: str, values: np.ndarray, size: int) -> np.ndarray:
    if not np.isfinite(values).all():
        raise InputError(
            f"the guess of {what} is not finite in {int((~np.isfinite(values)).sum())} of its "
            "numbers"
        )
    if values.ndim != 2 or values.shape[1] != size:
        raise InputError(
            f"the guess of {what} has shape {values.shape}; it takes (samples, {size})"
        )
    return values


def write_guess(x: np.ndarray, transcription: PhaseTranscription, guess: Guess) -> None:
    """Write the guess into the unknowns of a phase."""
    phase, slots, rule = transcription.phase, transcription.slots, transcription.phase.rule
    mesh, steps = phase.mesh, np.diff(phase.mesh)
    inside = (mesh[:-1, None] + steps[:, None] * np.array(rule.points[1:-1])).ravel()
    for index, at in ((slots.q, mesh), (slots.inner, inside)):
        q = guess.q(at)
        if phase.system.structure.constraints and len(at):
            times = transcription.t0 + guess.duration * at
            q = move_onto_constraints(phase.system, q, times, guess.c)[0]
        x[index] = q.reshape(index.shape)
    points = np.concatenate(
        [x[slots.q[:-1]][:, None], x[slots.inner], x[slots.q[1:]][:, None]], axis=1
    )
    h = guess.duration * steps
    v_nodes = np.einsum("ij,kjn->kin", rule.slopes, points) / h[:, None, None]
    x[slots.v[0]], x[slots.v[1]] = v_nodes[0, 0], v_nodes[-1, -1]
    values = np.concatenate([[transcription.t0, guess.duration], guess.c])
    x[slots.shared[slots.shared >= 0]] = values[slots.shared >= 0]
    if slots.u.size:
        _write_controls(x, transcription, guess, points)
    write_slacks(x, transcription, values)


def _write_controls(
    x: np.ndarray, transcription: PhaseTranscription, guess: Guess, points: np.ndarray
) -> None:
    """The controls of the guess, or those that come closest to moving along its points."""
    phase, slots = transcription.phase, transcription.slots
    index, places = (
        phase.states.index,
        phase.mesh[:-1, None] + (np.diff(phase.mesh)[:, None] * phase.control_places),
    )
    if guess.u is not None:
        u = guess.u(places.ravel()).reshape(phase.steps, -1, slots.u.shape[2])
        states = guess.u(phase.mesh)[:, index]
    else:
        states = states_between_ends(phase)
        nodes = np.array(phase.rule.nodes)[:, None]
        held = states[:-1, None] + nodes * (states[1:] - states[:-1])[:, None]
        u = controls_along(phase, transcription.t0, guess.duration, guess.c, points, held)
        if phase.samples == 1:
            u = u.mean(axis=1, keepdims=True)
    x[slots.states] = states
    x[slots.u[: phase.steps]] = u[:, : phase.samples]
    if phase.closing_controls:
        x[slots.u[-1]] = u[-1, -1:]

"""Where a solver starts when nobody says where: several default guesses, the most promising first.

A straight line with the controls that come closest to it serves a scene that starts from rest. A
scene that starts in motion (an orbit) is better served by its own motion without controls, bent to
where it shall end: a line that ignores the start's velocity breaks the equations of motion at once.
Where nothing else helps a motion is found by trial.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import casadi as ca
import numpy as np

from varint.control.guess import Guess, build_start, read_guess, write_guess
from varint.control.inverse_dynamics import rest_controls
from varint.control.neighbours import wave
from varint.control.problem import ControlProblem
from varint.control.scaling import choose_scales
from varint.control.transcription import PhaseTranscription
from varint.errors import VarintError
from varint.numerics.arrays import over_columns
from varint.scene.system import parameters_by_name

DETOURS = 4  # paths around, where the straight line would have to slip
BEND = 0.3  # height of their waves, of each coordinate's range
SLIP = 1e-9  # of the range of the coordinates: rows broken by less are not
NEARLY = 0.1  # of what a straight line breaks: a guess that breaks less is nearly a motion
PREFERRED = 3.0  # times the violation of the line: up to this the start's own motion goes first


def default_starts(problem: ControlProblem) -> Iterator[np.ndarray]:
    """Start values of all unknowns, one guess after the other, built when they are asked for.

    A phase for which the user gave a guess keeps to it.
    """
    line = build_start(problem)
    open_phases = [part for part in problem.phases if part.phase.guess is None]
    if not open_phases:
        yield line
        return
    yield from _detours(problem, line, [part for part in open_phases if _slips(part)])
    moving = [part for part in open_phases if _starts_in_motion(part)]
    first = _with_guesses(problem, line, {part: _bent(part) for part in moving})
    if first is not None and _violation(problem, first) <= PREFERRED * _violation(problem, line):
        yield first
        first = None
    yield line
    if first is not None:
        yield first
    resting = [part for part in open_phases if part not in moving and _start_is_given(part)]
    bent = _with_guesses(problem, line, {part: _bent(part) for part in resting})
    if bent is not None:
        yield bent
    controlled = [part for part in open_phases if part.slots.u.size]
    unforced = _with_guesses(problem, line, {part: _unforced(part) for part in controlled})
    if unforced is not None:
        yield unforced
    from varint.control.trial import can_be_tried, tried

    weak = [part for part in open_phases if len(problem.phases) == 1 and can_be_tried(part)]
    found = _with_guesses(problem, line, {part: tried(part) for part in weak})
    if found is not None:
        yield found


def must_go_around(problem: ControlProblem) -> bool:
    """One phase without a guess, along whose straight line it would have to slip."""
    part = problem.phases[0]
    return len(problem.phases) == 1 and part.phase.guess is None and _slips(part)


def _slips(part: PhaseTranscription) -> bool:
    """Does the straight line break a non-holonomic row?"""
    phase, s = part.phase, part.phase.system
    if not s.structure.nonholonomic:
        return False
    q = read_guess(phase, part.t0).q(phase.mesh)
    t = part.t0 + phase.duration[0] * phase.mesh
    along = s.nonholonomic @ s.v
    slip = ca.Function("slip", [s.q, s.v, s.t, s.c], [ca.densify(along)])
    rows = over_columns(slip, q[:-1], np.diff(q, axis=0), t[:-1, None], phase.c)[0]
    return bool(np.abs(rows).max(initial=0.0) > SLIP * np.ptp(q, axis=0).max(initial=0.0))


def _detours(
    problem: ControlProblem, line: np.ndarray, parts: list[PhaseTranscription]
) -> Iterator[np.ndarray]:
    """Ways around, where the straight line would have to slip: along it the rows say nothing about
    how to get sideways, so that no solver leaves it. Sine waves in all coordinates do.
    """
    if not parts:
        return
    random = np.random.default_rng(0)
    for _ in range(DETOURS):
        guesses: dict[PhaseTranscription, Guess | None] = {
            part: wave(read_guess(part.phase, part.t0), part, BEND, random) for part in parts
        }
        found = _with_guesses(problem, line, guesses)
        if found is not None:
            yield found


def without_guesses(problem: ControlProblem) -> ControlProblem:
    """The same problem as if nobody had given a guess."""
    phases = [replace(part, phase=replace(part.phase, guess=None)) for part in problem.phases]
    return replace(problem, phases=phases)


def is_nearly_a_motion(problem: ControlProblem, x: np.ndarray) -> bool:
    """Does a start break the rows far less than a straight line between the ends does?"""
    line = build_start(without_guesses(problem))
    return _violation(problem, x) <= NEARLY * _violation(problem, line)


def _start_is_given(part: PhaseTranscription) -> bool:
    start = part.phase.start
    return bool((start.q[1] == start.q[2]).all() and (start.v[1] == start.v[2]).all())


def _starts_in_motion(part: PhaseTranscription) -> bool:
    return _start_is_given(part) and bool(part.phase.start.v[0].any())


def _bent(part: PhaseTranscription) -> Guess | None:
    """The motion from the start with the controls at rest, bent to the coordinates given at the
    end; the velocity at the start stays. None where there is no such motion.
    """
    from varint.integration.simulate import simulate

    phase, rest = part.phase, rest_controls(part.phase)
    try:
        motion = simulate(
            phase.system,
            phase.rule,
            q0=phase.start.q[0],
            v0=phase.start.v[0],
            duration=phase.duration[0],
            steps=phase.steps,
            t0=part.t0,
            u=np.tile(rest, (phase.steps, 1)) if len(rest) else None,
            params=parameters_by_name(phase.system, phase.c),
        )
    except VarintError:  # it meets a singular point, or what it needs is not there
        return None
    own = read_guess(replace(phase, guess=motion), part.t0)
    lacking = phase.end.q[0] - motion.q[-1]
    if phase.end.periodic is not None:
        lacking = np.where(
            np.isnan(phase.end.periodic), lacking, phase.end.periodic + motion.q[0] - motion.q[-1]
        )
    if not np.nan_to_num(lacking).any():
        return own
    return replace(own, q=lambda s: own.q(s) + s[:, None] ** 2 * np.nan_to_num(lacking), u=None)


def _unforced(part: PhaseTranscription) -> Guess:
    """The straight line, with the controls at rest."""
    rest = rest_controls(part.phase)
    return replace(read_guess(part.phase, part.t0), u=lambda s: np.tile(rest, (len(s), 1)))


def _with_guesses(
    problem: ControlProblem, line: np.ndarray, guesses: dict[PhaseTranscription, Guess | None]
) -> np.ndarray | None:
    """The start values with other guesses for some phases; None where there is nothing else."""
    x, changed = line.copy(), False
    for part, guess in guesses.items():
        if guess is not None:
            write_guess(x, part, guess)
            changed = True
    if not changed or not np.isfinite(x).all():
        return None
    return np.clip(x, problem.nlp.x_low, problem.nlp.x_high)


def _violation(problem: ControlProblem, x: np.ndarray) -> float:
    """How much all rows are violated, root of the sum of squares in units that suit the problem."""
    nlp = problem.nlp
    g = np.array(nlp.program.value(x, nlp.p)[1]).ravel()
    if not np.isfinite(g).all():
        return float("inf")
    off = np.maximum(np.maximum(nlp.g_low - g, g - nlp.g_high), 0)
    return float(np.linalg.norm(off * choose_scales(problem, x).g))

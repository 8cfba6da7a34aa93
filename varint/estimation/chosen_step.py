"""The step of a fit that was given none: short enough for the motion of the guess, and halved while
its own error moves estimates.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from varint.errors import ConvergenceError, InputError
from varint.estimation.first_part import with_values
from varint.estimation.measurement import Experiment
from varint.estimation.noise import fit_with_noise
from varint.estimation.outcome import fit_of
from varint.estimation.problem import Estimation, Motion
from varint.estimation.result import Fit
from varint.estimation.step_error import with_half_steps
from varint.integration.problem import controls
from varint.integration.simulate import simulate
from varint.rules.rule import Rule
from varint.scene.system import System, parameters_by_name

GUESSED = 1e-6  # error, relative to the motion, of the guess's run whose steps are taken
FEWEST = 50  # steps of a motion: as few cost next to nothing
UNKNOWN = 200  # steps of a motion whose guess cannot be run
MOST = 2_000  # that the guess asks for: where it meets what the true motion may not
HALVINGS, LONGEST = 6, 100_000  # times, and steps of a motion that is halved once more
WHOLE = 1e300  # a step that every motion is over in


def require_constant_controls(
    system: System, rule: Rule, experiments: Sequence[Experiment]
) -> None:
    """Raises InputError where controls are those of steps, which are not known yet."""
    for x in experiments:
        try:
            controls(system, rule, x.u, 1)
        except InputError as refusal:
            if x.u is None or np.ndim(x.u) == 0:
                raise
            raise InputError(
                "give h: a table of controls says how they are in each of its steps, and without h "
                "steps are chosen"
            ) from refusal


def step_for(problem: Callable[[float], Estimation]) -> float:
    """The step with which the guess of every motion is right to `GUESSED`, of the problem by its
    step.
    """
    p = problem(WHOLE)
    return min([_step_of(p, motion) for motion in p.motions])


def _step_of(p: Estimation, motion: Motion) -> float:
    lasts = float(motion.times[-1] - motion.t0)
    if not lasts > 0:
        return 1.0
    q0, v0 = np.split(motion.start, 2)
    start: dict[str, Any] = {
        "q0": q0,
        "v0": v0,
        "t0": motion.t0,
        "params": parameters_by_name(p.system, p.c),
    }
    if motion.u.shape[2]:
        start["u"] = motion.u[0, 0]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # how true the guess is does not matter
        try:
            guess = simulate(p.system, p.rule, **start, duration=lasts, tol=GUESSED, progress=False)
            shortest = float(np.diff(guess.t).min())
        except ConvergenceError:  # the fit says why, where the data suggest no other start
            shortest = lasts / UNKNOWN
    return min(max(shortest, lasts / MOST), lasts / FEWEST)


def with_shorter_steps(made: Fit, huber: float | None) -> Fit:
    """The fit with half of the step, and so on, while that moves estimates by what counts."""
    for _ in range(HALVINGS):
        shoot, solved = made.origin.shoot, made.origin.solved
        longest = max([motion.steps for motion in shoot.problem.motions])
        if not made.step_error or longest > LONGEST:
            break
        finer = with_values(with_half_steps(shoot.problem), solved.z)
        made = fit_of(*fit_with_noise(replace(shoot, problem=finer), huber))
    return made

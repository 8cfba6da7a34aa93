"""A start from the same problem by the trapezoidal rule, roughly solved.

It has few unknowns a step and no polynomial between the nodes that could swing, so that it is
solved from paths that a rule of high order is not, and in a fraction of the time; its path is near
enough for the rule that is wanted.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np

from varint.control.build import build_control_solver
from varint.control.guess import build_start, read_guess, write_guess
from varint.control.inverse_dynamics import rest_controls
from varint.control.problem import ControlProblem, transcribe
from varint.control.trajectories import build_trajectories
from varint.rules.rule import trapezoidal

ROUGH = {
    "tol": 1e-3,
    "acceptable_tol": 1e-2,
    "constr_viol_tol": 1e-4,
    "bound_relax_factor": 1e-8,
    "max_iter": 300,
}


class RoughStart(NamedTuple):
    """Start values of all unknowns from a rough solution, None where there is none; the iterations
    that it took; whether it was stopped on request.
    """

    x: np.ndarray | None
    iterations: int
    stopped: bool = False


def coarse_start(problem: ControlProblem, progress: bool | None = False) -> RoughStart:
    """A start from the same problem by the trapezoidal rule."""
    parts = problem.phases
    if any(x.phase.system.structure.constraints or x.phase.rule.degree < 2 for x in parts):
        return RoughStart(None, 0)
    phases = [replace(x.phase.given, rule=trapezoidal(), mesh=x.phase.mesh, steps=0) for x in parts]
    rough = transcribe(phases, problem.given_links, parts[0].t0, "interpreted")
    x = build_start(rough)
    for part in rough.phases:
        guess = read_guess(part.phase, part.t0)
        if guess.u is None:  # those of inverse dynamics follow every kink of a guess
            write_guess(x, part, replace(guess, u=partial(_constant, rest_controls(part.phase))))
    x = np.clip(x, rough.nlp.x_low, rough.nlp.x_high)
    outcome = build_control_solver(rough, x, "ipopt", {"ipopt": ROUGH})(x, progress=progress)
    if not (outcome.success or outcome.stopped):
        return RoughStart(None, outcome.iterations)
    start = build_start(problem)
    for part, motion in zip(parts, build_trajectories(rough, outcome), strict=True):
        write_guess(start, part, read_guess(replace(part.phase, guess=motion), part.t0))
    if not np.isfinite(start).all():
        return RoughStart(None, outcome.iterations)
    x = np.clip(start, problem.nlp.x_low, problem.nlp.x_high)
    return RoughStart(x, outcome.iterations, outcome.stopped)


def _constant(value: np.ndarray, at: np.ndarray) -> np.ndarray:
    return np.tile(value, (len(at), 1))

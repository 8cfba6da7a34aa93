"""Multipliers to start from: those of an earlier solution, carried over to another mesh, rule or
problem.

On a Galerkin step the multipliers of the rows e_0 … e_d are the values of a polynomial costate μ(t)
at the control points, so they are interpolated like the path. Multipliers of bounds are densities
times h b_i.
"""

from __future__ import annotations

import numpy as np

from varint.control.phase import CheckedPhase
from varint.control.piecewise import Piecewise
from varint.control.problem import ControlProblem
from varint.control.solution import ControlSolution, Origin
from varint.control.transcription import PhaseTranscription
from varint.results.trajectory import Trajectory


def carry_multipliers(problem: ControlProblem) -> tuple[np.ndarray, np.ndarray] | None:
    """(lam_x, lam_g) where every phase starts from an earlier solution of this run, else None."""
    guesses = [transcription.phase.guess for transcription in problem.phases]
    solutions = [
        g.solution
        for g in guesses
        if isinstance(g, Trajectory) and isinstance(g.solution, ControlSolution)
    ]
    origins = [(x, x.origin) for x in solutions if x.origin is not None]
    if len(origins) < len(guesses):
        return None
    first = origins[0][1].outcome
    fits = len(first.lam_x) == problem.unknowns and len(first.lam_g) == len(problem.nlp.g_low)
    if fits and all(
        _same(transcription, origin.phase)
        for transcription, (_, origin) in zip(problem.phases, origins, strict=True)
    ):
        return first.lam_x, first.lam_g
    lam_x, lam_g = np.zeros(problem.unknowns), np.zeros(len(problem.nlp.g_low))
    for transcription, (solution, origin) in zip(problem.phases, origins, strict=True):
        _carry(lam_x, lam_g, transcription, solution, origin)
    return lam_x, lam_g


def _same(transcription: PhaseTranscription, found: CheckedPhase) -> bool:
    return transcription.phase.rule == found.rule and np.array_equal(
        transcription.phase.mesh, found.mesh
    )


def _carry(
    lam_x: np.ndarray,
    lam_g: np.ndarray,
    transcription: PhaseTranscription,
    found: ControlSolution,
    origin: Origin,
) -> None:
    phase, rows, slots = transcription.phase, transcription.rows, transcription.slots
    mesh, points = phase.mesh, np.array(phase.rule.points)
    steps = np.diff(mesh)
    if found.costate.values.shape[2] != phase.system.structure.n:
        return
    lam_g[rows.momentum] = found.costate(mesh)
    inside = (mesh[:-1, None] + steps[:, None] * points[1:-1]).ravel()
    lam_g[rows.inner] = found.costate(inside).reshape(rows.inner.shape)
    source = origin.transcription
    if phase.linear or source.phase.linear:
        return
    new, old = slots.u[: phase.steps], source.slots.u[: source.phase.steps]
    if not new.size or old.shape[2] != new.shape[2]:
        return
    density = origin.outcome.lam_x[old] / (
        np.diff(found.mesh)[:, None, None] * source.phase.control_weights[:, None]
    )
    level = Piecewise(found.mesh, np.array([0.5]), density.mean(axis=1, keepdims=True))
    at = phase.control_places
    places = (mesh[:-1, None] + steps[:, None] * at).ravel()
    lam_x[new] = (
        level(places).reshape(new.shape) * steps[:, None, None] * phase.control_weights[:, None]
    )

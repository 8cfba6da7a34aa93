"""Multipliers to start from: those of an earlier solution, carried over to another mesh, rule or problem.

On a Galerkin step the multipliers of the rows e_0 … e_d are the values of a polynomial costate μ(t) at the control
points, so they are interpolated like the path. Multipliers of bounds are densities times h b_i.
"""

from __future__ import annotations

import numpy as np

from varint.control.leg import Leg
from varint.control.piecewise import Piecewise
from varint.control.problem import Problem
from varint.control.solution import ControlSolution
from varint.trajectory import Trajectory


def start_multipliers(problem: Problem) -> tuple[np.ndarray, np.ndarray] | None:
    """(lam_x, lam_g) where every phase starts from an earlier solution, else None."""
    guesses = [one.phase.guess for one in problem.legs]
    if not all(isinstance(g, Trajectory) and isinstance(g.solution, ControlSolution) for g in guesses):
        return None
    first = guesses[0].solution
    if all(_same(one, g.solution) for one, g in zip(problem.legs, guesses, strict=True)) and _same_size(problem, first):
        return first.outcome.lam_x, first.outcome.lam_g
    lam_x, lam_g = np.zeros(problem.unknowns), np.zeros(len(problem.g_low))
    for one, guess in zip(problem.legs, guesses, strict=True):
        _carry(lam_x, lam_g, one, guess.solution)
    return lam_x, lam_g


def _same_size(problem: Problem, found: ControlSolution) -> bool:
    return len(found.outcome.lam_x) == problem.unknowns and len(found.outcome.lam_g) == len(problem.g_low)


def _same(one: Leg, found: ControlSolution) -> bool:
    return one.phase.rule == found.phase.rule and np.array_equal(one.phase.mesh, found.mesh)


def _carry(lam_x: np.ndarray, lam_g: np.ndarray, one: Leg, found: ControlSolution) -> None:
    phase, rows, slots, mesh = one.phase, one.rows, one.slots, one.phase.mesh
    steps, points = np.diff(mesh), np.array(phase.rule.points)
    if found.costate.values.shape[2] != phase.system.structure.n:
        return
    lam_g[rows.momentum] = found.costate(mesh)
    inside = (mesh[:-1, None] + steps[:, None] * points[1:-1]).ravel()
    lam_g[rows.inner] = found.costate(inside).reshape(rows.inner.shape)
    source = next(leg for leg in found.problem.legs if leg.phase is found.phase)
    new, old = slots.u, source.slots.u
    if not new.size or old.shape[2] != new.shape[2]:
        return
    density = found.outcome.lam_x[old] / (np.diff(found.mesh)[:, None, None] * _weights(source)[:, None])
    level = Piecewise(found.mesh, np.array([0.5]), density.mean(axis=1, keepdims=True))
    at = np.array(phase.rule.nodes) if phase.samples > 1 else np.array([0.5])
    places = (mesh[:-1, None] + steps[:, None] * at).ravel()
    lam_x[new] = level(places).reshape(new.shape) * steps[:, None, None] * _weights(one)[:, None]


def _weights(one: Leg) -> np.ndarray:
    return np.array(one.phase.rule.weights) if one.phase.samples > 1 else np.ones(1)

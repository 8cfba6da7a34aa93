"""A rough solution near a path whose velocities are unknowns of their own.

At the middles of the steps, q̄ and v̄ the means of both ends (the midpoint rule for v̇ = a(q, v, u)),

    q_{k+1} − q_k = h v̄,    v_{k+1} − v_k = h a(q̄, v̄, u_k).

Until they are met, Newton's steps need not keep v = q̇, so that a path that breaks the equations of
motion grossly is led to a motion that keeps them where the discrete Euler–Lagrange equations, of
second order in q alone, lead away (lifted Newton method: Albersmeyer & Diehl 2010).

It is solved on half of the steps, at a price on bends if the path breaks the equations of motion
more than the straight line does; then on twice as many as are asked for, without a price; where
that fails first on all of them, and where that fails too all over without the price. Coarse meshes
forgive a wild path, and in a smooth motion a finer mesh has little to mend. Where neither half of
the steps nor all of them lead to a motion in many iterations, no motion is near the path.

The price, beside a cost of order one, is

    S = κ Σ_i ∫_0^1 (d²q_i/ds² / L_i)² ds,    s = t / T,  L_i the extent of the path in q_i,

the same in whatever units and for whatever duration.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from varint.control.coarse import RoughStart
from varint.control.guess import Guess, build_start, hermite, read_guess, write_guess
from varint.control.lifted_program import (
    Places,
    build_lifted_start,
    build_places,
    build_program,
    rows_of_motion,
)
from varint.control.phase import CheckedPhase
from varint.control.piecewise import Piecewise
from varint.control.problem import ControlProblem
from varint.control.scaling import choose_scales
from varint.nlp.arrangement import natural_scales, plain_order
from varint.nlp.program import NonlinearProgram
from varint.nlp.solver import build_solver

# a motion whose cost no longer changes much is good enough for a finer mesh, however far its
# multipliers are from theirs
UNSETTLED = {
    "acceptable_tol": 1e10,
    "acceptable_dual_inf_tol": 1e10,
    "acceptable_compl_inf_tol": 1e10,
}
ROUGH = UNSETTLED | {
    "tol": 1e-4,
    "constr_viol_tol": 1e-5,
    "max_iter": 120,
    "acceptable_constr_viol_tol": 1e-3,
    "acceptable_obj_change_tol": 0.1,
    "acceptable_iter": 1,
}
# near a solution on a coarser mesh: a barrier that falls no sooner than its own problem is solved
# does not crawl along bounds through a flat valley
FINER = ROUGH | {
    "mu_init": 1e-2,
    "barrier_tol_factor": 0.3,
    "max_iter": 100,
    "acceptable_constr_viol_tol": 1e-4,
    "acceptable_obj_change_tol": 1e-2,
    "acceptable_iter": 2,
}
FIRST = 0.5, 1.0  # steps of the first rough solution, of those asked for: the one that succeeds
FINEST = 2.0  # the same of the last one; of rules with no more nodes than the midpoint rule 1
IN_VAIN = 120  # iterations after which half of the steps and all of them have led to nothing
SMOOTH = 0.1  # κ, the price of bends on the first mesh
STILL = 1e-9  # of the largest extent: coordinates that move less do not move
ALMOST = 1e-4  # a path that breaks rows by less is as good a start as a solution


def can_be_lifted(problem: ControlProblem) -> bool:
    """One motion, of mechanics alone: no constraints, states, slacks, rates, integrals, links."""
    phase, s = problem.phases[0].phase, problem.phases[0].phase.system.structure
    extras = (
        s.velocity_rows,
        s.degenerate,
        problem.links,
        len(problem.phases) > 1,
        len(phase.states.index),
        phase.slacks.symbols.numel(),
        phase.end_slacks.symbols.numel(),
        len(phase.rates.index),
        phase.integrals.rows.numel(),
        phase.end.periodic is not None,
    )
    return not any(extras) and bool(s.controls) and phase.steps > 1


class Rough(NamedTuple):
    """A rough solution, None where there is none, its iterations, whether it was stopped."""

    guess: Guess | None
    iterations: int
    stopped: bool


def lifted_start(problem: ControlProblem, progress: bool | None = False) -> RoughStart:
    """A start from rough solutions on finer and finer meshes."""
    if not can_be_lifted(problem):
        return RoughStart(None, 0)
    part = problem.phases[0]
    drawn = read_guess(part.phase, part.t0)
    rough, total, best = Rough(None, 0, False), 0, None
    prices = (price_of_bends(problem, drawn),) if _is_wild(problem, drawn) else ()
    for price in (*prices, None):
        rough, finest = _on_finer_meshes(problem, drawn, price, progress)
        total += rough.iterations
        best = rough.guess or best
        if finest or rough.stopped or (best is None and total > IN_VAIN):
            break
    if best is None:
        return RoughStart(None, total)
    start = np.zeros(problem.unknowns)
    write_guess(start, part, best)
    if not np.isfinite(start).all():
        return RoughStart(None, total)
    return RoughStart(np.clip(start, problem.nlp.x_low, problem.nlp.x_high), total, rough.stopped)


def _on_finer_meshes(
    problem: ControlProblem, drawn: Guess, price: np.ndarray | None, progress: bool | None
) -> tuple[Rough, bool]:
    """The rough solution on the finest mesh that was reached, with all iterations; whether that is
    the finest of all.
    """
    total, finest = 0, min(FINEST, problem.phases[0].phase.rule.degree)
    for reached in FIRST:
        rough = _solved(problem, drawn, reached, ROUGH, progress, price)
        total += rough.iterations
        if rough.guess is not None:
            break
    for way in ((finest,), (1.0, finest)):  # at once, or by all of the steps
        for ratio in way:
            if rough.guess is None or rough.stopped or ratio <= reached:
                continue
            finer = _solved(problem, rough.guess, ratio, FINER, progress)
            total += finer.iterations
            if finer.guess is None:
                break
            rough, reached = finer, ratio
    return rough._replace(iterations=total), rough.guess is not None and reached >= finest


def _solved(
    problem: ControlProblem,
    guess: Guess,
    ratio: float,
    options: Mapping[str, float],
    progress: bool | None,
    price: np.ndarray | None = None,
) -> Rough:
    """The rough solution on so many times the steps of the mesh, bends at a price if wanted."""
    phase, t0 = problem.phases[0].phase, problem.phases[0].t0
    steps = max(round(ratio * phase.steps), 1)
    mesh = np.interp(np.linspace(0, phase.steps, steps + 1), np.arange(phase.steps + 1), phase.mesh)
    places = build_places(phase, steps)
    nlp = build_program(phase, t0, mesh, places, price)
    start = np.clip(build_lifted_start(phase, mesh, places, guess), nlp.x_low, nlp.x_high)
    order = plain_order(nlp)
    solve = build_solver(nlp, "ipopt", {"ipopt": options}, natural_scales(nlp), order)
    found = solve(start, progress=progress)
    if not (found.success or found.stopped or found.violation <= ALMOST):
        return Rough(None, found.iterations, False)
    n, x = phase.system.structure.n, found.x
    shared = np.where(places.shared >= 0, x[places.shared], [guess.duration, *guess.c])
    path = hermite(shared[0] * mesh, x[places.x[:, :n]], x[places.x[:, n:]])
    u = Piecewise(mesh, np.array([0.5]), x[places.u][:, None])
    rough = Guess(path, u, float(shared[0]), shared[1:])
    return Rough(rough, found.iterations, found.stopped)


def _is_wild(problem: ControlProblem, drawn: Guess) -> bool:
    """Does a path break the equations of motion more than the straight line does? Others are near
    the motion that is meant, whatever its bends.
    """
    phase, t0 = problem.phases[0].phase, problem.phases[0].t0
    places = build_places(phase, phase.steps)
    nlp = build_program(phase, t0, phase.mesh, places, None)
    line = read_guess(replace(phase, guess=None), t0)
    own, straight = (_misfit(phase, places, nlp, guess) for guess in (drawn, line))
    return not own <= straight


def _misfit(phase: CheckedPhase, places: Places, nlp: NonlinearProgram, guess: Guess) -> float:
    """How much a path breaks the equations of motion with the controls that suit it best, which
    act on their own step alone.
    """
    x = np.clip(build_lifted_start(phase, phase.mesh, places, guess), nlp.x_low, nlp.x_high)
    g, slopes = nlp.program.jacobian(x, nlp.p)
    rows = rows_of_motion(phase)
    off = (g.full().ravel() - nlp.g_low)[rows]
    at = np.full((len(nlp.g_low), 2), -1)  # of a row: its step, and its place there
    at[rows] = np.moveaxis(np.indices(rows.shape), 0, -1)
    acts = np.full((len(x), 2), -1)
    acts[places.u] = np.moveaxis(np.indices(places.u.shape), 0, -1)
    row, column = (np.array(k) for k in slopes.sparsity().get_triplet())
    own = (at[row, 0] >= 0) & (at[row, 0] == acts[column, 0])
    row, column, value = row[own], column[own], np.array(slopes.nonzeros())[own]
    acting = np.zeros((*off.shape, places.u.shape[1]))
    acting[at[row, 0], at[row, 1], acts[column, 1]] = value
    if not (np.isfinite(off).all() and np.isfinite(acting).all()):
        return np.inf
    best = np.linalg.pinv(acting) @ off[..., None]
    return float(np.linalg.norm(off[..., None] - acting @ best))


def price_of_bends(problem: ControlProblem, drawn: Guess) -> np.ndarray:
    """κ / L_i², in the units of the cost."""
    extent = np.ptp(drawn.q(problem.phases[0].phase.mesh), axis=0)
    extent = np.where(extent > STILL * extent.max(), extent, 1.0)
    return SMOOTH / choose_scales(problem, build_start(problem)).f / extent**2

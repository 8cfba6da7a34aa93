"""A rough solution near a path whose velocities are unknowns of their own.

At the middles of the steps, q̄ and v̄ the means of both ends (the midpoint rule for v̇ = a(q, v, u)),

    q_{k+1} − q_k = h v̄,    v_{k+1} − v_k = h a(q̄, v̄, u_k).

Until they are met, Newton's steps need not keep v = q̇, so that a path that breaks the equations of
motion grossly is led to a motion that keeps them where the discrete Euler–Lagrange equations, of
second order in q alone, lead away (lifted Newton method: Albersmeyer & Diehl 2010).

It is solved on half of the steps, and from there on twice as many as are asked for; where that
leads to no motion, first on all of them. Coarse meshes forgive a wild path, and in a smooth motion
a finer mesh has little to mend.

A path is wild if it breaks the equations of motion more than the straight line does. Bends of its
first rough solution have a price, beside a cost of order one,

    S = κ Σ_i ∫_0^1 (d²q_i/ds² / L_i)² ds,    s = t / T,  L_i the extent of the path in q_i,

the same in whatever units and for whatever duration; and there is aid, accelerations z_i L_i/T² of
all coordinates, whatever can push them in truth, at a price

    A = α Σ_i ∫_0^1 z_i² ds,

with which every path is a motion (an elastic mode: Nocedal & Wright, Numerical Optimization,
§18.5). It is cheap at first, and bends are dear: a nonlinear least-squares problem for the
Gauss–Newton method. Then it is so dear that the controls do nearly all of it, and the finer mesh
has none. Other paths are near the motion that is meant, and where the duration is unknown it
multiplies the aid, so that there is little to gain by least squares: both are tried without aid
first.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np

from varint.control.coarse import RoughStart
from varint.control.guess import Guess, build_start, hermite, read_guess, write_guess
from varint.control.lifted_program import (
    Places,
    Prices,
    build_lifted_start,
    build_places,
    build_program,
    give_aid,
    rows_of_motion,
    without_curvature,
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
# of a wild path without aid: what is found there is found soon
WILD = ROUGH | {"max_iter": 35}
# aid makes up for rows that are off; the next mesh has none
AIDED = ROUGH | {
    "max_iter": 25,
    "acceptable_constr_viol_tol": 0.1,
    "acceptable_obj_change_tol": 0.03,
}
FIRST, ALL = 0.5, 1.0  # steps of the first meshes, of those asked for
FINEST = 2.0  # the same of the last one; of rules with no more nodes than the midpoint rule 1
SMOOTH = 0.1  # κ, the price of bends on the first mesh
CHEAP, DEAR = (1.0, 0.1), (SMOOTH, 100.0)  # κ and α, with aid
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
    drawn, degree = read_guess(part.phase, part.t0), part.phase.rule.degree
    wild, total = _is_wild(problem, drawn), 0
    options, prices = (WILD, prices_of(problem, drawn, SMOOTH)) if wild else (ROUGH, None)

    def by_aid() -> Rough:
        cheap, dear = (prices_of(problem, drawn, *y) for y in (CHEAP, DEAR))
        first = _solved(problem, drawn, FIRST, AIDED, progress, cheap, straight=True)
        if first.guess is None or first.stopped:
            return first
        return _after(first, _solved(problem, first.guess, FIRST, AIDED, progress, dear))

    def alone(ratio: float) -> Rough:
        return _solved(problem, drawn, ratio, options, progress, prices)

    ways: list[Callable[[], Rough]] = [partial(alone, FIRST), by_aid, partial(alone, ALL)]
    if wild and not part.phase.free_duration:
        ways[:2] = ways[1::-1]
    for way in ways:
        rough = way()
        if rough.guess is not None and not rough.stopped:
            finest = min(FINEST, degree)
            rough = _after(rough, _solved(problem, rough.guess, finest, FINER, progress))
        total += rough.iterations
        if rough.guess is not None:
            break
    if rough.guess is None:
        return RoughStart(None, total)
    start = np.zeros(problem.unknowns)
    write_guess(start, part, rough.guess)
    if not np.isfinite(start).all():
        return RoughStart(None, total)
    return RoughStart(np.clip(start, problem.nlp.x_low, problem.nlp.x_high), total, rough.stopped)


def _after(first: Rough, then: Rough) -> Rough:
    """What was found then, with the iterations of both."""
    return then._replace(iterations=first.iterations + then.iterations)


def _solved(
    problem: ControlProblem,
    guess: Guess,
    ratio: float,
    options: Mapping[str, float],
    progress: bool | None,
    prices: Prices | None = None,
    straight: bool = False,
) -> Rough:
    """The rough solution on so many times the steps of the mesh, at prices if wanted; by the
    Gauss–Newton method, or with the curvature of the equations of motion.
    """
    phase, t0 = problem.phases[0].phase, problem.phases[0].t0
    steps = max(round(ratio * phase.steps), 1)
    mesh = np.interp(np.linspace(0, phase.steps, steps + 1), np.arange(phase.steps + 1), phase.mesh)
    places = build_places(phase, steps, prices)
    nlp = build_program(phase, t0, mesh, places, prices)
    start = np.clip(build_lifted_start(phase, mesh, places, guess), nlp.x_low, nlp.x_high)
    if prices is not None and places.aid.size:
        start = give_aid(phase, mesh, places, prices, nlp, start)
    if straight:
        nlp = without_curvature(nlp, rows_of_motion(phase, steps))
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
    rows = rows_of_motion(phase, phase.steps)
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


def prices_of(problem: ControlProblem, drawn: Guess, bends: float, aid: float = 0.0) -> Prices:
    """Prices beside a cost of order one, in the units of the cost."""
    extent = np.ptp(drawn.q(problem.phases[0].phase.mesh), axis=0)
    extent = np.where(extent > STILL * extent.max(), extent, 1.0)
    unit = choose_scales(problem, build_start(problem)).f
    return Prices(bends / unit, aid / unit, extent)

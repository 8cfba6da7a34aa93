"""A rough solution near a path whose velocities are unknowns of their own.

At the middles of the steps, q̄ and v̄ the means of both ends (the midpoint rule for v̇ = a(q, v, u)),

    q_{k+1} − q_k = h v̄,    v_{k+1} − v_k = h a(q̄, v̄, u_k).

Until they are met, Newton's steps need not keep v = q̇, so that a path that breaks the equations of
motion grossly is led to a motion that keeps them where the discrete Euler–Lagrange equations, of
second order in q alone, lead away (lifted Newton method: Albersmeyer & Diehl 2010).

It is solved on half of the steps, then on all of them and on twice as many, each from the one
before: coarse meshes forgive a wild path, and what they make up where they are too coarse is
mended while an iteration is still cheap.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import casadi as ca
import numpy as np

from varint.control.coarse import RoughStart
from varint.control.guess import Guess, hermite, read_guess, write_guess
from varint.control.inverse_dynamics import rest_controls
from varint.control.phase import CheckedPhase
from varint.control.piecewise import Piecewise
from varint.control.problem import ControlProblem
from varint.discrete.legendre import mass_solve
from varint.nlp.arrangement import natural_scales, plain_order
from varint.nlp.assembly import Element, assemble
from varint.nlp.program import NonlinearProgram
from varint.nlp.solver import build_solver

ROUGH = {"tol": 1e-4, "acceptable_tol": 1e-2, "constr_viol_tol": 1e-5, "max_iter": 200}
# near a solution on a coarser mesh: a barrier that falls no sooner than its own problem is solved
# does not crawl along bounds through a flat valley
FINER = ROUGH | {
    "acceptable_tol": 1e-4,
    "mu_init": 1e-2,
    "barrier_tol_factor": 0.3,
    "max_iter": 100,
}
FIRST = 0.5, 1.0  # steps of the first rough solution, of those asked for: the one that succeeds
FINEST = 2.0  # the same of the last one; of rules with no more nodes than the midpoint rule 1
ALMOST = 1e-4  # a path that breaks rows by less is as good a start as a solution
MIDDLE = np.array([0.5])


@dataclass(frozen=True, eq=False)
class Places:
    """Where the unknowns sit: (q, v) at the nodes (N + 1, 2n), controls (N, k), and duration and
    parameters, −1 where they are fixed.
    """

    x: np.ndarray
    u: np.ndarray
    shared: np.ndarray

    @property
    def end(self) -> int:
        """Number of unknowns."""
        return max(int(y.max(initial=-1)) for y in (self.x, self.u, self.shared)) + 1


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
    part, total = problem.phases[0], 0
    drawn = read_guess(part.phase, part.t0)
    for ratio in FIRST:
        rough = _solved(problem, drawn, ratio, ROUGH, progress)
        total += rough.iterations
        if rough.guess is not None:
            break
    while rough.guess is not None and ratio < min(FINEST, part.phase.rule.degree):
        if rough.stopped:
            break
        ratio *= 2
        finer = _solved(problem, rough.guess, ratio, FINER, progress)
        total += finer.iterations
        if finer.guess is None:
            break
        rough = finer
    if rough.guess is None:
        return RoughStart(None, total)
    start = np.zeros(problem.unknowns)
    write_guess(start, part, rough.guess)
    if not np.isfinite(start).all():
        return RoughStart(None, total)
    return RoughStart(np.clip(start, problem.nlp.x_low, problem.nlp.x_high), total, rough.stopped)


def _solved(
    problem: ControlProblem,
    guess: Guess,
    ratio: float,
    options: Mapping[str, float],
    progress: bool | None,
) -> Rough:
    """The rough solution on so many times the steps of the mesh."""
    phase, t0 = problem.phases[0].phase, problem.phases[0].t0
    steps = max(round(ratio * phase.steps), 1)
    mesh = np.interp(np.linspace(0, phase.steps, steps + 1), np.arange(phase.steps + 1), phase.mesh)
    places = _places(phase, steps)
    nlp = _program(phase, t0, mesh, places)
    start = np.clip(_start(phase, mesh, places, guess), nlp.x_low, nlp.x_high)
    order = plain_order(nlp)
    solve = build_solver(nlp, "ipopt", {"ipopt": options}, natural_scales(nlp), order)
    found = solve(start, progress=progress)
    if not (found.success or found.stopped or found.violation <= ALMOST):
        return Rough(None, found.iterations, False)
    n, x = phase.system.structure.n, found.x
    shared = np.where(places.shared >= 0, x[places.shared], [guess.duration, *guess.c])
    path = hermite(shared[0] * mesh, x[places.x[:, :n]], x[places.x[:, n:]])
    u = Piecewise(mesh, MIDDLE, x[places.u][:, None])
    rough = Guess(path, u, float(shared[0]), shared[1:])
    return Rough(rough, found.iterations, found.stopped)


def _places(phase: CheckedPhase, steps: int) -> Places:
    s = phase.system.structure
    stride = 2 * s.n + s.controls
    first = stride * np.arange(steps + 1)[:, None]
    x, u = first + np.arange(2 * s.n), first[:-1] + np.arange(2 * s.n, stride)
    free = np.append(phase.free_duration, phase.c_low < phase.c_high)
    shared = np.where(free, x.max() + np.cumsum(free), -1)
    return Places(x, u, shared)


def _program(phase: CheckedPhase, t0: float, mesh: np.ndarray, places: Places) -> NonlinearProgram:
    s, bounds, steps = phase.system, phase.bounds, len(mesh) - 1
    n, nodes, points = s.structure.n, bounds.at_nodes.numel(), bounds.at_points.numel()
    count = 2 * n + nodes + points
    first, last = phase.start.rows.numel(), phase.end.rows.numel()
    end = steps * count
    of_steps = np.arange(end).reshape(steps, count)
    of_ends = end + np.arange(first)[None], end + first + np.arange(last)[None]
    elements = [
        _interval(phase, t0, mesh, places, of_steps),
        _end(phase, t0, places, of_ends[0], False),
        _end(phase, t0, places, of_ends[1], True),
    ]
    wide = np.full(places.end, np.inf)
    x_low, x_high = -wide, wide
    sides = ((x_low, 0, phase.c_low, 1), (x_high, 1, phase.c_high, 2))
    for bound, side, c, place in sides:
        bound[places.x[:, :n]] = bounds.q[side]
        bound[places.u] = bounds.u[side]
        free = places.shared >= 0
        bound[places.shared[free]] = np.append(phase.duration[place], c)[free]
    for end_of, at in ((phase.start, places.x[0]), (phase.end, places.x[-1])):
        given = np.concatenate([end_of.q, end_of.v], axis=1)
        x_low[at] = np.maximum(x_low[at], given[1])
        x_high[at] = np.minimum(x_high[at], given[2])
    still = np.zeros(2 * n)
    low, high = (
        np.concatenate([np.tile(np.concatenate([still, *along]), steps), *ends])
        for along, ends in (
            ((bounds.nodes_low, bounds.points_low), (phase.start.low, phase.end.low)),
            ((bounds.nodes_high, bounds.points_high), (phase.start.high, phase.end.high)),
        )
    )
    program = assemble(elements, places.end, 2 * steps, len(low))
    data = np.concatenate([mesh[:-1], np.diff(mesh)])
    return NonlinearProgram(program, data, x_low, x_high, low, high)


def _shared(phase: CheckedPhase, places: Places) -> tuple[ca.SX, ca.SX, ca.SX]:
    """Duration and parameters, numbers where they are fixed; and the symbols of those that are
    not.
    """
    free = np.flatnonzero(places.shared >= 0)
    symbols, known = ca.SX.sym("shared", len(free)), np.append(phase.duration[0], phase.c)
    values = ca.SX(ca.DM(known))
    values[free.tolist()] = symbols
    return values[0], values[1:], symbols


def _interval(
    phase: CheckedPhase, t0: float, mesh: np.ndarray, places: Places, rows: np.ndarray
) -> Element:
    s, n, steps = phase.system, phase.system.structure.n, len(mesh) - 1
    duration, c, free = _shared(phase, places)
    x0, x1 = ca.SX.sym("x0", 2 * n), ca.SX.sym("x1", 2 * n)
    u, w = ca.SX.sym("u", s.structure.controls), ca.SX.sym("w", 2)
    push = ca.gradient(s.lagrangian, s.q) + s.force
    push -= ca.jtimes(s.momentum, s.q, s.v) + ca.jacobian(s.momentum, s.t)
    rates = phase.rates.symbols
    along = ca.Function(
        "along",
        [s.q, s.v, s.control, s.t, s.c, rates],
        [
            mass_solve(s.mass_matrix, push),
            phase.cost,
            phase.bounds.at_nodes,
            phase.bounds.at_points,
        ],
    )
    h, middle = duration * w[1], (x0 + x1) / 2
    t = t0 + duration * (w[0] + w[1] / 2)
    a, cost, nodes, points = along(middle[:n], middle[n:], u, t, c, ca.SX.zeros(rates.shape))
    motion = x1 - x0 - h * ca.vertcat(middle[n:], a)
    k = np.arange(steps)
    return Element(
        ca.vertcat(x0, u, x1, free),
        w,
        h * cost,
        ca.vertcat(motion, nodes, points),
        np.hstack([places.x[:-1], places.u, places.x[1:], _many(places, steps)]),
        np.stack([k, steps + k], axis=1),
        rows,
    )


def _end(phase: CheckedPhase, t0: float, places: Places, rows: np.ndarray, last: bool) -> Element:
    s, end = phase.system, phase.end if last else phase.start
    duration, c, free = _shared(phase, places)
    x, n = ca.SX.sym("x", 2 * s.structure.n), s.structure.n
    terminal = phase.terminal if last else ca.SX(0)
    at = ca.Function("at", [s.q, s.v, s.t, s.c], [terminal, ca.densify(end.rows)])
    cost, held = at(x[:n], x[n:], t0 + duration * last, c)
    where = np.hstack([places.x[-1 if last else 0][None], _many(places, 1)])
    return Element(
        ca.vertcat(x, free), ca.SX(0, 1), cost, held, where, np.zeros((1, 0), dtype=int), rows
    )


def _many(places: Places, copies: int) -> np.ndarray:
    return np.tile(places.shared[places.shared >= 0], (copies, 1))


def _start(phase: CheckedPhase, mesh: np.ndarray, places: Places, guess: Guess) -> np.ndarray:
    """The path, its velocities, and the guess's controls or none: those of inverse dynamics follow
    every kink of a path.
    """
    x = np.zeros(places.end)
    fine = np.sort(np.concatenate([mesh, (mesh[:-1] + mesh[1:]) / 2]))
    q = guess.q(fine)
    v = np.gradient(q, guess.duration * fine, axis=0)
    x[places.x] = np.hstack([q, v])[::2]
    middles = (mesh[:-1] + mesh[1:]) / 2
    x[places.u] = rest_controls(phase) if guess.u is None else guess.u(middles)
    free = places.shared >= 0
    x[places.shared[free]] = np.append(guess.duration, guess.c)[free]
    return x

"""Paths of least action under inequalities, by Ipopt with exact derivatives.

The action is minimised over all control points. A path that meets an obstacle leans on it: there the momentum changes
by more than the equations of motion allow, and the multiplier of the bound says by how much.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from decimal import Decimal
from time import perf_counter
from typing import Any

import casadi as ca
import numpy as np

from varint.arrays import over_columns
from varint.assembly import Element, assembled
from varint.boundary.result import ends_function, interval_data, trajectory
from varint.boundary.stationary import Iterate, Problem, iterate_through, point_times
from varint.control.bounds import PathBounds, path_bounds
from varint.control.nlp import WORDS, solver
from varint.control.problem import Problem as Programme
from varint.discrete import interval
from varint.errors import InputError, SolverError
from varint.polynomials import interpolatory_weights
from varint.trajectory import Trajectory

VIOLATION = 1e-8  # of a bound or row in its own unit: Ipopt was asked for less
TOUCH = 1e-6  # of the largest multiplier: smaller ones are what the interior point method leaves everywhere


@dataclass(frozen=True, eq=False)
class Contacts:
    """Where a path of least action leans on its bounds.

    Attributes
    ----------
    bounds : tuple of str
        The bounded expressions.
    t : ndarray (K,)
        Times of all control points.
    values, multipliers : ndarray (K, b)
        Value of each expression, and how fast the least action grows with its bound, per unit of time and bound:
        positive where the path leans on the lower bound, negative on the upper one.
    status : str
        Ipopt's word for how it ended.
    """

    bounds: tuple[str, ...]
    t: np.ndarray
    values: np.ndarray
    multipliers: np.ndarray
    status: str

    @property
    def touches(self) -> np.ndarray:
        """Which control points lean on a bound, (K, b)."""
        size = np.abs(self.multipliers)
        return size > TOUCH * max(size.max(initial=0.0), np.finfo(float).tiny)


def minimised(
    problem: Problem,
    iterate: Iterate,
    window: tuple[float, float],
    bounds: Sequence[tuple[Any, Any, Any]],
    began: float,
) -> Trajectory:
    """The path of least action near `iterate` within bounds."""
    if problem.system.structure.forced:
        raise InputError("with forces no action is least: bounds need a scene without forces")
    if not problem.rule.points:
        raise InputError(f"{problem.rule} has no paths between its nodes to bound; use gauss(s) or lobatto(s)")
    held = path_bounds(problem.system, bounds)
    if held.at_nodes.numel():
        raise InputError("bounds of paths may depend on q, t and the parameters, not on velocities or controls")
    programme = _programme(problem, iterate, window, held)
    free = problem.energy is not None
    first = np.concatenate([iterate.points.ravel(), [iterate.duration] * free])
    start = np.clip(first, programme.x_low, programme.x_high)
    outcome = solver(programme, start)(start)
    found = _iterate(problem, iterate, outcome)
    stats = {
        "plan": f"{problem.rule}: least action by Ipopt, {programme.unknowns} unknowns",
        "steps": problem.steps, "status": outcome.status, "iterations": len(outcome.history.get("cost", ())) - 1,
        "residual": outcome.violation, "seconds": perf_counter() - began,
    }  # fmt: skip
    path = trajectory(problem, found, stats, _contacts(problem, found, held, outcome))
    actions = over_columns(ends_function(problem.system, problem.rule), *interval_data(problem, found))[2]
    path.__dict__["action"] = float(actions.sum())  # stepping from node to node would not know of the contacts
    if not outcome.success or not outcome.violation <= VIOLATION:
        words = WORDS.get(outcome.status, "the least action was not found; try another guess")
        raise SolverError(f"Ipopt ended with {outcome.status}: {words}", status=outcome.status, iterate=path)
    return path


def _programme(problem: Problem, iterate: Iterate, window: tuple[float, float], held: PathBounds) -> Programme:
    """min S_d (+ E T) over the control points, and the duration where it is free, within bounds."""
    began = perf_counter()
    steps, (_, d, n) = problem.steps, iterate.increments.shape
    m, count, free = problem.system.structure.constraints, steps * d + 1, problem.energy is not None
    fixed, kinds = problem.closure is None, held.at_points.numel()
    inner = np.arange(fixed, count - fixed)
    parts = [np.append(((np.arange(steps)[:, None] + point_times(problem.rule)[:-1]) / steps).ravel(), 1.0)[:, None]]
    parts += [problem.u, np.arange(steps, dtype=float)[:, None], problem.c]
    parts += [np.array([1 / steps, problem.t0, problem.energy or 0.0, iterate.duration])[: 3 if free else 4]]
    places = np.split(np.arange(sum(x.size for x in parts)), np.cumsum([x.size for x in parts])[:-1])
    part, u, k, c, clock = (place.reshape(x.shape) for place, x in zip(places, parts, strict=True))
    unknowns, duration = count * n + free, np.full(int(free), count * n)

    points = np.arange(steps)[:, None] * d * n + np.arange((d + 1) * n)
    gaps = np.arange(steps)[:, None] * d * m + np.arange((d + 1) * m)
    gaps[(gaps >= (count - 1) * m) | (gaps < fixed * m)] = -1  # of fixed ends, and of the end of a closed path
    change, data, cost, rows = _interval_of_programme(problem, free)
    variables, constants = _beside(steps, points, duration), _beside(steps, u, c, k, clock)
    elements = [Element(change, data, cost, rows, variables, constants, gaps)]
    rows_low, rows_high = [np.zeros(count * m)], [np.zeros(count * m)]
    if kinds:
        change, data, rows = _bounded_point(problem, held, free)
        variables = _beside(len(inner), inner[:, None] * n + np.arange(n), duration)
        at = count * m + np.arange(len(inner) * kinds).reshape(len(inner), kinds)
        constants = _beside(len(inner), c, part[inner], clock)
        elements.append(Element(change, data, ca.SX(0), rows, variables, constants, at))
        rows_low.append(np.tile(held.points_low, len(inner)))
        rows_high.append(np.tile(held.points_high, len(inner)))
    x_low, x_high = (np.tile(side, (count, 1)) for side in held.q)
    if problem.closure is None:
        _ends_allowed(problem, held, iterate.points)
        x_low[[0, -1]] = x_high[[0, -1]] = iterate.points[[0, -1]]
    else:
        start, end, turn = ca.SX.sym("q0", n), ca.SX.sym("q1", n), ca.DM(problem.closure)
        ends = np.append(np.arange(n), (count - 1) * n + np.arange(n))[None]
        row = end - ca.mtimes(turn[:, :n], start) - turn[:, n]
        at = sum(x.size for x in rows_low) + np.arange(n)[None]
        none = np.empty((1, 0), dtype=int)
        elements.append(Element(ca.vertcat(start, end), ca.SX(0, 1), ca.SX(0), row, ends, none, at))
        rows_low.append(np.zeros(n))
        rows_high.append(np.zeros(n))
    g_low, g_high = np.concatenate(rows_low), np.concatenate(rows_high)
    return Programme(
        legs=[],
        links=[],
        program=assembled(elements, unknowns, sum(x.size for x in parts), g_low.size),
        p=np.concatenate([x.ravel() for x in parts]),
        x_low=np.append(x_low.ravel(), [window[0]] * free),
        x_high=np.append(x_high.ravel(), [window[1]] * free),
        g_low=g_low,
        g_high=g_high,
        seconds=perf_counter() - began,
    )


def _beside(copies: int, *indices: np.ndarray) -> np.ndarray:
    """Index arrays side by side; one that is the same for all copies is repeated."""
    return np.hstack([np.broadcast_to(x, (copies, x.shape[-1])) for x in indices])


def _clock(problem: Problem, free: bool) -> tuple[ca.SX, ca.SX, ca.SX, ca.SX, ca.SX, ca.SX]:
    """(unknown part, data, T, 1/N, t0, E)."""
    share, t0, energy, duration = (ca.SX.sym(name) for name in ("share", "t0", "E", "T"))
    data = ca.vertcat(share, t0, energy) if free else ca.vertcat(share, t0, energy, duration)
    return duration if free else ca.SX(0, 1), data, duration, share, t0, energy


def _interval_of_programme(problem: Problem, free: bool) -> tuple[ca.SX, ca.SX, ca.SX, ca.SX]:
    """(unknowns, data, share of the action, weighted constraints) of one interval."""
    one = interval(problem.system, problem.rule)
    n, d = one.dq.shape
    m = one.lam.shape[0]
    points, k = ca.SX.sym("Q", n, d + 1), ca.SX.sym("k")
    unknown, clock, duration, share, t0, energy = _clock(problem, free)
    h = duration * share
    own = [one.q0, one.dq, one.lam, one.u, one.t, one.h, one.c]
    wanted = [one.action, ca.gradient(one.action, ca.vec(one.lam))]
    given = [
        points[:, 0], points[:, 1:] - ca.repmat(points[:, 0], 1, d), ca.SX.zeros(m, d + 1), one.u, t0 + k * h, h, one.c,
    ]  # fmt: skip
    action, gaps = ca.Function("interval", own, wanted, {"cse": True})(*given)
    data = ca.vertcat(ca.vec(one.u), one.c, k, clock)
    return ca.vertcat(ca.vec(points), unknown), data, action + energy * h, ca.densify(ca.vec(gaps))


def _bounded_point(problem: Problem, held: PathBounds, free: bool) -> tuple[ca.SX, ca.SX, ca.SX]:
    """(unknowns, data, bounded expressions) at one control point."""
    s = problem.system
    unknown, clock, duration, _, t0, _ = _clock(problem, free)
    part = ca.SX.sym("part")
    rows = ca.substitute(held.at_points, s.t, t0 + part * duration)
    return ca.vertcat(s.q, unknown), ca.vertcat(s.c, part, clock), rows


def _ends_allowed(problem: Problem, held: PathBounds, points: np.ndarray) -> None:
    """The given ends lie within the bounds."""
    s = problem.system
    values = ca.Function("values", [s.q, s.t, s.c], [held.at_points])
    for name, q, t in (("q_start", points[0], problem.t0), ("q_end", points[-1], problem.t0)):
        outside = [str(s.q[i]) for i in np.flatnonzero((q < held.q[0]) | (q > held.q[1]))]
        if not ca.depends_on(held.at_points, s.t) and held.at_points.numel():
            x = np.array(values(q, t, problem.c)).ravel()
            off = np.flatnonzero((x < held.points_low - VIOLATION) | (x > held.points_high + VIOLATION))
            outside += [str(held.at_points[int(i)]) for i in off]
        if outside:
            raise InputError(f"{name} = {q} violates the bounds on {outside}; move the end or loosen the bounds")


def _iterate(problem: Problem, first: Iterate, outcome) -> Iterate:
    """The solver's point as an iterate with multipliers."""
    _, d, n = first.increments.shape
    count, m = problem.steps * d + 1, problem.system.structure.constraints
    duration = float(outcome.x[-1]) if problem.energy is not None else first.duration
    found = iterate_through(outcome.x[: count * n].reshape(count, n), d, m, duration)
    found.multipliers[:] = outcome.lam_g[: count * m].reshape(count, m)
    return found


def _contacts(problem: Problem, found: Iterate, held: PathBounds, outcome) -> Contacts:
    """Multipliers of the bounds per unit of time."""
    s = problem.system
    steps, d, n = found.increments.shape
    count, m, h = steps * d + 1, s.structure.constraints, found.duration / steps
    tau = point_times(problem.rule)
    share = interpolatory_weights([Decimal(x) for x in problem.rule.points])
    weights = np.zeros(count)
    for k in range(d + 1):
        weights[k : k + (steps - 1) * d + 1 : d] += h * share[k]
    t = problem.t0 + found.duration * np.append(((np.arange(steps)[:, None] + tau[:-1]) / steps).ravel(), 1.0)
    simple = np.flatnonzero(np.isfinite(held.q).any(axis=0))
    kinds = held.at_points.numel()
    lam = np.zeros((count, len(simple) + kinds))
    lam_x = outcome.lam_x[: count * n].reshape(count, n)
    inner = slice(1, count - 1) if problem.closure is None else slice(0, count)
    lam[inner, : len(simple)] = lam_x[inner][:, simple]
    copies = count - 2 if problem.closure is None else count
    lam[inner, len(simple) :] = outcome.lam_g[count * m : count * m + copies * kinds].reshape(copies, kinds)
    expressions = ca.vertcat(*(s.q[int(i)] for i in simple), held.at_points)
    values = ca.Function("values", [s.q, s.t, s.c], [expressions])
    names = tuple(str(x) for x in ca.vertsplit(expressions))
    found_values = over_columns(values, found.points, t[:, None], problem.c)[0]
    return Contacts(names, t, found_values, -lam / weights[:, None], outcome.status)

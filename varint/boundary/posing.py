"""From what the user wrote to a well-posed boundary value problem and a first path, or a clear refusal."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import casadi as ca
import numpy as np

from varint.arrays import over_columns
from varint.boundary.stationary import Iterate, Problem, iterate_through, point_times
from varint.discrete import constraint_function, interval, point_function
from varint.errors import InputError, converted
from varint.grid import affordable, checked_steps
from varint.horizon import Free, window
from varint.parameters import number, whole
from varint.rules import Rule
from varint.stepping.initial import controls, vector
from varint.stepping.plan import default_rule
from varint.system import System, parameter_values, require_system
from varint.trajectory import Trajectory

ON_CONSTRAINT = 1e-9  # a longer way from the constraint, relative to the coordinates, is no round-off


def posed(
    system: System,
    rule: Rule | None,
    *,
    q_start: Any,
    q_end: Any,
    duration: float | Free | None,
    steps: int,
    t0: float,
    guess: Any,
    u: Any,
    params: Mapping[str, Any] | None,
    periodic: bool,
    symmetry: Any,
    energy: float | None,
) -> tuple[Problem, Iterate, tuple[float, float]]:
    """Problem, first iterate and bounds of the duration."""
    require_system(system)
    rule = default_rule(system) if rule is None else rule
    _suitable(system, rule)
    steps, t0 = whole("steps", steps), number("t0", t0)
    affordable(f"a path of {steps} steps", steps * len(point_times(rule)) * system.structure.n, "take fewer steps")
    if not isinstance(periodic, bool):
        raise InputError(f"periodic must be True or False, got {periodic!r}")
    n, names, c = system.structure.n, system.names, parameter_values(system, params)
    energy = None if energy is None else number("energy", energy)
    free = energy is not None or isinstance(duration, Free)
    if free and system.structure.forced:
        raise InputError("a free duration needs a scene without forces (with them no action is stationary)")
    u = controls(system, rule, u, steps)
    u = np.repeat(u, len(rule.nodes), axis=1) if u.shape[1] == 1 else u
    closure = _closure(n, symmetry) if periodic else None
    ends = None
    if periodic:
        if q_start is not None or q_end is not None:
            raise InputError("a periodic path has no end points: leave out q_start and q_end and give a guess")
        if guess is None:
            raise InputError("a periodic path needs a guess: configurations (k, n) at equally spaced times")
        nodes = _nodes(guess, n, names)
    else:
        if symmetry is not None:
            raise InputError("symmetry belongs to periodic=True")
        if q_start is None or q_end is None:
            raise InputError("give q_start and q_end, or periodic=True with a guess")
        ends = np.array([vector("q_start", q_start, n, names), vector("q_end", q_end, n, names)])
        nodes = ends if guess is None else _nodes(guess, n, names)
        nodes = (
            nodes
            + np.linspace(0, 1, len(nodes))[:, None] * (ends[1] - nodes[-1])
            + (np.linspace(1, 0, len(nodes))[:, None] * (ends[0] - nodes[0]))
        )
    tau = point_times(rule)[:-1]
    share = np.append(((np.arange(steps)[:, None] + tau) / steps).ravel(), 1.0)
    grid = np.linspace(0, 1, len(nodes))
    points = np.stack([np.interp(share, grid, x) for x in nodes.T], axis=1)
    if ends is not None:
        points[0], points[-1] = ends
    guessed, lower, upper = _duration(system, duration, energy, points, t0, c)
    checked_steps(t0, guessed / steps, steps)
    level = (energy or 0.0) if free else None
    problem = Problem(system, rule, steps, t0, u.reshape(steps, -1), c, ends, closure, level)
    if ends is not None:
        _on_constraints(problem, ends, guessed)
    _finite(problem, points, guessed)
    return problem, iterate_through(points, len(tau), system.structure.constraints, guessed), (lower, upper)


def _suitable(system: System, rule: Rule) -> None:
    s = system.structure
    if not isinstance(rule, Rule):
        raise InputError(f"rule must be a varint Rule such as gauss(2), got {rule!r}")
    if s.degenerate:
        raise InputError(
            "the Lagrangian is degenerate (∂²L/∂v² = 0): its equations are of first order and end points at both ends "
            "are too many; simulate it from its start"
        )
    if s.nonholonomic:
        raise InputError("non-holonomic constraints have no action whose paths could be found; use simulate")
    if s.contacts:
        raise InputError("a contact is an inequality: leave contact= out and give bounds=[(0, gap, numpy.inf)]")
    interval(system, rule)


def _closure(n: int, symmetry: Any) -> np.ndarray:
    """[S | b]."""
    if symmetry is None:
        return np.eye(n, n + 1)
    try:
        value = np.array(symmetry, dtype=float)
    except (TypeError, ValueError):
        raise InputError(f"symmetry must be a matrix of numbers, got {type(symmetry).__name__}") from None
    if value.shape not in ((n, n), (n, n + 1)) or not np.isfinite(value).all():
        raise InputError(f"symmetry has shape {value.shape}; it must be S ({n}, {n}) or [S | b] ({n}, {n + 1}), finite")
    return value if value.shape == (n, n + 1) else np.hstack([value, np.zeros((n, 1))])


def _nodes(guess: Any, n: int, names: tuple[str, ...]) -> np.ndarray:
    """Configurations at equally spaced times."""
    if isinstance(guess, Trajectory):
        if guess.q.shape[1] != n:
            raise InputError(f"the guess has {guess.q.shape[1]} coordinates; this system has {n}: {list(names)}")
        even = np.linspace(guess.t[0], guess.t[-1], len(guess))
        return np.stack([np.interp(even, guess.t, x) for x in guess.q.T], axis=1)
    try:
        value = np.array(guess, dtype=float)
    except (TypeError, ValueError, RuntimeError):
        raise InputError(f"guess must be an array (k, {n}) or a Trajectory, got {type(guess).__name__}") from None
    value = value[:, None] if value.ndim == 1 and n == 1 else value
    if value.ndim != 2 or value.shape[1] != n or len(value) < 2 or not np.isfinite(value).all():
        raise InputError(
            f"guess has shape {value.shape}; it must be (k, {n}) with k ≥ 2 finite configurations of {list(names)}"
        )
    return value


def _duration(
    system: System, duration: float | Free | None, energy: float | None, points: np.ndarray, t0: float, c: np.ndarray
) -> tuple[float, float, float]:
    """(guess, lower, upper) of the duration."""
    if duration is None:
        if energy is None:
            raise InputError("give the duration of the path, or its energy")
        return _time_at_energy(system, energy, points, t0, c), 0.0, np.inf
    if energy is not None and not isinstance(duration, Free):
        raise InputError("give duration or energy, not both; a guess of the duration is free(guess, lower, upper)")
    guess, lower, upper = converted(
        lambda: window(duration), lambda: f"duration must be a number or free(guess, lower, upper), got {duration!r}"
    )
    if not (np.isfinite(guess) and lower > 0):
        raise InputError(f"duration must be positive and finite (and its lower bound positive), got {duration!r}")
    return guess, lower, upper


def _time_at_energy(system: System, energy: float, points: np.ndarray, t0: float, c: np.ndarray) -> float:
    """Time that the first path takes at the given energy: ∫ √(T(q, q′) / (E − V(q))) ds over its parameter s."""
    slope = np.diff(points, axis=0) * (len(points) - 1)
    middle = (points[1:] + points[:-1]) / 2
    value = ca.Function("value", [system.q, system.v, system.t, system.c], [system.lagrangian])
    ahead, back, rest = (over_columns(value, middle, f * slope, np.array([t0]), c)[0] for f in (1.0, -1.0, 0.0))
    kinetic, left = (ahead + back) / 2 - rest, energy + rest
    if not np.isfinite(kinetic).all() or not (kinetic > 0).any() or not (left > 0).any():
        raise InputError(
            f"the energy {energy:g} is below the potential all along the first path, or that path does not move; "
            "give a guess or duration=free(guess, lower, upper)"
        )
    return float(np.sqrt(np.maximum(kinetic, 0) / np.maximum(left, 1e-3 * left.max())).mean())


def _on_constraints(problem: Problem, ends: np.ndarray, duration: float) -> None:
    """Both end points satisfy the constraints."""
    if not problem.system.structure.constraints:
        return
    for name, q, t in zip(("q_start", "q_end"), ends, (problem.t0, problem.t0 + duration), strict=True):
        g, slope = constraint_function(problem.system)(q, t, problem.c)
        off = np.abs(np.array(g).ravel())
        allowed = ON_CONSTRAINT * (np.abs(np.array(ca.densify(slope))) @ np.maximum(np.abs(q), np.abs(ends).max()))
        if not (off <= allowed).all():
            row = int(np.argmax(off - allowed))
            raise InputError(f"{name} = {q} is off the constraint: row {row} of g is {off[row]:.3g} there, not 0")


def _finite(problem: Problem, points: np.ndarray, duration: float) -> None:
    """The mechanics can be evaluated along the first path."""
    s = problem.system
    v = np.gradient(points, axis=0) * (len(points) - 1) / duration
    u = np.zeros(s.structure.controls)
    inner = slice(1, -1) if len(points) > 2 else slice(None)
    values = over_columns(point_function(s), points[inner], v[inner], u, np.array([problem.t0]), problem.c)
    if not all(np.isfinite(x).all() for x in values):
        raise InputError(
            "the Lagrangian is not finite along the first path: it passes a collision, a square root or logarithm of a "
            "negative number; give a guess that avoids it"
        )

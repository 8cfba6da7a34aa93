"""From what the user wrote to a well-posed boundary value problem and a first path, or a clear
refusal.
"""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from varint.boundary.first_way import first_way
from varint.boundary.iterate import Iterate, iterate_through, point_times
from varint.boundary.stationary import BoundaryValueProblem
from varint.boundary.winding import bent_aside
from varint.discrete.lagrangian import constraint_function, interval, point_function
from varint.errors import InputError, parsed_or_refused
from varint.integration.plan import default_rule
from varint.integration.problem import controls
from varint.numerics.arrays import over_columns
from varint.numerics.limits import check_memory, check_steps
from varint.results.trajectory import Trajectory
from varint.rules.rule import Rule
from varint.scene.free import Free, window
from varint.scene.inputs import number, positive_integer, vector
from varint.scene.parameters import ParameterValues
from varint.scene.system import System, parameter_values, require_system

# a longer way from the constraint, relative to the coordinates, is no round-off
ON_CONSTRAINT = 1e-9


def boundary_value_problem(
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
    params: ParameterValues | None,
    periodic: bool,
    symmetry: Any,
    energy: float | None,
) -> tuple[BoundaryValueProblem, np.ndarray, tuple[float, float, float]]:
    """Problem, first path as configurations at equally spaced times, and guess and bounds of the
    duration.
    """
    require_system(system)
    rule = default_rule(system) if rule is None else rule
    _check_suitable(system, rule)
    steps, t0 = positive_integer("steps", steps), number("t0", t0)
    check_memory(
        f"a path of {steps} steps",
        steps * len(point_times(rule)) * system.structure.n,
        "take fewer steps",
    )
    c = parameter_values(system, params)
    energy = None if energy is None else number("energy", energy)
    free = energy is not None or isinstance(duration, Free)
    if free and system.structure.forced:
        raise InputError(
            "a free duration needs a scene without forces (with them no action is stationary)"
        )
    if not isinstance(periodic, bool):
        raise InputError(f"periodic must be True or False, got {periodic!r}")
    closure = ends = None
    if periodic:
        closure, nodes = _closed_path(system, q_start, q_end, symmetry, guess)
    else:
        ends, nodes = _path_between_ends(system, q_start, q_end, symmetry, guess)
        if guess is None:
            nodes = first_way(system, ends, t0, c)
            nodes = bent_aside(system, ends) if nodes is ends else nodes
    problem = BoundaryValueProblem(
        system,
        rule,
        np.arange(steps + 1.0),
        t0,
        _controls_at_nodes(system, rule, u, steps),
        c,
        ends,
        closure,
        (energy or 0.0) if free else None,
    )
    points = points_through(problem, nodes)
    guessed, lower, upper = _duration(system, duration, energy, points, t0, c)
    check_steps(t0, guessed / steps, steps)
    _check_ends_on_constraints(problem, guessed)
    _check_finite(problem, points, guessed)
    return problem, nodes, (guessed, lower, upper)


def start_of(q0: Any, q_start: Any) -> Any:
    """The start of a path, which has two names."""
    if q0 is not None and q_start is not None:
        raise InputError("q0 and q_start are two names of the start: give one of them")
    return q_start if q0 is None else q0


def _closed_path(
    system: System, q_start: Any, q_end: Any, symmetry: Any, guess: Any
) -> tuple[np.ndarray, np.ndarray]:
    """How the path closes, [S | b], and the guess."""
    if q_start is not None or q_end is not None:
        raise InputError(
            "a periodic path has no end points: leave out q0 and q_end and give a guess"
        )
    if guess is None:
        raise InputError(
            "a periodic path needs a guess: configurations (k, n) at equally spaced times"
        )
    return _closure(system.structure.n, symmetry), _nodes(guess, system.structure.n, system.names)


def _path_between_ends(
    system: System, q_start: Any, q_end: Any, symmetry: Any, guess: Any
) -> tuple[np.ndarray, np.ndarray]:
    """End points (2, n), and the guess bent so that it joins them, or these points."""
    if symmetry is not None:
        raise InputError("symmetry belongs to periodic=True")
    if q_start is None or q_end is None:
        raise InputError("give q0 and q_end, or periodic=True with a guess")
    n, names = system.structure.n, system.names
    ends = np.array([vector("q0", q_start, n, names), vector("q_end", q_end, n, names)])
    if guess is None:
        return ends, ends
    nodes = _nodes(guess, n, names)
    ahead = np.linspace(0, 1, len(nodes))[:, None]
    back = np.linspace(1, 0, len(nodes))[:, None]
    return ends, nodes + ahead * (ends[1] - nodes[-1]) + back * (ends[0] - nodes[0])


def first_path(problem: BoundaryValueProblem, nodes: np.ndarray, duration: float) -> Iterate:
    """The straight lines between equally spaced nodes, in this time."""
    degree, constraints = len(point_times(problem.rule)) - 1, problem.system.structure.constraints
    return iterate_through(points_through(problem, nodes), degree, constraints, duration)


def points_through(problem: BoundaryValueProblem, nodes: np.ndarray) -> np.ndarray:
    """Control points of all steps on the straight lines between equally spaced nodes."""
    places = np.linspace(0, 1, len(nodes))
    points = np.stack([np.interp(problem.point_shares, places, x) for x in nodes.T], axis=1)
    if problem.ends is not None:
        points[0], points[-1] = problem.ends
    return points


def _controls_at_nodes(system: System, rule: Rule, u: Any, steps: int) -> np.ndarray:
    """Controls of every step at the rule's nodes, (steps, r·k)."""
    value = controls(system, rule, u, steps)
    value = np.repeat(value, len(rule.nodes), axis=1) if value.shape[1] == 1 else value
    return value.reshape(steps, -1)


def _check_suitable(system: System, rule: Rule) -> None:
    s = system.structure
    if not isinstance(rule, Rule):
        raise InputError(f"rule must be a varint Rule such as gauss(2), got {rule!r}")
    if s.degenerate:
        raise InputError(
            "the Lagrangian is degenerate (∂²L/∂v² = 0): its equations are of first order and end "
            "points at both ends are too many; simulate it from its start"
        )
    if s.nonholonomic:
        raise InputError(
            "non-holonomic constraints have no action whose paths could be found; use simulate"
        )
    if s.contacts:
        raise InputError(
            "a contact is an inequality: leave contact= out and give bounds=[(0, gap, numpy.inf)]"
        )
    interval(system, rule)


def _closure(n: int, symmetry: Any) -> np.ndarray:
    """[S | b]."""
    if symmetry is None:
        return np.eye(n, n + 1)
    try:
        value = np.array(symmetry, dtype=float)
    except (TypeError, ValueError):
        raise InputError(
            f"symmetry must be a matrix of numbers, got {type(symmetry).__name__}"
        ) from None
    if value.shape not in ((n, n), (n, n + 1)) or not np.isfinite(value).all():
        raise InputError(
            f"symmetry has shape {value.shape}; it must be S ({n}, {n}) or [S | b] ({n}, {n + 1}), "
            "finite"
        )
    return value if value.shape == (n, n + 1) else np.hstack([value, np.zeros((n, 1))])


def _nodes(guess: Any, n: int, names: tuple[str, ...]) -> np.ndarray:
    """Configurations at equally spaced times."""
    if isinstance(guess, Trajectory):
        if guess.q.shape[1] != n:
            raise InputError(
                f"the guess has {guess.q.shape[1]} coordinates; this system has {n}: {list(names)}"
            )
        even = np.linspace(guess.t[0], guess.t[-1], len(guess))
        return np.stack([np.interp(even, guess.t, x) for x in guess.q.T], axis=1)
    try:
        value = np.array(guess, dtype=float)
    except (TypeError, ValueError, RuntimeError):
        raise InputError(
            f"guess must be an array (k, {n}) or a Trajectory, got {type(guess).__name__}"
        ) from None
    value = value[:, None] if value.ndim == 1 and n == 1 else value
    if value.ndim != 2 or value.shape[1] != n or len(value) < 2 or not np.isfinite(value).all():
        raise InputError(
            f"guess has shape {value.shape}; it must be (k, {n}) with k ≥ 2 finite configurations "
            f"of {list(names)}"
        )
    return value


def _duration(
    system: System,
    duration: float | Free | None,
    energy: float | None,
    points: np.ndarray,
    t0: float,
    c: np.ndarray,
) -> tuple[float, float, float]:
    """(guess, lower, upper) of the duration."""
    if duration is None:
        if energy is None:
            raise InputError("give the duration of the path, or its energy")
        return _time_at_energy(system, energy, points, t0, c), 0.0, np.inf
    if energy is not None and not isinstance(duration, Free):
        raise InputError(
            "give duration or energy, not both; a guess of the duration is free(guess, lower, "
            "upper)"
        )
    guess, lower, upper = parsed_or_refused(
        lambda: window(duration),
        lambda: f"duration must be a number or free(guess, lower, upper), got {duration!r}",
    )
    if not (np.isfinite(guess) and lower > 0):
        raise InputError(
            f"duration must be positive and finite (and its lower bound positive), got {duration!r}"
        )
    return guess, lower, upper


def _time_at_energy(
    system: System, energy: float, points: np.ndarray, t0: float, c: np.ndarray
) -> float:
    """Time that the first path takes at the given energy: ∫ √(T(q, q′) / (E − V(q))) ds over its
    parameter s.
    """
    slope = np.diff(points, axis=0) * (len(points) - 1)
    middle = (points[1:] + points[:-1]) / 2
    value = ca.Function("value", [system.q, system.v, system.t, system.c], [system.lagrangian])
    ahead, back, rest = (
        over_columns(value, middle, f * slope, np.array([t0]), c)[0] for f in (1.0, -1.0, 0.0)
    )
    kinetic, left = (ahead + back) / 2 - rest, energy + rest
    if not np.isfinite(kinetic).all() or not (kinetic > 0).any() or not (left > 0).any():
        raise InputError(
            f"the energy {energy:g} is below the potential all along the first path, or that path "
            "does not move; give a guess or duration=free(guess, lower, upper)"
        )
    return float(np.sqrt(np.maximum(kinetic, 0) / np.maximum(left, 1e-3 * left.max())).mean())


def _check_ends_on_constraints(problem: BoundaryValueProblem, duration: float) -> None:
    """Both end points satisfy the constraints."""
    if not problem.system.structure.constraints or problem.ends is None:
        return
    largest, times = np.abs(problem.ends).max(), (problem.t0, problem.t0 + duration)
    for name, q, t in zip(("q0", "q_end"), problem.ends, times, strict=True):
        g, slope = constraint_function(problem.system)(q, t, problem.c)
        off = np.abs(np.array(g).ravel())
        slope = np.abs(np.array(ca.densify(slope)))
        allowed = ON_CONSTRAINT * (slope @ np.maximum(np.abs(q), largest))
        if not (off <= allowed).all():
            row = int(np.argmax(off - allowed))
            raise InputError(
                f"{name} = {q} is off the constraint: row {row} of g is {off[row]:.3g} there, not 0"
            )


def _check_finite(problem: BoundaryValueProblem, points: np.ndarray, duration: float) -> None:
    """The mechanics can be evaluated along the first path."""
    s = problem.system
    v = np.gradient(points, axis=0) * (len(points) - 1) / duration
    u = np.zeros(s.structure.controls)
    inner = slice(1, -1) if len(points) > 2 else slice(None)
    values = over_columns(
        point_function(s), points[inner], v[inner], u, np.array([problem.t0]), problem.c
    )
    if not all(np.isfinite(x).all() for x in values):
        raise InputError(
            "the Lagrangian is not finite along the first path: it passes a collision, a square "
            "root or logarithm of a negative number; give a guess that avoids it"
        )

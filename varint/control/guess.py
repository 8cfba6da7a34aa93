"""Where the solver starts: a straight line, arrays, functions of time, a trajectory or an earlier solution."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from varint.arrays import over_columns
from varint.control.leg import Leg
from varint.control.onto import onto_manifold, path_on_manifold
from varint.control.phase import Checked
from varint.control.piecewise import Piecewise
from varint.control.problem import Problem, end_positions
from varint.control.solution import ControlSolution
from varint.errors import InputError, converted
from varint.system import System, per_system
from varint.trajectory import Trajectory

KEYS = ("q", "u", "duration")
Path = Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True, eq=False)
class Guess:
    """Path and controls as functions of the fraction of the duration, (M,) → (M, n) and (M, k)."""

    q: Path
    u: Path | None
    duration: float
    c: np.ndarray


def start_values(problem: Problem) -> np.ndarray:
    """Start values of all unknowns from the phases' guesses, within their bounds."""
    x = np.zeros(problem.unknowns)
    for one in problem.legs:
        fill(x, one, phase_guess(one.phase, float(one.data[2 * one.phase.steps])))
    return np.clip(x, problem.x_low, problem.x_high)


def phase_guess(phase: Checked, t0: float) -> Guess:
    """The guess of a phase in whatever form the user gave it."""
    given = phase.guess
    if isinstance(given, Trajectory):
        return _from_trajectory(phase, given)
    if given is None:
        return Guess(_straight(phase, t0), None, phase.duration[0], phase.c)
    if not isinstance(given, Mapping):
        raise InputError(f"guess must be a Trajectory or a dictionary with {list(KEYS)}, got {type(given).__name__}")
    unknown = sorted(set(given) - set(KEYS))
    if unknown:
        raise InputError(f"unknown keys {unknown} in guess; known: {list(KEYS)}")
    duration = _guessed_duration(given.get("duration", phase.duration[0]))
    s = phase.system.structure
    q = _path("q", given["q"], s.n, t0, duration) if "q" in given else _straight(phase, t0)
    u = _path("u", given["u"], s.controls, t0, duration) if "u" in given else None
    return Guess(q, u, duration, phase.c)


def _guessed_duration(value: Any) -> float:
    try:
        duration = float(value)
    except (TypeError, ValueError):
        duration = np.nan
    if not (np.isfinite(duration) and duration > 0):
        raise InputError(f"the guess of the duration must be a positive number, got {value!r}")
    return duration


def _straight(phase: Checked, t0: float) -> Path:
    """The line between the ends; on a constrained scene a path near it that keeps to the constraints."""
    first, last = end_positions(phase)

    def line(s: np.ndarray) -> np.ndarray:
        return (1 - s[:, None]) * first + s[:, None] * last

    if not phase.system.structure.constraints:
        return line
    moves = np.array([end.q[1] < end.q[2] for end in (phase.start, phase.end)])
    return path_on_manifold(phase.system, line, t0, phase.duration[0], phase.c, moves)


def _from_trajectory(phase: Checked, motion: Trajectory) -> Guess:
    if motion.q.shape[1] != phase.system.structure.n:
        raise InputError(
            f"the guess has {motion.q.shape[1]} coordinates, the system {phase.system.structure.n}: "
            f"{list(phase.system.names)}"
        )
    c = np.where(phase.c_low < phase.c_high, motion.c, phase.c) if motion.c.shape == phase.c.shape else phase.c
    found = motion.solution
    if isinstance(found, ControlSolution):
        return Guess(found.q, found.u, motion.duration, c)
    u = None
    if motion.u.size and motion.u.shape[-1] == phase.system.structure.controls:
        nodes = np.array(motion.rule.nodes) if motion.u.shape[1] > 1 else np.array([0.5])
        u = Piecewise(np.linspace(0, 1, len(motion.u) + 1), nodes, motion.u)
    return Guess(_hermite(motion), u, motion.duration, c)


def _hermite(motion: Trajectory) -> Path:
    """Cubic through positions and velocities at the nodes."""
    t, q, v = motion.t - motion.t[0], motion.q, motion.v

    def path(s: np.ndarray) -> np.ndarray:
        at = s * t[-1]
        i = np.clip(np.searchsorted(t, at, side="right") - 1, 0, len(t) - 2)
        h = (t[i + 1] - t[i])[:, None]
        x = ((at - t[i])[:, None]) / h
        left, right = (1 - x) ** 2, x**2
        return left * ((1 + 2 * x) * q[i] + h * x * v[i]) + right * ((3 - 2 * x) * q[i + 1] - h * (1 - x) * v[i + 1])

    return path


def _path(what: str, given: Any, size: int, t0: float, duration: float) -> Path:
    """A function of time, or samples evenly spaced over the duration, as a path."""
    if callable(given):

        def sampled(s: np.ndarray) -> np.ndarray:
            found = [given(float(t0 + x * duration)) for x in s]
            values = converted(
                lambda: np.array([np.asarray(y, dtype=float).ravel() for y in found]),
                lambda: f"the guess of {what} must give {size} numbers at any time, got {found[0]!r}",
            )
            return _checked_samples(what, values if found else np.zeros((0, size)), size)

        return sampled
    try:
        values = np.array(given, dtype=float)
    except (TypeError, ValueError):
        raise InputError(f"the guess of {what} must be numbers or a function of time, got {given!r}") from None
    if values.ndim == 1:
        values = values[None] if len(values) == size else values[:, None]
    if values.ndim == 3:  # (steps, r, k): controls of a trajectory
        values = values.mean(axis=1)
    values = _checked_samples(what, values, size)
    places = np.linspace(0, 1, len(values)) if len(values) > 1 else np.zeros(1)
    return lambda s: np.array([np.interp(s, places, column) for column in values.T]).T


def _checked_samples(what: str, values: np.ndarray, size: int) -> np.ndarray:
    if not np.isfinite(values).all():
        raise InputError(f"the guess of {what} is not finite in {int((~np.isfinite(values)).sum())} of its numbers")
    if values.ndim != 2 or values.shape[1] != size:
        raise InputError(f"the guess of {what} has shape {values.shape}; it takes (samples, {size})")
    return values


def fill(x: np.ndarray, one: Leg, guess: Guess) -> None:
    """Write the guess into the unknowns of a phase."""
    phase, slots, rule = one.phase, one.slots, one.phase.rule
    mesh, steps = phase.mesh, np.diff(phase.mesh)
    inside = (mesh[:-1, None] + steps[:, None] * np.array(rule.points[1:-1])).ravel()
    for index, at in ((slots.q, mesh), (slots.inner, inside)):
        q = guess.q(at)
        if phase.system.structure.constraints and len(at):
            times = one.data[2 * phase.steps] + guess.duration * at
            q = onto_manifold(phase.system, q, times, guess.c)[0]
        x[index] = q.reshape(index.shape)
    points = np.concatenate([x[slots.q[:-1]][:, None], x[slots.inner], x[slots.q[1:]][:, None]], axis=1)
    h = guess.duration * steps
    v_nodes = np.einsum("ij,kjn->kin", rule.slopes, points) / h[:, None, None]
    x[slots.v[0]], x[slots.v[1]] = v_nodes[0, 0], v_nodes[-1, -1]
    values = np.concatenate([[one.data[2 * phase.steps], guess.duration], guess.c])
    x[slots.shared[slots.shared >= 0]] = values[slots.shared >= 0]
    if not slots.u.size:
        return
    at = np.array(rule.nodes) if phase.samples > 1 else np.array([0.5])
    fractions = (mesh[:-1, None] + steps[:, None] * at).ravel()
    if guess.u is not None:
        x[slots.u] = guess.u(fractions).reshape(slots.u.shape)
    else:
        q_nodes = np.einsum("ij,kjn->kin", rule.basis, points)
        u = _inverse_dynamics(phase, q_nodes, v_nodes, points[:, -1] - points[:, 0], values[0], guess)
        x[slots.u] = u if phase.samples > 1 else u.mean(axis=1, keepdims=True)


def _inverse_dynamics(phase: Checked, q, v, moved: np.ndarray, t0: float, guess: Guess) -> np.ndarray:
    """Controls that come closest to moving the scene along the guess: least squares, one Gauss–Newton step from 0.

    Accelerations are differences of the mean velocities of the steps: the guess has kinks where steps meet.
    """
    count, r, n = q.shape
    local = phase.mesh[:-1, None] + np.diff(phase.mesh)[:, None] * np.array(phase.rule.nodes)
    t = (t0 + guess.duration * local).ravel()
    v = v.reshape(-1, n)
    a = np.zeros_like(v)
    if count > 1:
        middles = t0 + guess.duration * (phase.mesh[:-1] + phase.mesh[1:]) / 2
        with np.errstate(all="ignore"):  # what is not finite is left out below
            rates = np.gradient(moved / (guess.duration * np.diff(phase.mesh))[:, None], middles, axis=0)
        a = np.array([np.interp(t, middles, rate) for rate in rates.T]).T
    low, high = (np.where(np.isfinite(side), side, 0) for side in phase.bounds.u)
    rest = np.clip(0.0, low, high)
    u = over_columns(_inverse(phase.system), q.reshape(-1, n), v, a, rest, t[:, None], guess.c)[0]
    return np.where(np.isfinite(u), u, rest).reshape(count, r, -1)


@per_system
def _inverse(system: System) -> ca.Function:
    """(q, v, a, u0, t, c) → u with the least |F(u) − (d/dt ∂L/∂v − ∂L/∂q)|, F linear about u0."""
    s, n = system, system.structure.n
    a = ca.SX.sym("a", n)
    p = s.momentum
    rate = ca.jtimes(p, s.q, s.v) + ca.mtimes(s.mass_matrix, a) + ca.jacobian(p, s.t)
    lacking = rate - ca.gradient(s.lagrangian, s.q) - s.force
    slope = ca.jacobian(s.force, s.control)
    f = ca.Function("lacking", [s.q, s.v, a, s.control, s.t, s.c], [ca.densify(lacking), ca.densify(slope)])
    q, v, a, u, t, c = (ca.MX.sym(f"i{i}", f.size1_in(i)) for i in range(6))
    need, act = f(q, v, a, u, t, c)
    return ca.Function("inverse_dynamics", [q, v, a, u, t, c], [u + _least_squares(act, need)])


def _least_squares(matrix: ca.MX, rhs: ca.MX) -> ca.MX:
    """The damped least-squares solution: finite also where a control does not act at this point."""
    normal = ca.mtimes(matrix.T, matrix)
    damping = REGULAR * (1 + ca.trace(normal)) * ca.DM.eye(matrix.shape[1])
    return ca.solve(normal + damping, ca.mtimes(matrix.T, rhs))


REGULAR = 1e-10

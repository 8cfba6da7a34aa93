"""Residuals of an estimation problem and their exact derivatives, by multiple shooting on the
discrete motion.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import casadi as ca
import numpy as np

from varint.errors import ConvergenceError
from varint.estimation.begin import begun
from varint.estimation.contact_runs import contact_run, states_seen
from varint.estimation.inertias import is_positive
from varint.estimation.problem import ON_NODE, Estimation, Motion
from varint.estimation.ray_rows import ray_rows
from varint.estimation.sensors import observed, seen_by
from varint.estimation.single_steps import carried_steps
from varint.integration.backend import kernel_for
from varint.integration.problem import InitialValueProblem
from varint.numerics.arrays import call
from varint.rules.polynomials import lagrange_values
from varint.scene.system import System
from varint.scene.travel import itself
from varint.sensitivities.loops import sweeper
from varint.sensitivities.pieces import Piece, all_nodes, velocities
from varint.sensitivities.start import momentum_function, momentum_slopes
from varint.sensitivities.steps_at_once import Directions, Sweeper
from varint.sensitivities.sweeps import forwards

LOOKED_AT = 10  # nodes of a segment at which the kinetic energy must be positive
ITERATIONS = 10  # that a fit is expected to take, each a run with its derivatives


class Residuals(NamedTuple):
    """At one guess: residuals r in units of σ with ∂r/∂z, defects d between segments with ∂d/∂z,
    nodes of every experiment (steps + 1, 2n); `signal` is the length of what was measured, in σ.
    """

    r: np.ndarray
    of_r: np.ndarray
    d: np.ndarray
    of_d: np.ndarray
    nodes: tuple[np.ndarray, ...]
    signal: float


@dataclass(frozen=True, eq=False)
class Shooter:
    """An estimation problem with what its runs need.

    Attributes
    ----------
    problem : Estimation
    by : Sweeper
    observed : tuple of tuple of Function
        Of the measurements of every experiment.
    inert : bool
        Whether unknown parameters stand in the kinetic energy, which is positive at the guess and
        must remain so.
    backend : str
        As it was asked for.
    """

    problem: Estimation
    by: Sweeper
    observed: tuple[tuple[ca.Function, ...], ...]
    inert: bool
    backend: str

    @property
    def scene(self) -> System:
        return self.problem.system

    def __reduce__(self) -> tuple[Callable[..., Shooter], tuple[Estimation, str]]:
        """To another process goes the problem, whose runs are built where it arrives."""
        return shooter, (self.problem, self.backend)

    __copy__ = __deepcopy__ = itself


def shooter(problem: Estimation, backend: str) -> Shooter:
    """The runs of a problem, compiled where so many steps repay it."""
    steps = ITERATIONS * sum(m.steps for m in problem.motions)
    functions = tuple(
        tuple(observed(problem.system, m.expression) for m in motion.data)
        for motion in problem.motions
    )
    by = sweeper(problem.system, problem.rule, steps, backend)
    return Shooter(problem, by, functions, _inert(problem), backend)


def _inert(p: Estimation) -> bool:
    mass = ca.densify(ca.jacobian(p.system.momentum, p.system.v))
    moved = ca.which_depends(mass, p.system.c, 1, False) if len(p.c) else []
    starts = np.array([m.start for m in p.motions])
    return any(moved[i] for i in p.theta) and is_positive(
        p.system, starts, np.array([m.t0 for m in p.motions]), p.c
    )


def first_guess(problem: Estimation) -> np.ndarray:
    """z: parameters, then for each experiment its unknown start; then the states between segments,
    still zero.
    """
    starts = [m.start[problem.free] for m in problem.motions]
    named = np.concatenate([problem.c[problem.theta], *starts])
    return np.concatenate([named, np.zeros(problem.size - problem.many)])


def segment_columns(problem: Estimation) -> list[list[slice]]:
    """Where the states between segments stand in z, for every experiment."""
    size, at, found = 2 * problem.system.structure.n, problem.many, []
    for motion in problem.motions:
        count = len(motion.cuts) - 2
        found.append([slice(at + i * size, at + (i + 1) * size) for i in range(count)])
        at += count * size
    return found


def residuals(shoot: Shooter, z: np.ndarray) -> Residuals:
    """All residuals and defects at z.

    Raises
    ------
    ConvergenceError
        If a step cannot be solved.
    """
    p = shoot.problem
    c = parameters_at(p, z)
    parts = [
        _of_motion(shoot, motion, e, columns, z, c)
        for e, (motion, columns) in enumerate(zip(p.motions, segment_columns(p), strict=True))
    ]
    measured = [m for motion in p.motions for m in motion.data]
    prior = np.zeros((len(p.prior), p.size))
    which = p.prior[:, 0].astype(int)
    prior[np.arange(len(which)), which] = 1 / p.prior[:, 2]
    r = [*(x[0] for x in parts), (z[which] - p.prior[:, 1]) / p.prior[:, 2]]
    of_r = [*(x[1] for x in parts), prior]
    rays = ray_rows(p, [start_of(p, m, e, z) for e, m in enumerate(p.motions)])
    d, of_d = (np.concatenate([*(x[i] for x in parts), rays[i - 2]]) for i in (2, 3))
    signal = float(np.sqrt(sum(np.nansum((m.values / m.spread) ** 2) for m in measured)))
    nodes = tuple(x[4] for x in parts)
    return Residuals(np.concatenate(r), np.concatenate(of_r), d, of_d, nodes, signal)


def _of_motion(
    shoot: Shooter, motion: Motion, e: int, columns: list[slice], z: np.ndarray, c: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    p = shoot.problem
    if p.system.structure.contacts:
        return _through_contacts(shoot, motion, e, z, c)
    n, many = p.system.structure.n, len(p.theta)
    size = 2 * n
    state, tangent = _start(p, motion, e, z, c)
    seen = np.empty((len(motion.times), size))
    of_seen = np.zeros((len(motion.times), size, p.size))
    defects, of_defects, nodes = [], [], []
    step_of, fraction = _places(motion, p.h)
    for j, (k0, k1) in enumerate(zip(motion.cuts, motion.cuts[1:], strict=False)):
        piece = _piece(shoot, motion, state, int(k0), int(k1), c)
        if shoot.inert:
            _refuse_unphysical(p, np.hstack([piece.x[:-1, :n], piece.v[:-1]]), piece.t, c)
        # local columns: the state at which the segment begins, then the parameters
        along = np.zeros((len(c) + 2, size + many))
        along[p.theta, size + np.arange(many)] = 1.0
        begin = np.hstack([np.eye(size), np.zeros((size, many))])
        local = forwards(shoot.by, piece, c, Directions(along), begin)
        spread = np.vstack([tangent, np.eye(p.size)[:many]])
        here = np.flatnonzero((step_of >= k0) & ((step_of < k1) | (k1 == motion.steps)))
        if len(here):
            at = step_of[here] - k0
            x, of_x = _within(shoot, motion, piece, local, at, fraction[here], c)
            seen[here], of_seen[here] = x, of_x @ spread
        nodes.append(piece.x if k1 == motion.steps else piece.x[:-1])
        if j < len(columns):
            state, end = z[columns[j]], piece.x[-1]
            tangent = np.zeros((size, p.size))
            tangent[:, columns[j]] = np.eye(size)
            defects.append(end - state)
            of_defects.append(local[-1] @ spread - tangent)
    r, of_r = _measured(p, motion, shoot.observed[e], seen, of_seen, c)
    d = np.concatenate([np.zeros(0), *defects])
    of_d = np.concatenate([np.zeros((0, p.size)), *of_defects])
    return r, of_r, d, of_d, np.concatenate(nodes)


def _through_contacts(
    shoot: Shooter, motion: Motion, e: int, z: np.ndarray, c: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """The same of a scene with contacts, by one run; its nodes are not those of the grid alone."""
    p, none = shoot.problem, np.zeros((0, z.size))
    q, v = np.split(start_of(p, motion, e, z), 2)
    run = contact_run(p, motion, q, v, c, shoot.backend)
    if shoot.inert:
        _refuse_unphysical(p, np.hstack([run.q, run.v]), run.t, c)
    tangent = _start(p, motion, e, z, c)[1]
    seen, of_seen = states_seen(p, motion, run, tangent, shoot.backend)
    r, of_r = _measured(p, motion, shoot.observed[e], seen, of_seen, c)
    return r, of_r, np.zeros(0), none, np.empty((0, 2 * len(q)))


def _refuse_unphysical(p: Estimation, x: np.ndarray, t: np.ndarray, c: np.ndarray) -> None:
    """A trial whose kinetic energy is not positive at some of its nodes (q, v) is none."""
    some = slice(None, len(t), -(-len(t) // LOOKED_AT))
    if not is_positive(p.system, x[some], t[some], c):
        raise ConvergenceError(
            "the kinetic energy is not positive at these inertias",
            step=0,
            time=float(t[0]),
            residual=float("nan"),
        )


def start_of(p: Estimation, motion: Motion, e: int, z: np.ndarray) -> np.ndarray:
    """(q0, v0) of an experiment."""
    start, first = motion.start.copy(), len(p.theta) + e * len(p.free)
    if motion.begin is not None:
        start = begun(motion.begin, parameters_at(p, z))[0]
    start[p.free] = z[first : first + len(p.free)]
    return start


def parameters_at(p: Estimation, z: np.ndarray) -> np.ndarray:
    """All parameters, the estimated ones put in."""
    c = p.c.copy()
    c[p.theta] = z[: len(p.theta)]
    return c


def _start(
    p: Estimation, motion: Motion, e: int, z: np.ndarray, c: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """(q, p) at the start and its derivative by z."""
    n, many = p.system.structure.n, len(p.theta)
    q, v = np.split(start_of(p, motion, e, z), 2)
    t = np.array([motion.t0])
    momentum = call(momentum_function(p.system), q, v, t, c)[0]
    flat = call(momentum_slopes(p.system), q, v, t, c)
    of_q, of_v, of_c, _ = (x.reshape(-1, n).T for x in flat)
    by_start = np.block([[np.eye(n), np.zeros((n, n))], [of_q, of_v]])
    tangent, first = np.zeros((2 * n, p.size)), many + e * len(p.free)
    tangent[:, first : first + len(p.free)] = by_start[:, p.free]
    tangent[n:, :many] = of_c[:, p.theta]
    if motion.begin is not None:
        tangent[:, :many] += by_start @ begun(motion.begin, c)[1][:, p.theta]
    return np.concatenate([q, momentum]), tangent


def _piece(
    shoot: Shooter, motion: Motion, state: np.ndarray, k0: int, k1: int, c: np.ndarray
) -> Piece:
    """The run of one segment."""
    p, nodes = shoot.problem, len(shoot.problem.rule.nodes)
    q, momentum = np.split(np.ascontiguousarray(state), 2)
    run = InitialValueProblem(q, momentum, motion.t0, p.h, k1, 1, motion.u, c, nodes, first=k0)
    kernel = None
    if shoot.by.kernels:
        kernel = kernel_for(p.system, p.rule, run._replace(steps=10**7), "auto")
    x = all_nodes(p.system, p.rule, run, kernel)
    t = motion.t0 + p.h * np.arange(k0, k1 + 1)
    v = velocities(p.system, x, t, c)
    h = np.full(k1 - k0, p.h)
    return Piece(0, 1, k0, x, v, t[:-1], h, run.controls(k0, k1 - k0), np.array([0, k1 - k0]))


def _places(motion: Motion, h: float) -> tuple[np.ndarray, np.ndarray]:
    """The step in which each measured time lies, or which begins there, and the part of it that has
    passed.
    """
    passed = (motion.times - motion.t0) / h
    step = np.floor(passed + ON_NODE).astype(int)
    fraction = passed - step
    return step, np.where(np.abs(fraction) <= ON_NODE, 0.0, fraction)


def _within(
    shoot: Shooter,
    motion: Motion,
    piece: Piece,
    local: np.ndarray,
    at: np.ndarray,
    fraction: np.ndarray,
    c: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """States at measured times and their derivatives: nodes, or a shorter step of the rule."""
    p = shoot.problem
    x, of_x = piece.x[at], local[at]
    inner = np.flatnonzero(fraction > 0)
    if not len(inner):
        return x, of_x
    k, part = at[inner], fraction[inner]
    u = _controls_within(p, piece.u[k], part)
    moved_by = np.zeros((len(c), of_x.shape[2]))
    first = 2 * p.system.structure.n
    moved_by[p.theta, first + np.arange(len(p.theta))] = 1.0
    end, moved = carried_steps(
        shoot.by, x[inner], piece.t[k], part * p.h, u, c, of_x[inner], moved_by
    )
    x, of_x = x.copy(), of_x.copy()
    x[inner], of_x[inner] = end, moved
    return x, of_x


def _controls_within(p: Estimation, u: np.ndarray, part: np.ndarray) -> np.ndarray:
    """Controls at the rule's nodes of a part of a step: the polynomial through those of all of
    it.
    """
    count, r, k = u.shape
    if not k:
        return np.empty((count, 0))
    nodes = np.array(p.rule.nodes)
    if p.rule.points:
        u = lagrange_values(nodes, (nodes * part[:, None]).ravel()).reshape(-1, r, r) @ u
    return u.reshape(count, -1)


def _measured(
    p: Estimation,
    motion: Motion,
    functions: tuple[ca.Function, ...],
    seen: np.ndarray,
    of_seen: np.ndarray,
    c: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """(ψ − y)/σ of every value that is there, and its derivative."""
    many = len(p.theta)
    r, of_r = [np.zeros(0)], [np.zeros((0, p.size))]
    for m, rows, f in zip(motion.data, motion.rows, functions, strict=True):
        value, of_x, of_c = seen_by(f, seen[rows], m.t, c)
        slope = of_x @ of_seen[rows]
        slope[:, :, :many] += of_c[:, :, p.theta]
        there = np.isfinite(m.values)
        r.append(((value - m.values) / m.spread)[there])
        of_r.append((slope / m.spread[:, :, None])[there])
    return np.concatenate(r), np.concatenate(of_r)

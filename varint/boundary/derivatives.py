"""Derivatives of the action and of the end momenta of a path: Hamilton's principal function and its
second derivatives.

S(q_start, q_end, T) of the discrete paths has ∂S/∂q_end = p_end, ∂S/∂q_start = −p_start, ∂S/∂T = −H
exactly (the discrete path is stationary); the momenta follow from the path equations by the
implicit function theorem.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import casadi as ca
import numpy as np

from varint.boundary.iterate import Iterate
from varint.boundary.newton import equilibrated_solver
from varint.boundary.recovered import interval_paths, require_every_step, step_sizes
from varint.boundary.stationary import BoundaryValueProblem, interval_data, interval_rows
from varint.errors import InputError
from varint.numerics.arrays import over_columns
from varint.results.dense_output import step_controls
from varint.results.records import require_motion
from varint.results.require import require_trajectory
from varint.results.trajectory import Trajectory
from varint.rules.rule import Rule
from varint.scene.memory import per_system
from varint.scene.system import System


@dataclass(frozen=True, eq=False)
class ActionDerivatives:
    """Derivatives with respect to ``"q_start"``, ``"q_end"``, ``"duration"`` and each parameter by
    its name.

    Attributes
    ----------
    action : mapping of str to ndarray
        ∂S/∂x, of the shape of x; empty for scenes with forces, which have no action.
    p_start, p_end : mapping of str to ndarray
        ∂p/∂x of the momenta at the ends, (n,) followed by the shape of x.
    """

    action: Mapping[str, np.ndarray]
    p_start: Mapping[str, np.ndarray]
    p_end: Mapping[str, np.ndarray]


def action_derivatives(path: Trajectory) -> ActionDerivatives:
    """How action and end momenta of a path between fixed ends change with the ends, the duration
    and the parameters.

    ∂S/∂q_end = p_end, ∂S/∂q_start = −p_start, ∂S/∂T = −H (Hamilton and Jacobi; Arnold, Mathematical
    Methods, §46).

    Parameters
    ----------
    path : Trajectory
        From `least_action` or `simulate`, with every step kept.

    Returns
    -------
    ActionDerivatives

    Raises
    ------
    InputError
        If the scene has constraints or steps are missing.

    Examples
    --------
    >>> import varint as vi
    >>> q, v = vi.coordinates("x")
    >>> free = vi.System(q, v, v**2 / 2)
    >>> path = vi.least_action(free, vi.gauss(1), q_start=0.0, q_end=3.0, duration=2.0, steps=4)
    >>> change = vi.action_derivatives(path)
    >>> round(float(change.action["duration"]), 9), round(float(change.p_end["q_end"][0, 0]), 9)
    (-1.125, 0.5)
    """
    problem, iterate = _restate(path)
    system, n = path.system, path.q.shape[1]
    _, slope = problem.equations.derivatives(problem, iterate)
    size = slope.shape[0]
    by_time, by_parameter, action_by = _partial(problem, iterate, size)
    ends = np.eye(size, 2 * n, 2 * n - size)  # rows q = q_start, q = q_end
    answer = equilibrated_solver(slope)(np.hstack([ends, -by_time[:, None], -by_parameter]))[
        -2 * n :
    ]
    if not np.isfinite(answer).all():
        raise InputError(
            "the end is conjugate to the start: there the momenta are no functions of the ends"
        )
    if not system.structure.forced:
        action_by = np.concatenate([-path.p[0], path.p[-1], action_by])
    shapes = {"q_start": (n,), "q_end": (n,), "duration": ()} | {
        k: x.shape for k, x in system.defaults.items()
    }
    cuts = np.cumsum([int(np.prod(shape)) for shape in shapes.values()])[:-1]

    def by_name(values: np.ndarray) -> dict[str, np.ndarray]:
        found = {}
        for (name, shape), part in zip(
            shapes.items(), np.split(values, cuts, axis=-1), strict=True
        ):
            # matrices stand column after column
            part = part.reshape((*values.shape[:-1], *shape[::-1]))
            found[name] = part.swapaxes(-1, -2) if len(shape) == 2 else part
        return found

    return ActionDerivatives(
        action={} if system.structure.forced else by_name(action_by),
        p_start=by_name(answer[:n]),
        p_end=by_name(answer[n:]),
    )


def _restate(path: Trajectory) -> tuple[BoundaryValueProblem, Iterate]:
    """The boundary value problem between fixed ends that the trajectory solves."""
    require_trajectory(path)
    system, steps = path.system, len(path) - 1
    if system.structure.constraints or system.structure.nonholonomic or system.structure.contacts:
        raise InputError(
            "derivatives of the action are for scenes without constraints: use independent "
            "coordinates"
        )
    if system.structure.degenerate:
        raise InputError("the Lagrangian is degenerate: the ends do not determine a path")
    require_motion(path, "what its momenta do when the ends move is not known")
    require_every_step(path)
    found = interval_paths(path, np.arange(steps), step_sizes(path), None)
    d = found.increments.shape[1]
    u = step_controls(path, path.k[:-1], np.ones(steps))
    grid = np.arange(steps + 1.0)
    if path.sizes is not None:
        grid = np.append(0.0, np.cumsum(path.sizes)) * (steps / path.duration)
    problem = BoundaryValueProblem(
        system, path.rule, grid, float(path.t[0]), u, path.c, path.q[[0, -1]]
    )
    lam = np.zeros((steps * d + 1, 0))
    return problem, Iterate(path.q[:-1], found.increments, lam, path.p[[0, -1]], path.duration)


def _partial(
    problem: BoundaryValueProblem, iterate: Iterate, size: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """∂rows/∂T (size,), ∂rows/∂c (size, parameters), ∂S/∂(T, c) at fixed control points."""
    steps, d, n = iterate.increments.shape
    _, slopes = over_columns(
        _partial_function(problem.system, problem.rule), *interval_data(problem, iterate)
    )
    count = (d + 1) * n
    slopes = slopes.reshape(steps, -1, count + 1).transpose(0, 2, 1)  # columns h, t, c
    own, begin = problem.sizes[:, None], problem.grid[:-1, None]
    by_time = (own * slopes[:, :, 0] + begin * slopes[:, :, 1]) / steps
    by = np.concatenate([by_time[:, :, None], slopes[:, :, 2:]], axis=2)
    rows = np.zeros((size, by.shape[2]))
    np.add.at(rows, np.arange(steps)[:, None] * d * n + np.arange(count), by[:, :count])
    return rows[:, 0], rows[:, 1:], by[:, count].sum(axis=0)


@per_system
def _partial_function(system: System, rule: Rule) -> ca.Function:
    """Arguments of `interval_rows` → (action, ∂(rows, action)/∂(h, t, c))."""
    kernel = interval_rows(system, rule)
    inputs = [ca.SX.sym(f"a{i}", kernel.numel_in(i)) for i in range(kernel.n_in())]
    rows, action = kernel(*inputs)
    c, t, h = inputs[4:]
    slope = ca.jacobian(ca.vertcat(rows, action), ca.vertcat(h, t, c))
    return ca.Function("partial", inputs, [action, ca.densify(slope)], {"cse": True})

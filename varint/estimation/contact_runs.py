"""What a motion with contacts shows, with its derivatives: one run from its start, whose impacts,
stops and detachments come as they do.
"""

from __future__ import annotations

import numpy as np

from varint.errors import ConvergenceError, InputError
from varint.estimation.problem import Estimation, Motion
from varint.integration.simulate import simulate
from varint.results.trajectory import Trajectory
from varint.scene.system import parameters_by_name
from varint.sensitivities.start import rate_at
from varint.sensitivities.tangents import Asked, changes_within


def contact_run(
    p: Estimation, motion: Motion, q0: np.ndarray, v0: np.ndarray, c: np.ndarray, backend: str
) -> Trajectory:
    """The run of an experiment.

    Raises
    ------
    ConvergenceError
        If it cannot begin or be finished.
    """
    try:
        return simulate(
            p.system,
            p.rule,
            q0=q0,
            v0=v0,
            h=p.h,
            steps=motion.steps,
            t0=motion.t0,
            params=parameters_by_name(p.system, c),
            u=motion.u if p.system.structure.controls else None,
            backend=backend,
        )
    except InputError as error:
        raise _no_run(motion, str(error)) from error


def states_seen(
    p: Estimation, motion: Motion, run: Trajectory, tangent: np.ndarray, backend: str
) -> tuple[np.ndarray, np.ndarray]:
    """States (q, p) at the measured times (T, 2n) and their derivatives (T, 2n, size), from those
    of the state at the start, (2n, size).

    Raises
    ------
    ConvergenceError
        If an event of the run has no derivative.
    """
    many, size = len(p.theta), tangent.shape[1]
    outer = np.zeros((len(run.c) + 2 + p.system.structure.contacts, size))
    outer[p.theta, np.arange(many)] = 1.0
    seen = run.at(np.clip(motion.times, motion.t0, run.t[-1]))
    try:
        moved = changes_within(run, seen, Asked(tangent, outer), backend)
    except InputError as error:
        raise _no_run(motion, str(error)) from error
    of_x, late = moved[:, :-1], moved[:, -1]
    for k in np.flatnonzero(np.abs(late).max(axis=1)):  # a node at an event, which moves with it
        of_x[k] -= rate_at(seen, int(k))[:, None] * late[k]
    return np.hstack([seen.q, seen.p]), of_x


def _no_run(motion: Motion, why: str) -> ConvergenceError:
    return ConvergenceError(why, step=0, time=motion.t0, residual=float("nan"))

"""Guesses of the states between segments: from the data where they show coordinates, else from a
run.
"""

from __future__ import annotations

import numpy as np

from varint.errors import ConvergenceError
from varint.estimation.problem import Estimation, Motion
from varint.estimation.residuals import segment_columns
from varint.estimation.seen import seen_states, shown_path
from varint.integration.simulate import simulate
from varint.numerics.arrays import over_columns
from varint.results.trajectory import Trajectory
from varint.scene.system import parameters_by_name
from varint.sensitivities.start import momentum_function


def guessed_states(p: Estimation, z: np.ndarray) -> np.ndarray:
    """z with the states at which segments begin."""
    z = z.copy()
    for motion, columns in zip(p.motions, segment_columns(p), strict=True):
        if columns:
            states = _states(p, motion)
            for column, state in zip(columns, states, strict=True):
                z[column] = state
    return z


def _states(p: Estimation, motion: Motion) -> np.ndarray:
    """(q, p) where segments begin: coordinates and velocities that were measured smoothed, the
    others from the guessed run, or constant where it breaks off.
    """
    t = motion.t0 + p.h * motion.cuts[1:-1]
    q, v = _run(p, motion, t)
    shown = shown_path(seen_states(p, motion), t)
    q, v = (np.where(np.isnan(x), run, x) for x, run in zip(shown, (q, v), strict=True))
    return np.hstack([q, over_columns(momentum_function(p.system), q, v, t[:, None], p.c)[0]])


def _run(p: Estimation, motion: Motion, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """q and v at the times by a run from the guesses, the start's where there is none."""
    n = p.system.structure.n
    q, v = (np.tile(x, (len(t), 1)) for x in np.split(motion.start, 2))
    u = motion.u if motion.u.shape[2] else None
    found: Trajectory | None
    try:
        found = simulate(
            p.system,
            p.rule,
            q0=motion.start[:n],
            v0=motion.start[n:],
            h=p.h,
            steps=motion.steps,
            t0=motion.t0,
            u=u,
            params=parameters_by_name(p.system, p.c),
        )
    except ConvergenceError as error:
        found = error.trajectory
    if found is not None:
        at = np.minimum(motion.cuts[1:-1], len(found) - 1)
        q, v = found.q[at].copy(), found.v[at].copy()
    return q, v

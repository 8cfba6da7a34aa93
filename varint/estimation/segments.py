"""Guesses of the states between segments: from the data where they show coordinates, else from a
run.
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from varint.errors import ConvergenceError
from varint.estimation.measurement import Measurement
from varint.estimation.problem import Estimation, Motion
from varint.estimation.residuals import segment_columns
from varint.integration.simulate import simulate
from varint.numerics.arrays import over_columns
from varint.results.trajectory import Trajectory
from varint.scene.expressions import in_own_symbols
from varint.scene.system import System, parameters_by_name
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
    """(q, p) where segments begin: coordinates and velocities that were measured by straight lines
    between the values, the others from the guessed run, or constant where it breaks off.
    """
    n, t = p.system.structure.n, motion.t0 + p.h * motion.cuts[1:-1]
    q, v = _run(p, motion, t)
    for i in range(n):
        places = _seen(p.system, motion, p.system.q[i])
        if places is not None:
            q[:, i] = np.interp(t, *places)
            around = p.h * np.diff(motion.cuts).min() / 2
            v[:, i] = (np.interp(t + around, *places) - np.interp(t - around, *places)) / (
                2 * around
            )
    for i in range(n):
        places = _seen(p.system, motion, p.system.v[i])
        if places is not None:
            v[:, i] = np.interp(t, *places)
    return np.hstack([q, over_columns(momentum_function(p.system), q, v, t[:, None], p.c)[0]])


def _seen(system: System, motion: Motion, symbol: ca.SX) -> tuple[np.ndarray, np.ndarray] | None:
    """Times and values of a symbol that was measured by itself."""
    for m in motion.data:
        column = _column_of(system, m, symbol)
        if column is not None:
            there = np.isfinite(m.values[:, column])
            order = np.argsort(m.t[there], kind="stable")
            if there.any():
                return m.t[there][order], m.values[there, column][order]
    return None


def _column_of(system: System, m: Measurement, symbol: ca.SX) -> int | None:
    own = ca.vec(ca.densify(in_own_symbols(m.expression, system)))
    same = (i for i in range(own.numel()) if ca.is_equal(own[i], symbol))
    return next(same, None)


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

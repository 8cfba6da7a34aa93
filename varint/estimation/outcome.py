"""From the solver's numbers to the record of a fit."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from varint.errors import SolverError
from varint.estimation.contact_runs import contact_run
from varint.estimation.information import information
from varint.estimation.noise import level_sigma
from varint.estimation.problem import Estimation, Motion
from varint.estimation.ray_rows import ray_row_count
from varint.estimation.residuals import parameters_at, start_of
from varint.estimation.result import Fit
from varint.estimation.search import Minimum, sizes
from varint.estimation.step_error import shift_by_half_steps
from varint.estimation.unidentified import in_words
from varint.integration.simulate import simulate
from varint.results.trajectory import Trajectory
from varint.scene.free import Free
from varint.scene.system import parameters_by_name


def fit_of(minimum: Minimum, levels: dict[int, Free]) -> Fit:
    """What a fit found, with its spread; `levels` are the measurements whose noise was unknown.

    Raises
    ------
    SolverError
        If round-off hides what the data tell.
    """
    p, solved = minimum.shoot.problem, minimum.solved
    z, found, held = solved.z, solved.found, solved.held
    size = sizes(p, z)
    told = information(found, size, held, p.many)
    if told.swamped:
        raise SolverError(
            "the motion amplifies changes of its start beyond what double precision can hold, so "
            "that the other unknowns cannot be told: take more segments",
            status="swamped",
        )
    c = parameters_at(p, z)
    starts = [np.split(start_of(p, m, e, z), 2) for e, m in enumerate(p.motions)]
    return Fit(
        p.names,
        z[: p.many].copy(),
        told.covariance,
        parameters_by_name(p.system, c),
        tuple(q for q, _ in starts),
        tuple(v for _, v in starts),
        tuple(
            _trajectory(p, m, x, q, v, c)
            for m, x, (q, v) in zip(p.motions, found.nodes, starts, strict=True)
        ),
        tuple(m.data for m in p.motions),
        _residuals_by_measurement(p, found.r),
        in_words(p, told.open, size, z),
        float(found.r @ found.r),
        len(found.r) - (p.many - len(told.open) - ray_row_count(p)),
        solved.converged,
        solved.steps,
        tuple(p.names[i] for i in np.flatnonzero(held[: p.many])),
        shift_by_half_steps(minimum, told.spread),
        _by_motion(p, level_sigma(minimum, levels)),
        minimum,
    )


def _by_motion(p: Estimation, spreads: dict[int, float]) -> tuple[tuple[float, ...], ...]:
    """What belongs to measurements by their places among all, NaN for the others."""
    rows, at = [], 0
    for motion in p.motions:
        rows.append(tuple(spreads.get(at + i, np.nan) for i in range(len(motion.data))))
        at += len(motion.data)
    return tuple(rows)


def _residuals_by_measurement(p: Estimation, r: np.ndarray) -> tuple[tuple[np.ndarray, ...], ...]:
    """In the shapes of their values, NaN where one is missing."""
    parts, at = [], 0
    for motion in p.motions:
        rows = []
        for m in motion.data:
            there = np.isfinite(m.values)
            row = np.full(m.values.shape, np.nan)
            row[there] = r[at : at + int(there.sum())]
            rows.append(row)
            at += int(there.sum())
        parts.append(tuple(rows))
    return tuple(parts)


def _trajectory(
    p: Estimation, motion: Motion, x: np.ndarray, q0: np.ndarray, v0: np.ndarray, c: np.ndarray
) -> Trajectory:
    """The motion with the nodes of all segments, which a single run may not reach; with contacts
    the run itself.
    """
    if p.system.structure.contacts:
        return contact_run(p, motion, q0, v0, c, "auto")
    n, params = p.system.structure.n, parameters_by_name(p.system, c)
    u = motion.u[:1] if motion.u.shape[2] else None
    first = simulate(
        p.system, p.rule, q0=q0, v0=v0, h=p.h, steps=1, t0=motion.t0, u=u, params=params
    )
    k = np.arange(motion.steps + 1)
    whole = replace(
        first,
        t=motion.t0 + p.h * k,
        q=x[:, :n].copy(),
        p=x[:, n:].copy(),
        k=k,
        u=motion.u,
        active_set=None if first.active_set is None else np.zeros(len(k), dtype=int),
    )
    whole.__dict__.pop("v", None)
    return whole

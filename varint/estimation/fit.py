"""Parameters, start values and biases from measurements of motions."""

from __future__ import annotations

import warnings
from dataclasses import replace
from typing import Any

import numpy as np

from varint.errors import InputError, SolverError
from varint.estimation.gauss_newton import loss_of, solve
from varint.estimation.information import in_words, information
from varint.estimation.measurement import Experiment, Measurement
from varint.estimation.problem import Estimation, Motion, estimation
from varint.estimation.residuals import (
    Residuals,
    Shooter,
    first_guess,
    residuals,
    shooter,
    start_of,
)
from varint.estimation.result import Fit
from varint.estimation.segments import guessed_states
from varint.integration.plan import plan
from varint.integration.simulate import simulate
from varint.results.trajectory import Trajectory
from varint.rules.rule import Rule
from varint.scene.parameters import ParameterValues
from varint.scene.system import System, parameters_by_name, require_system

TINY = 1e-3  # of a guess, or of the largest coordinate: smaller sizes are taken for this much


def fit(
    system: System,
    rule: Rule | None = None,
    *,
    data: Any,
    unknown: Any,
    h: float,
    q0: Any = None,
    v0: Any = None,
    t0: float = 0.0,
    u: Any = None,
    params: ParameterValues | None = None,
    segments: int = 1,
    priors: ParameterValues | None = None,
    huber: float | None = None,
    backend: str = "auto",
) -> Fit:
    """Parameters and start values that fit measurements best, min Σ ((ψ_j(q, v, t_j) − y_j)/σ_j)².

    Gauss–Newton on the discrete motion, whose derivatives are exact. With several segments the
    states between them are unknown too, and the motion is continuous only at the end (multiple
    shooting): motions on which no single run could be started come out.

    Parameters
    ----------
    system : System
    rule : Rule, optional
        Default: the scene's own.
    data : sequence of Measurement or of Experiment
        Of one motion, or of several that share their parameters.
    unknown : sequence or dict
        Parameters by name or symbol, ``"q0"``, ``"v0"``. In a dictionary with a guess, or a guess
        and bounds, ``{"g": vi.free(9.0, 1.0, 20.0)}``.
    h : float
        Step. Times of measurement need not be nodes: a shorter step of the same rule leads there.
    q0, v0, t0, u
        Start and controls as in `simulate`, guesses where they are unknown; with experiments each
        has its own.
    params : dict, optional
        Parameter values that differ from the defaults, guesses where they are unknown.
    segments : int
        Pieces of equal length of every motion.
    priors : dict, optional
        (mean, standard deviation) of parameters, from elsewhere.
    huber : float, optional
        Residuals beyond so many σ count linearly (Huber 1964): 1.5 bears outliers.
    backend : {"auto", "compiled", "interpreted"}
        As in `simulate`.

    Returns
    -------
    Fit
        Estimates, covariance, intervals, residuals, what the data leave open; `report()`, `plot()`.

    Raises
    ------
    InputError
        If the input is not a well-posed problem.
    ConvergenceError
        If the motion of the first guess cannot be run.
    SolverError
        If the iteration ends far from a solution, or round-off hides what the data tell.

    Notes
    -----
    Bock, Recent advances in parameter identification techniques for ODE, 1983 (multiple shooting,
    Gauss–Newton); Nocedal & Wright, Numerical Optimization, chapters 10 and 18.

    Examples
    --------
    >>> import casadi as ca
    >>> import numpy as np
    >>> import varint as vi
    >>> q, v = vi.coordinates("theta")
    >>> c = vi.Parameters(length=1.0)
    >>> pendulum = vi.System(q, v, c.length**2 * v**2 / 2 + 9.81 * c.length * ca.cos(q), params=c)
    >>> true = vi.simulate(pendulum, q0=1.0, v0=0.0, h=0.01, steps=200, params=dict(length=0.8))
    >>> seen = vi.Measurement(q, true.t[::20], true.q[::20, 0], sigma=1e-3)
    >>> found = vi.fit(pendulum, data=[seen], unknown=["length"], h=0.01, q0=1.0, v0=0.0)
    >>> round(float(found.params["length"]), 9)
    0.8
    """
    require_system(system)
    rule = plan(system, rule).rule
    experiments = _experiments(data, q0, v0, t0, u)
    if huber is not None and not (isinstance(huber, (int, float)) and huber > 0):
        raise InputError(f"huber must be a positive number of standard deviations, got {huber!r}")
    p = estimation(system, rule, experiments, unknown, h, params, segments, priors)
    shoot = shooter(p, backend)
    z = guessed_states(p, first_guess(p))
    lower, upper = _bounds(p)
    solved = solve(lambda x: residuals(shoot, x), z, lambda x: _sizes(p, x), lower, upper, huber)
    if not solved.converged:
        gap = np.abs(solved.found.d).max(initial=0.0)
        chi = 2 * loss_of(solved.found.r, None)
        raise SolverError(
            f"the fit did not converge in {solved.steps} steps (χ² {chi:.3g}, "
            f"gaps between segments {gap:.2g}): take other guesses, bounds, or more segments",
            status="not converged",
        )
    made = _result(shoot, solved.z, solved.found, solved.steps, solved.held)
    for sentence in made.unidentifiable:
        warnings.warn(sentence, stacklevel=2)
    return made


def _experiments(data: Any, q0: Any, v0: Any, t0: float, u: Any) -> list[Experiment]:
    given = [data] if isinstance(data, (Measurement, Experiment)) else list(data)
    several = [x for x in given if isinstance(x, Experiment)]
    if several and len(several) == len(given):
        if q0 is not None or v0 is not None or u is not None:
            raise InputError("experiments have their own q0, v0 and u: leave them out here")
        return several
    if several:
        raise InputError("data has Experiments beside Measurements: give the ones or the others")
    if q0 is None or v0 is None:
        raise InputError("give q0 and v0, the start of the motion, or guesses where it is unknown")
    return [Experiment(given, q0, v0, t0, u)]


def _bounds(p: Estimation) -> tuple[np.ndarray, np.ndarray]:
    many, wide = len(p.theta), np.full(p.size, np.inf)
    lower, upper = -wide, wide
    for bound, given in ((lower, p.lower), (upper, p.upper)):
        bound[:many] = given[:many]
        bound[many : p.many] = np.tile(given[many:], len(p.motions))
    return lower, upper


def _sizes(p: Estimation, z: np.ndarray) -> np.ndarray:
    """Typical sizes of the unknowns: of parameters their own, of states those of all of them; not
    far below the guesses, for what is zero has no size of its own.
    """
    size, many = np.ones(p.size), len(p.theta)
    size[:many] = np.maximum(np.abs(z[:many]), TINY * _or_one(np.abs(p.c[p.theta])))
    n = p.system.structure.n
    given = float(_or_one(np.array(max(np.abs(m.start).max() for m in p.motions))))
    for first, last, width in ((many, p.many, len(p.free)), (p.many, p.size, 2 * n)):
        if last > first:
            rows = np.abs(z[first:last]).reshape(-1, width)
            least = TINY * max(rows.max(), given)
            size[first:last] = np.tile(np.maximum(rows.max(axis=0), least), len(rows))
    return size


def _or_one(x: np.ndarray) -> np.ndarray:
    return np.where(x > 0, x, 1.0)


def _result(shoot: Shooter, z: np.ndarray, found: Residuals, steps: int, held: np.ndarray) -> Fit:
    p, size = shoot.problem, _sizes(shoot.problem, z)
    told = information(found.of_r, found.of_d, size, held, p.many)
    if told.swamped:
        raise SolverError(
            "the motion amplifies changes of its start beyond what double precision can hold, so "
            "that the other unknowns cannot be told: take more segments",
            status="swamped",
        )
    c = p.c.copy()
    c[p.theta] = z[: len(p.theta)]
    starts = [np.split(start_of(p, m, e, z), 2) for e, m in enumerate(p.motions)]
    measured = len(found.r) - len(p.prior)
    parts, at = [], 0
    for motion in p.motions:
        rows = []
        for m in motion.data:
            there = np.isfinite(m.values)
            r = np.full(m.values.shape, np.nan)
            r[there] = found.r[at : at + int(there.sum())]
            rows.append(r)
            at += int(there.sum())
        parts.append(tuple(rows))
    chi = float(found.r @ found.r)
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
        tuple(parts),
        in_words(p, told.open, z[: len(p.theta)]),
        chi,
        measured + len(p.prior) - (p.many - len(told.open)),
        True,
        steps,
        tuple(p.names[i] for i in np.flatnonzero(held[: p.many])),
    )


def _trajectory(
    p: Estimation, motion: Motion, x: np.ndarray, q0: np.ndarray, v0: np.ndarray, c: np.ndarray
) -> Trajectory:
    """The motion with the nodes of all segments, which a single run may not reach."""
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

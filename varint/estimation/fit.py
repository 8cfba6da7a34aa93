"""Parameters, start values and biases from measurements of motions."""

from __future__ import annotations

import warnings
from collections.abc import Iterable
from typing import Any

from varint.errors import InputError
from varint.estimation.chosen_step import (
    require_constant_controls,
    step_for,
    with_shorter_steps,
)
from varint.estimation.measurement import Experiment, Measurement
from varint.estimation.noise import fit_with_noise
from varint.estimation.outcome import fit_of
from varint.estimation.problem import Estimation, estimation
from varint.estimation.residuals import shooter
from varint.estimation.result import Fit
from varint.integration.plan import plan
from varint.numerics.progress import notice
from varint.rules.rule import Rule
from varint.scene.parameters import ParameterValues
from varint.scene.system import System, require_system


def fit(
    system: System,
    rule: Rule | None = None,
    *,
    data: Any,
    unknown: Any,
    h: float | None = None,
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
    shooting): motions on which no single run could be started come out. Where the data show all
    coordinates, Hamilton's principle along the measured motion gives a start of its own, by linear
    least squares for parameters that stand linearly in L and F; guesses far off do no harm then.
    Scenes with contacts are one run from its start, through impacts as they come, restitution a
    parameter (``System(restitution=c.e)``). Where no start meets the data, the first of them are
    fitted before all. Masses and moments of inertia stay positive. Noise levels
    that are not known (``Measurement(…, jitter=vi.free(…))``) are estimated with the motion, by
    restricted maximum likelihood.

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
    h : float, optional
        Step. Times of measurement need not be nodes: a shorter step of the same rule leads there.
        Where half of it would move an estimate by a tenth of its standard deviation a warning
        says so. Default: one with which the motion of the guess is right to a millionth, and
        halves of it while they would move an estimate by so much.
    q0, v0, t0, u
        Start and controls as in `simulate`, guesses where they are unknown; with experiments each
        has its own. q0 and v0 may be expressions of parameters, such as the elements of an orbit.
    params : dict, optional
        Parameter values that differ from the defaults, guesses where they are unknown.
    segments : int
        Pieces of equal length of every motion; 1 with contacts.
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
        Data that are not met come with a warning.

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
    Gauss–Newton); Nocedal & Wright, Numerical Optimization, chapters 10 and 18; Patterson &
    Thompson, Biometrika 58 (1971) 545 (noise levels by restricted likelihood).

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
    >>> found = vi.fit(pendulum, data=[seen], unknown=["length"], q0=1.0, v0=0.0)
    >>> round(float(found.params["length"]), 6)
    0.8
    """
    require_system(system)
    rule = plan(system, rule).rule
    experiments = _experiments(data, q0, v0, t0, u)
    if huber is not None and not (isinstance(huber, (int, float)) and huber > 0):
        raise InputError(f"huber must be a positive number of standard deviations, got {huber!r}")

    def problem(step: Any) -> Estimation:
        return estimation(system, rule, experiments, unknown, step, params, segments, priors)

    if h is None:
        require_constant_controls(system, rule, experiments)
    with notice("fitting"):
        p = problem(step_for(problem) if h is None else h)
        made = fit_of(*fit_with_noise(shooter(p, backend), huber))
        if h is None:
            made = with_shorter_steps(made, huber)
    for sentence in filter(None, (*made.unidentifiable, made.misfit, made.step_error)):
        warnings.warn(sentence, stacklevel=2)
    return made


def _experiments(data: Any, q0: Any, v0: Any, t0: float, u: Any) -> list[Experiment]:
    given = [data] if not isinstance(data, Iterable) else list(data)
    if not all(isinstance(x, (Measurement, Experiment)) for x in given):
        raise InputError(f"data must be Measurements, or Experiments, got {data!r}")
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

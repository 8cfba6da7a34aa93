"""Moving-horizon estimation set up from what the user wrote."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from varint.errors import InputError
from varint.estimation.estimate import Estimator
from varint.estimation.horizon import Arrival, Horizon, Observed, parts_of
from varint.estimation.problem import parameters_to_find, positive_inertias, prior_rows, unknowns
from varint.estimation.sensors import observed
from varint.integration.plan import plan
from varint.numerics.arrays import call
from varint.rules.rule import Rule
from varint.scene.inputs import finite_array, number, positive_integer, vector
from varint.scene.parameters import ParameterValues
from varint.scene.system import System, parameter_entries, require_system
from varint.sensitivities.start import momentum_function, momentum_slopes


def mhe(
    system: System,
    rule: Rule | None = None,
    *,
    h: float,
    horizon: int,
    measured: Any,
    sigma: Any,
    q0: Any,
    v0: Any,
    start_sigma: Any = None,
    disturbance: Any = 0.0,
    unknown: Any = (),
    priors: ParameterValues | None = None,
    params: ParameterValues | None = None,
    t0: float = 0.0,
    huber: float | None = None,
) -> Estimator:
    """An estimator that looks back: the motion of the last N steps that fits what was measured,
    min |arrival|² + Σ ((ψ(x_k) − y_k)/σ)² + Σ (w_k/σ_w)², x_{k+1} = Φ(x_k, u_k) + w_k.

    The counterpart of `mpc`: built once, called at every step with what was measured, warm from its
    last answer. Data that leave the horizon are kept as an arrival cost, linearised as in an
    extended Kalman filter; for a linear scene its estimates are the Kalman filter's.

    Parameters
    ----------
    system : System
        With constraints the estimates keep to them, and so does what disturbances leave.
    rule : Rule, optional
        Default: the scene's own.
    h : float
        Step, from one measurement to the next.
    horizon : int
        Steps N to look back.
    measured : SX (o,)
        ψ, what the sensors show, of q, v, t and parameters.
    sigma : float or array (o,)
        Standard deviations of the sensors' noise.
    q0, v0 : array (n,)
        A guess of the state at the first measurement.
    start_sigma : float or array (2n,), optional
        Standard deviations of that guess, of q0 then v0; default: nothing is known.
    disturbance : float or array (n,)
        Standard deviations of the momentum that unknown forces add during a step; 0 where there are
        none. It says how far to trust the scene.
    unknown : sequence or dict
        Parameters to be estimated beside the state, as in `fit`.
    priors : dict, optional
        (mean, standard deviation) of parameters.
    params : dict, optional
        Parameter values that differ from the defaults.
    t0 : float
        Time of the first measurement.
    huber : float, optional
        As in `fit`, for sensors with outliers.

    Returns
    -------
    Estimator
        Call it with what was measured: ``estimate = estimator(y, u, estimate)``.

    Raises
    ------
    InputError
        If the scene has contacts or non-holonomic rows, or the numbers do not fit it; if
        constraints depend on what is unknown, or some coordinates alone are disturbed beside any.

    Notes
    -----
    Rao, Rawlings & Mayne, IEEE Trans. Automatic Control 48 (2003) 246 (moving-horizon estimation);
    Kühl et al., Computers & Chemical Engineering 35 (2011) 71 (arrival cost, multiple shooting).

    Examples
    --------
    >>> import casadi as ca
    >>> import varint as vi
    >>> q, v = vi.coordinates("theta")
    >>> pendulum = vi.System(q, v, v**2 / 2 + 9.81 * ca.cos(q))
    >>> look = vi.mhe(pendulum, h=0.05, horizon=10, measured=q, sigma=0.01, q0=0.0, v0=0.0)
    >>> true = vi.simulate(pendulum, q0=1.0, v0=0.5, h=0.05, steps=40)
    >>> estimate = None
    >>> for angle in true.q[:, 0]:
    ...     estimate = look(angle, previous=estimate)
    >>> abs(float(estimate.v[0] - true.v[-1, 0])) < 1e-6
    True
    """
    require_system(system)
    s, n = system.structure, system.structure.n
    if s.contacts or s.degenerate or s.nonholonomic:
        raise InputError(
            "mhe takes scenes without contacts and non-holonomic rows whose Lagrangian is regular "
            "in the velocities; with contacts take fit, of whole motions: states that vary from "
            "node to node would pass through what is closed"
        )
    if number("h", h) <= 0:
        raise InputError(f"h must be positive, got {h!r}")
    if huber is not None and not (isinstance(huber, (int, float)) and huber > 0):
        raise InputError(f"huber must be a positive number of standard deviations, got {huber!r}")
    chosen, sensor = plan(system, rule).rule, observed(system, measured)
    wanted = unknowns(system, unknown) if len(unknown) else {}
    if given := {"q0", "v0"} & set(wanted):
        raise InputError(f"mhe estimates the state anyhow: leave {sorted(given)} out of unknown")
    c, theta, low, high = parameters_to_find(system, wanted, params)
    q, v = vector("q0", q0, n, system.names), vector("v0", v0, n, system.names)
    low = positive_inertias(system, theta, low, c, np.concatenate([q, v]))
    spread = _spreads("disturbance", disturbance, n, -1.0)
    _require_known_rows(system, theta, spread)
    scene = Observed(
        system,
        chosen,
        float(h),
        sensor,
        _spreads("sigma", sigma, sensor.size1_out(0), 0.0),
        spread,
        c,
        np.array(theta, dtype=int),
        np.array(low),
        np.array(high),
        huber,
    )
    begin = np.array([number("t0", t0)])
    p = call(momentum_function(system), q, v, begin, c)[0]
    z = np.concatenate([c[theta], q, p])
    arrival = _first_arrival(scene, z, v, begin, start_sigma, prior_rows(system, priors, theta))
    empty = np.empty((0, len(chosen.nodes) * s.controls))
    start = Horizon(arrival, begin, np.full((1, len(scene.sigma)), np.nan), empty, z)
    return Estimator(scene, start, positive_integer("horizon", horizon))


def _require_known_rows(system: System, theta: list[int], disturbance: np.ndarray) -> None:
    """Constraints that hold whatever is estimated, and that disturbances can keep to."""
    s = system
    if not s.structure.constraints:
        return
    entries = parameter_entries(s)
    moved = ca.which_depends(s.constraint, s.c, 1, False) if theta else []
    if named := [entries[i] for i in theta if moved[i]]:
        raise InputError(f"constraints depend on {named}: mhe takes them as known")
    if (disturbance > 0).any() and not (disturbance > 0).all():
        raise InputError(
            "with constraints disturbance must be positive for all coordinates or for none: "
            "reactions pass on what acts on one of them"
        )


def _spreads(what: str, given: Any, count: int, least: float) -> np.ndarray:
    """Standard deviations, one each, above `least`."""
    value = finite_array(what, given)
    if value.shape not in ((), (count,)) or (value <= least).any() or (value < 0).any():
        raise InputError(f"{what} must be a positive number, or {count} of them, got {given!r}")
    return np.array(np.broadcast_to(value, (count,)))


def _first_arrival(
    scene: Observed,
    z: np.ndarray,
    v: np.ndarray,
    t: np.ndarray,
    start_sigma: Any,
    priors: np.ndarray,
) -> Arrival:
    """What is known before the first measurement, as rows on (θ, q, p)."""
    many, n = len(scene.theta), len(v)
    rows = np.zeros((len(priors), len(z)))
    rows[np.arange(len(priors)), priors[:, 0].astype(int)] = 1 / priors[:, 2]
    s = priors[:, 1] / priors[:, 2]
    if start_sigma is None:
        return Arrival(rows, s)
    spread = _spreads("start_sigma", start_sigma, 2 * n, 0.0)
    q, c = z[many : many + n], parts_of(scene, z)[0]
    flat = call(momentum_slopes(scene.system), q, v, t, c)
    of_q, of_v, of_c, _ = (x.reshape(-1, n).T for x in flat)
    back = np.linalg.inv(of_v)  # v = v0 + back (p − p0 − of_q (q − q0) − of_c (θ − θ0))
    known = np.zeros((2 * n, len(z)))
    known[:n, many : many + n] = np.eye(n)
    known[n:] = back @ np.hstack([-of_c[:, scene.theta], -of_q, np.eye(n)])
    known /= spread[:, None]
    return Arrival(np.vstack([rows, known]), np.concatenate([s, known @ z]))

"""Moving-horizon estimation: the state now from what was measured lately."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from varint.errors import InputError, SolverError
from varint.estimation.gauss_newton import Solved, solve
from varint.estimation.horizon import Arrival, Horizon, Observed, deviations, moved_on, parts_of
from varint.estimation.information import NEGLIGIBLE, directions
from varint.estimation.problem import parameters_to_find, positive_inertias, prior_rows, unknowns
from varint.estimation.sensors import observed
from varint.integration.plan import plan
from varint.integration.problem import controls
from varint.integration.step_function import step_function
from varint.numerics.arrays import call
from varint.rules.rule import Rule
from varint.scene.inputs import finite_array, number, positive_integer, vector
from varint.scene.parameters import ParameterValues
from varint.scene.system import System, parameter_entries, parameters_by_name, require_system
from varint.sensitivities.pieces import velocities
from varint.sensitivities.start import momentum_function, momentum_slopes, output_slopes

TINY = 1e-3  # of the largest: smaller sizes of coordinates and parameters are taken for this much


@dataclass(frozen=True, eq=False, repr=False)
class Estimate:
    """The state now, and what it was found from.

    Attributes
    ----------
    t : float
    q, v : ndarray (n,)
        Coordinates and velocities now.
    covariance : ndarray (2n, 2n)
        Of (q, v), by the linearised problem; infinite on the diagonal where the data tell nothing.
    params : dict of ndarray
        All parameters of the scene, the estimated ones put in.
    sigma_params : dict of float
        Standard deviations of the estimated ones, by their entries' names.
    times : ndarray (N + 1,)
        Nodes of the horizon.
    path : ndarray (N + 1, 2n)
        (q, v) there, smoothed: with all data until now.
    steps : int
        Gauss–Newton steps.
    scene : Observed
    horizon : Horizon
        What the next estimate starts from.
    """

    t: float
    q: np.ndarray
    v: np.ndarray
    covariance: np.ndarray
    params: dict[str, np.ndarray]
    sigma_params: dict[str, float]
    times: np.ndarray
    path: np.ndarray
    steps: int
    scene: Observed
    horizon: Horizon

    def __repr__(self) -> str:
        spread = np.sqrt(np.diag(self.covariance))
        parts = ", ".join(
            f"{x:.6g}±{s:.2g}" for x, s in zip([*self.q, *self.v], spread, strict=True)
        )
        return f"Estimate(t={self.t:.6g}: {parts})"


@dataclass(frozen=True, eq=False)
class Estimator:
    """A scene observed step after step; `mhe` makes it.

    Attributes
    ----------
    scene : Observed
        Scene, sensors and spreads.
    first : Horizon
        The first node with what is known of it.
    length : int
        Steps of the horizon.
    """

    scene: Observed
    first: Horizon
    length: int

    def __call__(self, y: Any, u: Any = None, previous: Estimate | None = None) -> Estimate:
        """The estimate at the time of a measurement.

        Parameters
        ----------
        y : float or array (o,)
            What was measured now; NaN where nothing was.
        u : array (k,) or (r, k), optional
            Controls of the step that ended now; of the first measurement none.
        previous : Estimate, optional
            The last answer of this estimator, one step earlier; the first has none.

        Returns
        -------
        Estimate

        Raises
        ------
        InputError
            If y or u do not fit the scene.
        SolverError
            If the iteration ends far from a solution.
        """
        scene = self.scene
        measured = np.array(y, dtype=float).reshape(-1)
        if measured.shape != scene.sigma.shape or np.isinf(measured).any():
            raise InputError(
                f"y must be {len(scene.sigma)} numbers, NaN where nothing was measured; got {y!r}"
            )
        if previous is None:
            if u is not None:
                raise InputError("the first measurement has no step before it: leave u out")
            horizon = self.first._replace(y=measured[None])
        else:
            horizon = self._longer(previous, measured, u)
        free = np.full(len(horizon.z) - len(scene.theta), np.inf)
        solved = solve(
            lambda z: deviations(scene, horizon, z),
            horizon.z,
            lambda z: _sizes(scene, z),
            np.concatenate([scene.lower, -free]),
            np.concatenate([scene.upper, free]),
            scene.huber,
        )
        if not solved.converged:
            raise SolverError(
                f"no estimate at t = {horizon.t[-1]:.6g}: the iteration did not converge in "
                f"{solved.steps} steps; take a shorter horizon, a smaller h, or huber=1.5 where "
                "sensors have outliers",
                status="not converged",
            )
        return _estimate(scene, horizon._replace(z=solved.z), solved)

    def _longer(self, previous: Estimate, y: np.ndarray, u: Any) -> Horizon:
        """The horizon with one more step, and without its first where it is long enough."""
        if not isinstance(previous, Estimate) or previous.scene is not self.scene:
            raise InputError("previous= takes the last answer of this estimator")
        scene, horizon = self.scene, previous.horizon
        if len(horizon.u) >= self.length:
            horizon = moved_on(scene, horizon)
        c, x = parts_of(scene, horizon.z)
        given = np.array(u, dtype=float)[None] if np.ndim(u) == 2 else u
        held = controls(scene.system, scene.rule, given, 1)
        nodes = np.broadcast_to(held, (1, len(scene.rule.nodes), held.shape[2])).reshape(1, -1)
        q, p = np.split(x[-1], 2)
        step = step_function(scene.system, scene.rule)
        end = call(step, q, p, nodes, c, horizon.t[-1:], np.array([scene.h]))[:2]
        return Horizon(
            horizon.arrival,
            np.append(horizon.t, horizon.t[-1] + scene.h),
            np.vstack([horizon.y, y]),
            np.vstack([horizon.u, nodes]),
            np.concatenate([horizon.z, *end]),
        )


def _sizes(scene: Observed, z: np.ndarray) -> np.ndarray:
    """Typical sizes of the unknowns: of parameters their own, of states those of all nodes."""
    many, x = len(scene.theta), parts_of(scene, z)[1]
    theta = np.maximum(np.abs(z[:many]), TINY * np.abs(scene.c[scene.theta]))
    rows = np.abs(x).max(axis=0)
    rows = np.maximum(rows, TINY * rows.max())
    size = np.concatenate([theta, np.tile(rows, len(x))])
    return np.where(size > 0, size, 1.0)


def _estimate(scene: Observed, horizon: Horizon, solved: Solved) -> Estimate:
    """The record of a solved horizon, in coordinates and velocities."""
    c, x = parts_of(scene, horizon.z)
    system, many, width = scene.system, len(scene.theta), x.shape[1]
    spread, left, _ = directions(solved.found, _sizes(scene, horizon.z), solved.held)
    blind = (np.abs(left) > NEGLIGIBLE).any(axis=0)
    q, p = np.split(x, 2, axis=1)
    v = velocities(system, x, horizon.t, c)
    flat = call(output_slopes(system), q[-1], p[-1], horizon.t[-1:], c)
    of_x, of_c = (y.reshape(-1, width).T for y in flat[:2])
    slope = np.hstack([of_c[:, scene.theta], of_x])
    last = np.r_[:many, len(horizon.z) - width : len(horizon.z)]
    own = slope @ spread[last]
    covariance = own @ own.T
    open_ones = (np.abs(slope[:, blind[last]]) > 0).any(axis=1)
    covariance[open_ones, open_ones] = np.inf
    deviation = np.where(blind[:many], np.inf, np.sqrt((spread[:many] ** 2).sum(axis=1)))
    names = [parameter_entries(system)[i] for i in scene.theta]
    return Estimate(
        float(horizon.t[-1]),
        q[-1].copy(),
        v[-1].copy(),
        covariance,
        parameters_by_name(system, c),
        dict(zip(names, deviation.tolist(), strict=True)),
        horizon.t,
        np.hstack([q, v]),
        solved.steps,
        scene,
        horizon,
    )


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
        If the scene has contacts or constraints, or the numbers do not fit it.

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
    if s.contacts or s.degenerate or s.constraints or s.nonholonomic:
        raise InputError(
            "mhe takes scenes without contacts and constraints whose Lagrangian is regular in the "
            "velocities; write constrained scenes in coordinates that are free"
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
    scene = Observed(
        system,
        chosen,
        float(h),
        sensor,
        _spreads("sigma", sigma, sensor.size1_out(0), 0.0),
        _spreads("disturbance", disturbance, n, -1.0),
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

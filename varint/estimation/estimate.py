"""The state now from what was measured lately: an estimator, and what it answers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from varint.errors import InputError, SolverError
from varint.estimation.gauss_newton import Solved, solve
from varint.estimation.horizon import Horizon, Observed, deviations, moved_on, parts_of
from varint.estimation.information import NEGLIGIBLE, directions
from varint.integration.problem import controls
from varint.integration.step_function import step_function
from varint.numerics.arrays import call
from varint.scene.system import parameter_entries, parameters_by_name
from varint.sensitivities.pieces import velocities
from varint.sensitivities.start import output_slopes

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

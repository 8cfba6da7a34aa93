"""Geodesics as free motion: a metric becomes a Lagrangian."""

from __future__ import annotations

import casadi as ca

from varint.errors import InputError, parsed_or_refused
from varint.scene.parameters import Parameters, ParameterValues
from varint.scene.system import System
from varint.scene.validation import symbols


def geodesic(
    q: ca.SX, v: ca.SX, metric: ca.SX, *, params: Parameters | ParameterValues | None = None
) -> System:
    """Free motion on a manifold, L = ½ vᵀ G(q) v: its paths are geodesics, run through at constant
    speed.

    Between fixed ends the length of a path is ``sqrt(2 * path.action * path.duration)``.

    Parameters
    ----------
    q, v : SX (n,)
        Coordinates and velocities.
    metric : SX (n, n) or (k,)
        The metric tensor G(q), or the position x(q) in space, whose induced metric is G = (∂x/∂q)ᵀ
        ∂x/∂q.
    params : Parameters or dict, optional
        As for `System`.

    Returns
    -------
    System

    Raises
    ------
    InputError
        If `metric` is neither an n × n matrix nor a column.

    Examples
    --------
    >>> import casadi as ca
    >>> import numpy as np
    >>> import varint as vi
    >>> q, v = vi.coordinates("theta", "phi")
    >>> place = ca.vertcat(ca.sin(q[0]) * ca.cos(q[1]), ca.sin(q[0]) * ca.sin(q[1]), ca.cos(q[0]))
    >>> sphere = vi.geodesic(q, v, place)
    >>> path = vi.least_action(
    ...     sphere, vi.gauss(4), q_start=[1.0, 0.0], q_end=[1.0, 1.0], duration=1.0, steps=20)
    >>> chord = 2 * np.sin(1.0) * np.sin(0.5)
    >>> abs(np.sqrt(2 * path.action) - 2 * np.arcsin(chord / 2)) < 1e-12
    np.True_
    """
    q = symbols("q", q)
    n = q.numel()
    metric = parsed_or_refused(
        lambda: ca.SX(metric),
        lambda: f"the metric must be a CasADi SX expression, got {type(metric).__name__}",
    )
    if metric.shape[1] == 1 and (n > 1 or metric.shape[0] > 1 or metric.shape != (n, n)):
        slope = ca.jacobian(metric, q)
        metric = ca.mtimes(slope.T, slope)
    if metric.shape != (n, n):
        raise InputError(
            f"the metric has shape {metric.shape}; it must be ({n}, {n}), or a column (position in "
            "space)"
        )
    return System(q, v, ca.bilin(metric, v, v) / 2, params=params)

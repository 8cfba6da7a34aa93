"""The start of a discrete path from its first two configurations, for those who think in (q0,
q1).
"""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from varint.discrete.constraints import tangent_function
from varint.discrete.lagrangian import point_function
from varint.errors import InputError
from varint.integration.plan import plan
from varint.integration.step_function import step_function
from varint.numerics.arrays import call
from varint.numerics.limits import SHOOTING_ITERATIONS
from varint.rules.rule import Rule
from varint.scene.inputs import number, vector
from varint.scene.memory import per_system
from varint.scene.parameters import ParameterValues
from varint.scene.system import System, parameter_values

REACHED = 1e-13  # of the size of the coordinates


def start_momentum(
    system: System,
    rule: Rule | None = None,
    *,
    q0: Any,
    q1: Any,
    h: float,
    t0: float = 0.0,
    params: ParameterValues | None = None,
) -> np.ndarray:
    """Momentum p0 = −D1 L_d(q0, q1) with which one step of size h leads from q0 to q1; controls are
    zero.

    With constraints, the one that fits the hidden constraint: ``simulate(..., q0=q0, p0=p0, h=h)``
    passes through q1.

    Parameters
    ----------
    system : System
    rule : Rule, optional
        Default: the scene's own.
    q0, q1 : array (n,)
        The first two configurations, both on the constraints.
    h, t0 : float
        Step size and start time.
    params : dict, optional
        Parameter values that differ from the defaults, by name or symbol.

    Returns
    -------
    ndarray (n,)

    Raises
    ------
    InputError
        If no momentum leads from q0 to q1: q1 is off the constraints, or too far for a step of h.

    References
    ----------
    Marsden & West, Acta Numerica 2001, §1.5: the discrete Legendre transform.

    Examples
    --------
    >>> import varint as vi
    >>> q, v = vi.coordinates("x")
    >>> free = vi.System(q, v, 3 * v**2 / 2)
    >>> vi.start_momentum(free, vi.midpoint(), q0=0.0, q1=0.2, h=0.1)
    array([6.])
    """
    chosen, n = plan(system, rule).rule, system.structure.n
    start, end = vector("q0", q0, n, system.names), vector("q1", q1, n, system.names)
    c, t, step = (
        parameter_values(system, params),
        np.array([number("t0", t0)]),
        np.array([number("h", h)]),
    )
    if not step.any():
        raise InputError("h must not be zero")
    u = np.zeros(system.structure.controls * len(chosen.nodes))
    p = np.asarray(point_function(system)(start, (end - start) / h, 0, t, c)[1]).ravel()
    tangent = (
        tangent_function(system)
        if system.structure.constraints or system.structure.nonholonomic
        else None
    )
    size = max(np.abs(start).max(), np.abs(end).max())
    miss = np.full(n, np.inf)
    for _ in range(SHOOTING_ITERATIONS):
        if tangent is not None:
            p = p + call(tangent, start, p, t, c)[1]
        reached, slope = call(_shot(system, chosen), start, p, u, c, t, step)
        if not np.isfinite(reached).all():
            break
        miss = end - reached
        if np.abs(miss).max() <= REACHED * size:
            return p
        p = p + np.linalg.lstsq(slope.reshape(n, n).T, miss, rcond=1e-10)[0]
    raise InputError(
        f"no start momentum leads from q0 to q1 in one step of h={h:g} (missed by "
        f"{np.abs(miss).max():.1e}); both must lie on the constraints, and near each other"
    )


@per_system
def _shot(system: System, rule: Rule) -> ca.Function:
    """(q0, p0, u, c, t, h) → (q1, ∂q1/∂p0)."""
    one = step_function(system, rule)
    inputs = [ca.MX.sym(one.name_in(i), one.numel_in(i)) for i in range(one.n_in())]
    shaped = [ca.reshape(x, *one.size_in(i)) for i, x in enumerate(inputs)]
    q1 = one.call(shaped)[0]
    return ca.Function("shot", inputs, [q1, ca.densify(ca.jacobian(q1, inputs[1]))])

"""What sensors show of states, with its derivatives."""

from __future__ import annotations

import casadi as ca
import numpy as np

from varint.numerics.arrays import over_columns
from varint.scene.system import System
from varint.sensitivities.start import state_function


def observed(system: System, expression: ca.SX) -> ca.Function:
    """(q, p, t, c) → an expression and its derivatives with respect to (q, p) and c."""
    value = state_function(system, expression)
    inputs = [ca.MX.sym(f"a{i}", value.numel_in(i)) for i in range(4)]
    q, p, _, c = inputs
    out = value(*inputs)
    slopes = [ca.densify(ca.jacobian(out, x)) for x in (ca.vertcat(q, p), c)]
    return ca.Function("observed", inputs, [ca.densify(out), *slopes])


def seen_by(
    sensor: ca.Function, x: np.ndarray, t: np.ndarray, c: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Values at states (q, p), (T, o), and their derivatives by the states (T, o, 2n) and by the
    parameters (T, o, C).
    """
    n = x.shape[1] // 2
    value, of_x, of_c = over_columns(sensor, x[:, :n], x[:, n:], t[:, None], c)
    count, o = value.shape
    by_x, by_c = (y.reshape(count, -1, o).transpose(0, 2, 1) for y in (of_x, of_c))
    return value, by_x, by_c

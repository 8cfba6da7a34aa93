"""Single steps of the discrete motion from many states at once, with their derivatives."""

from __future__ import annotations

import numpy as np

from varint.integration.step_function import step_function
from varint.numerics.arrays import over_columns
from varint.rules.rule import Rule
from varint.scene.system import System
from varint.sensitivities.linear_steps import linear_step
from varint.sensitivities.pieces import velocities


def single_steps(
    system: System,
    rule: Rule,
    x: np.ndarray,
    t: np.ndarray,
    h: np.ndarray,
    u: np.ndarray,
    c: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Ends of steps of sizes h (T,) from states (q, p), (T, 2n), at times t (T,) with the controls
    of all nodes u (T, nodes k); their derivatives by the states (T, 2n, 2n) and by the parameters
    (T, 2n, C).
    """
    n, when, size = system.structure.n, t[:, None], h[:, None]
    found = over_columns(step_function(system, rule), x[:, :n], x[:, n:], u, c, when, size)
    end = np.hstack(found[:2])
    v, v1 = velocities(system, x, t, c), velocities(system, end, t + h, c)
    phi, outside, _ = over_columns(linear_step(system, rule), x, end, v, v1, when, size, u, c)
    by_state = phi.reshape(len(x), 2 * n, 2 * n).transpose(0, 2, 1)
    by_outside = outside.reshape(len(x), -1, 2 * n).transpose(0, 2, 1)
    return end, by_state, by_outside[:, :, : len(c)]

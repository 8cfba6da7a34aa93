"""Single steps of the discrete motion from many states at once, with changes carried over them."""

from __future__ import annotations

import numpy as np

from varint.integration.backend import kernel_for
from varint.integration.problem import InitialValueProblem
from varint.integration.step_function import step_function
from varint.numerics.arrays import over_columns
from varint.rules.rule import Rule
from varint.scene.system import System
from varint.sensitivities.linear_steps import linear_step
from varint.sensitivities.pieces import Piece, velocities
from varint.sensitivities.steps_at_once import Directions, Sweeper
from varint.sensitivities.sweeps import carried

MANY = 10**7  # steps: the loop is chosen as for a long run


def carried_steps(
    by: Sweeper,
    x: np.ndarray,
    t: np.ndarray,
    h: np.ndarray,
    u: np.ndarray,
    c: np.ndarray,
    tangent: np.ndarray,
    of_c: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Ends of steps of sizes h (T,) from states (q, p), (T, 2n), at times t (T,) with the controls
    of all nodes u (T, nodes k), and changes there (T, 2n, m), from those of the states (T, 2n, m)
    and of the parameters (C, m).
    """
    found = _by_loops(by, x, t, h, u, c) if by.kernels else None
    if found is None:
        end, by_state, by_c = single_steps(by.system, by.rule, x, t, h, u, c)
        return end, by_state @ tangent + by_c @ of_c
    (end, v1), v = found, velocities(by.system, x, t, c)
    ends, speeds = np.stack([x, end], 1), np.stack([v, v1], 1)
    controls = u.reshape(len(x), 1, len(by.rule.nodes), -1)
    directions = Directions(np.vstack([of_c, np.zeros((2, of_c.shape[1]))]))
    moved = np.empty_like(tangent)
    for k in range(len(x)):
        one = slice(k, k + 1)
        piece = Piece(0, 1, 0, ends[k], speeds[k], t[one], h[one], controls[k], np.array([0, 1]))
        moved[k] = carried(by, piece, c, directions, np.ascontiguousarray(tangent[k]))
    return end, moved


def _by_loops(
    by: Sweeper, x: np.ndarray, t: np.ndarray, h: np.ndarray, u: np.ndarray, c: np.ndarray
) -> tuple[np.ndarray, np.ndarray] | None:
    """Ends (q, p) and velocities there by the run's own loop; None where it has none, or fails."""
    from varint.codegen.kernel import take_parts

    n, nodes = by.system.structure.n, len(by.rule.nodes)
    held = u.reshape(len(x), nodes, -1)
    run = InitialValueProblem(x[0, :n], x[0, n:], t[0], h[0], MANY, 1, held, c, nodes)
    kernel = kernel_for(by.system, by.rule, run, "auto")
    if kernel is None:
        return None
    rows, good = take_parts(kernel, x[:, :n], x[:, n:], c, t=t, h=h, u=u)
    if not good.all():
        return None
    return np.hstack([rows[:, 0], rows[:, 1]]), rows[:, 2]


def single_steps(
    system: System,
    rule: Rule,
    x: np.ndarray,
    t: np.ndarray,
    h: np.ndarray,
    u: np.ndarray,
    c: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The same ends; their derivatives by the states (T, 2n, 2n) and by the parameters (T, 2n, C),
    all by CasADi at once.
    """
    n, when, size = system.structure.n, t[:, None], h[:, None]
    found = over_columns(step_function(system, rule), x[:, :n], x[:, n:], u, c, when, size)
    end = np.hstack(found[:2])
    v, v1 = velocities(system, x, t, c), velocities(system, end, t + h, c)
    phi, outside, _ = over_columns(linear_step(system, rule), x, end, v, v1, when, size, u, c)
    by_state = phi.reshape(len(x), 2 * n, 2 * n).transpose(0, 2, 1)
    by_outside = outside.reshape(len(x), -1, 2 * n).transpose(0, 2, 1)
    return end, by_state, by_outside[:, :, : len(c)]

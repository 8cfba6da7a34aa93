"""Runs in fictitious time: their derivatives are those of the rescaled motion, whose clock is one
more coordinate, taken to nodes at given physical times.

The energy level E0 of the rescaled scene, or the one that the momentum of its clock begins with, is
a function of the start; its slowest rate and its grid are choices, which stay.
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from varint.numerics.arrays import call, over_columns
from varint.results.trajectory import Trajectory
from varint.scene.memory import per_system
from varint.scene.system import System
from varint.sensitivities.start import rate_function, slopes_of

LEVEL = 2  # the place of E0 among the last of the rescaled scene's parameters


def inner_of(motion: Trajectory) -> Trajectory:
    """The motion in the time of its steps: the same, where that is physical."""
    return motion if motion.fictitious is None else motion.fictitious


def inner_start(
    motion: Trajectory, tangent: np.ndarray, outer: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Changes of the rescaled start and of what stays, from those of (q, p) (2n, m) and of (c, h,
    t0) (C + 2, m).
    """
    inner, n, many = inner_of(motion), motion.q.shape[1], len(motion.c)
    m, all_of_them = tangent.shape[1], inner.q.shape[1]
    begin = np.zeros((2 * all_of_them, m))
    begin[:n], begin[all_of_them : all_of_them + n] = tangent[:n], tangent[n:]
    stays = np.zeros((len(inner.c) + 2, m))
    of_x, of_c = _level_slopes(motion)
    stays[:many], stays[len(inner.c)] = outer[:many], outer[many]
    level = of_x @ tangent + of_c @ outer[:many]
    stays[len(inner.c) - LEVEL] = level
    if _accounts(motion):
        begin[-1] = -level
    return begin, stays


def _accounts(motion: Trajectory) -> bool:
    """Whether the momentum of the clock keeps account of the energy."""
    return inner_of(motion).q.shape[1] > motion.q.shape[1] + 1


def pulled_to_start(motion: Trajectory, z: np.ndarray) -> np.ndarray:
    """Derivatives by (q, p, t, c, h, t0), from those by the rescaled z: the transpose of
    `inner_start`.
    """
    inner, n, many = inner_of(motion), motion.q.shape[1], len(motion.c)
    all_of_them = inner.q.shape[1]
    x, stays = z[: 2 * all_of_them], z[2 * all_of_them + 1 :]
    level, (of_x, of_c) = stays[len(inner.c) - LEVEL], _level_slopes(motion)
    if _accounts(motion):
        level = level - x[-1]
    of_start = np.concatenate([x[:n], x[all_of_them : all_of_them + n]]) + level * of_x
    of_params = stays[:many] + level * of_c
    return np.concatenate([of_start, [0.0], of_params, [stays[len(inner.c)], 0.0]])


def _level_slopes(motion: Trajectory) -> tuple[np.ndarray, np.ndarray]:
    """∂E0/∂(q, p) and ∂E0/∂c."""
    function = _energy_slopes(motion.system)
    of_x, of_c, _ = call(function, motion.q[0], motion.p[0], motion.t[:1], motion.c)
    return of_x, of_c


@per_system
def _energy_slopes(system: System) -> ca.Function:
    return slopes_of(system, system.energy)


def clock_rates(motion: Trajectory) -> np.ndarray:
    """d(q, p)/dt at every node, (N + 1, 2n), as the rescaled motion has it."""
    inner, n = inner_of(motion), motion.q.shape[1]
    none = np.empty((len(inner), 0))
    at = inner.q, inner.p, inner.t[:, None], none, inner.c
    rates = over_columns(rate_function(inner.system), *at)[0]
    clock = inner.q.shape[1] - 1
    momenta = rates[:, clock + 1 : clock + 1 + n]
    return np.hstack([rates[:, :n], momenta]) / rates[:, clock : clock + 1]


def at_given_times(motion: Trajectory, change: np.ndarray) -> np.ndarray:
    """Changes of (q, p, t) at the nodes' physical times, (N + 1, 2n + 1, m), from those of the
    rescaled motion at fixed fictitious times.
    """
    n, clock = motion.q.shape[1], inner_of(motion).q.shape[1] - 1
    x = np.concatenate([change[:, :n], change[:, clock + 1 : clock + 1 + n]], 1)
    x = x - clock_rates(motion)[:, :, None] * change[:, clock, None]
    return np.concatenate([x, np.zeros((len(x), 1, x.shape[2]))], 1)


def rescaled_seeds(motion: Trajectory, seeds: np.ndarray) -> np.ndarray:
    """Derivatives by the rescaled (q, clock, p, …) of the last nodes from those by (q, p): the
    transpose of `at_given_times`.
    """
    n, clock = motion.q.shape[1], inner_of(motion).q.shape[1] - 1
    inner = np.zeros((len(seeds), 2 * clock + 3))
    inner[:, :n], inner[:, clock + 1 : clock + 1 + n] = seeds[:, :n], seeds[:, n : 2 * n]
    inner[:, clock] = -(seeds[:, : 2 * n] * clock_rates(motion)[-len(seeds) :]).sum(1)
    return inner


def in_rescaled_symbols(motion: Trajectory, expression: ca.SX) -> ca.SX:
    """An expression of q, v, t, c in the symbols of the rescaled scene."""
    own, inner, n = motion.system, inner_of(motion), motion.q.shape[1]
    moving, start = inner.system, float(motion.t[0] - inner.q[0, -1])
    before = ca.vertcat(own.q, own.v, own.t, own.c)
    after = ca.vertcat(
        moving.q[:n], moving.v[:n] / moving.v[-1], moving.q[-1] + start, moving.c[: own.c.numel()]
    )
    return ca.substitute(expression, before, after)


def rescaled_loss(motion: Trajectory, loss: ca.SX) -> ca.SX:
    """ℓ dt/dτ."""
    return in_rescaled_symbols(motion, loss) * inner_of(motion).system.v[-1]

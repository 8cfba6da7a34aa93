"""What may have changed the energy of a motion: forces, explicit time, constraints that move,
impacts.

dH/dt = F·v − ∂L/∂t + λ·W v, where W v + w = 0: constraints that stand still do no work.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import casadi as ca
import numpy as np

from varint.discrete.legendre import velocity_function
from varint.numerics.arrays import over_columns
from varint.results.trajectory import Trajectory
from varint.scene.memory import per_scene
from varint.scene.system import System

if TYPE_CHECKING:
    from varint.codegen.rows import RowFunction

# times the work of forces on the nodes: the quadrature is a rough one
MISSED = 2.0
# of a step: the time of a body that comes to rest is that after the bounces that are left out
WAITED = 1e-3


def keeps_energy(system: System) -> bool:
    """Whether nothing but impacts may change the energy, so that another change tells of a step
    too large.
    """
    s = system.structure
    return s.autonomous and not s.forced


@per_scene
def moves_constraints(system: System) -> bool:
    """Whether what holds the motion may do work."""
    return ca.depends_on(ca.vertcat(system.constraint, system.contact), system.t)


def work_bound(motion: Trajectory) -> np.ndarray:
    """What forces, explicit time and moving constraints can have given until each node at most:
    ∫ |dH/dt| dt, twice for what a quadrature on the nodes may miss.
    """
    system, steps = motion.system, len(motion.u)
    reactions = np.zeros(len(motion))
    if moves_constraints(system):
        reactions = np.einsum("ki,ki->k", motion.reaction_forces, motion.v)
    powers = []
    for shift in (0, -1) if motion.u.size else (0,):  # controls jump at a node
        at = np.clip(np.asarray(motion.k, dtype=int) + shift, 0, max(steps - 1, 0))
        u = motion.u[at].mean(axis=1) if steps and motion.u.shape[2] else np.empty((len(at), 0))
        powers.append(powers_at(system, motion.q, motion.v, u, motion.t, motion.c) + reactions)
    return summed_work(np.abs(powers).max(axis=0), motion.t)


@np.errstate(all="ignore")  # what is not finite is looked at
def powers_at(
    system: System, q: np.ndarray, v: np.ndarray, u: np.ndarray, t: np.ndarray, c: np.ndarray
) -> np.ndarray:
    """F·v − ∂L/∂t of many states, (N,)."""
    return over_columns(_power_function(system), q, v, u, t[:, None], c)[0][:, 0]


@np.errstate(all="ignore")
def summed_work(power: np.ndarray, t: np.ndarray) -> np.ndarray:
    """The bound at every node (…, N) from the sizes of the power there."""
    if not np.isfinite(power).all():
        power = np.nan_to_num(power, nan=0.0, posinf=0.0)
    gained = np.maximum(power[..., 1:], power[..., :-1]) * np.abs(np.diff(t))
    none = np.zeros((*power.shape[:-1], 1))
    return MISSED * np.concatenate([none, np.cumsum(gained, axis=-1)], axis=-1)


@per_scene
def _power_function(system: System) -> ca.Function:
    """(q, v, u, t, c) → F·v − ∂L/∂t."""
    s = system
    power = ca.dot(s.force, s.v) - ca.jacobian(s.lagrangian, s.t)
    return ca.Function("power", [s.q, s.v, s.control, s.t, s.c], [ca.densify(power)], {"cse": True})


@per_scene
def balance_rows(system: System) -> RowFunction | None:
    """(q, p, t, u) → H, F·v − ∂L/∂t as data; None where they have no such form."""
    s, velocity = system, velocity_function(system)
    if not velocity.is_a("SXFunction"):
        return None
    p = ca.SX.sym("p", s.structure.n)
    return _balance(system, p, velocity(s.q, p, s.t, s.c))


@per_scene
def balance_rows_by_velocity(system: System) -> RowFunction | None:
    """(q, v, t, u) → the same."""
    return _balance(system, system.v, system.v)


def _balance(system: System, given: ca.SX, v: ca.SX) -> RowFunction | None:
    """Of what is given beside q, from which v follows."""
    from varint.codegen.rows import row_function_or_none

    s = system
    energy = ca.Function("energy", [s.q, s.v, s.t, s.c], [ca.densify(s.energy)])
    results = [energy(s.q, v, s.t, s.c), _power_function(s)(s.q, v, s.control, s.t, s.c)]
    return row_function_or_none("balance", [s.q, given, s.t, s.control], s.c, results)


def given_by_impacts(motion: Trajectory, times: np.ndarray) -> np.ndarray:
    """Energy that impacts have given, or taken where it is negative, until each time."""
    impacts = [event for event in motion.events if event.contact is not None]
    gains = np.array([0.0, *(event.energy_after - event.energy_before for event in impacts)])
    direction = 1.0 if motion.h > 0 else -1.0
    when = np.array([direction * event.time for event in impacts])
    late = WAITED * abs(motion.h)
    return np.cumsum(gains)[np.searchsorted(when, direction * times + late, side="right")]

"""Runs that went astray without a step that failed: their energy tells."""

from __future__ import annotations

from typing import NamedTuple

import casadi as ca
import numpy as np

from varint.arrays import over_columns
from varint.legendre import velocity_function
from varint.system import System, per_system
from varint.trajectory import Trajectory

SAMPLES = 10
GROSS = 0.25  # of the largest p·v, that is half of the kinetic energy
NOTHING = 1e-6  # of the energy: less is round-off of a scene at rest


class Jump(NamedTuple):
    """The energy at some node is not the one of the start by far."""

    time: float
    before: float
    after: float

    def __str__(self) -> str:
        return (
            f"the energy went from {self.before:.6g} to {self.after:.6g} by t = {self.time:.6g}, which nothing in the"
        )


def keeps_energy(system: System) -> bool:
    """Whether nothing in the scene may change its energy, so that a change tells of a step too large."""
    s = system.structure
    return s.autonomous and not (s.forced or s.degenerate or s.nonholonomic or s.contacts)


@np.errstate(all="ignore")  # what is not finite is looked at
def strayed(energy: np.ndarray, moving: np.ndarray, kicked: np.ndarray, part: float = 1.0) -> np.ndarray:
    """At which nodes (members, nodes) the energy is off by as much as the kinetic energy, or by that part of it."""
    moving, kicked, size = (np.where(np.isfinite(x), np.abs(x), 0) for x in (moving, kicked, energy))
    least = np.maximum(GROSS * moving.max(axis=-1), GROSS * kicked[..., 0])
    least = np.maximum(least, NOTHING * size.max(axis=-1))
    return ~(np.abs(energy - energy[..., :1]) <= part * least[..., None])


def energies(system: System, q: np.ndarray, p: np.ndarray, t: np.ndarray, c: np.ndarray, h: float) -> list[np.ndarray]:
    """Energy, p·v and what a step from rest makes of p·v, at nodes (members, nodes, n)."""
    members, nodes, n = q.shape
    rows = [q.reshape(-1, n), p.reshape(-1, n), np.tile(t, members)[:, None], np.repeat(c, nodes, axis=0)]
    return [x.reshape(members, nodes) for x in over_columns(_energy_of_momentum(system), *rows, np.array([h]))]


def energy_jump(motion: Trajectory) -> Jump | None:
    """The first of ten nodes whose energy error is as large as the kinetic energy, in a scene that conserves energy.

    A step that is much too large can have solutions that are none of the motion's, and an explicit rule beyond its
    limit of stability is finite for long: nothing else tells.
    """
    if not keeps_energy(motion.system) or len(motion) < 2:
        return None
    last, h = len(motion) - 1, np.array((motion.h,))
    q, p, t = motion.q, motion.p, motion.t
    if last >= SAMPLES:
        i = np.arange(SAMPLES) * last // (SAMPLES - 1)
        q, p, t = q[i], p[i], t[i]
    if motion.phase is None:
        found = over_columns(_energy_of_momentum(motion.system), q, p, t[:, None], motion.c, h)
    else:
        v = motion[i].v if last >= SAMPLES else motion.v
        found = over_columns(_energy_function(motion.system), q, v, t[:, None], motion.c, h)
    energy, moving, kicked = (x[:, 0].tolist() for x in found)  # so few that lists are faster than arrays
    before = energy[0]
    largest = max(GROSS * max(moving), GROSS * kicked[0], NOTHING * max(map(abs, energy)))
    for k, after in enumerate(energy):
        if not abs(after - before) <= largest:
            return Jump(float(t[k]), before, after)
    return None


@per_system
def _energy_function(system: System) -> ca.Function:
    """(q, v, t, c, h) → H, p·v, and what a step from rest makes of p·v."""
    s, h = system, ca.SX.sym("h")
    mass = ca.fabs(ca.diag(s.mass_matrix))
    kicked = ca.if_else(mass > 0, (h * ca.gradient(s.lagrangian, s.q)) ** 2 / mass, 0)
    outputs = [s.energy, ca.fabs(ca.dot(s.momentum, s.v)), ca.sum1(kicked)]
    return ca.Function("energy", [s.q, s.v, s.t, s.c, h], [ca.densify(x) for x in outputs], {"cse": True})


@per_system
def _energy_of_momentum(system: System) -> ca.Function:
    """(q, p, t, c, h) → the same."""
    n, velocity = system.structure.n, velocity_function(system)
    symbol = ca.SX.sym if velocity.is_a("SXFunction") else ca.MX.sym
    q, p, t, c, h = (symbol(x, k) for x, k in zip("qptch", (n, n, 1, system.c.numel(), 1), strict=True))
    outputs = _energy_function(system)(q, velocity(q, p, t, c), t, c, h)
    return ca.Function("energy", [q, p, t, c, h], outputs)

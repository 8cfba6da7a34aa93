"""Runs that went astray without a step that failed: their energy tells."""

from __future__ import annotations

import math
from typing import NamedTuple

import casadi as ca
import numpy as np

from varint.discrete.legendre import velocity_function
from varint.numerics.arrays import over_columns
from varint.results.trajectory import Trajectory
from varint.scene.system import System, per_system

SAMPLES = 10
GROSS = 0.25  # of the largest p·v, that is half of the kinetic energy
# of a step: the time of a body that comes to rest is that after the bounces that are left out
WAITED = 1e-3
# times the work of forces on the nodes: the quadrature is a rough one; on nodes that are steps
# apart no more than an explosion can be told
MISSED, HUGE = 2.0, 1e6
NOTHING = 1e-6  # of the energy: less is round-off of a scene at rest


class EnergyJump(NamedTuple):
    """The energy at some node, where q is given, is not the one of the start by far, or no
    number.
    """

    time: float
    before: float
    after: float
    q: np.ndarray

    def alarm(self, h: float) -> str:
        """What is wrong, of a run that came to its end with steps h."""
        return self._undefined() or f"{self._change()}: h = {h:g} is too large, try a smaller one"

    @property
    def cause(self) -> str:
        """The same of a run that failed later."""
        wrong = "h is too large, and steps before this one were wrong already: try a smaller h"
        return self._undefined() or f"{self._change()}: {wrong}"

    def _change(self) -> str:
        before, after = f"{self.before:.6g}", f"{self.after:.6g}"
        return (
            f"the energy went from {before} to {after} by t = {self.time:.6g}, which nothing in "
            "the scene can do"
        )

    def _undefined(self) -> str:
        return (
            ""
            if np.isfinite(self.after)
            else f"the energy is not defined {undefined_at(self.q, self.time)}"
        )


def undefined_at(q: np.ndarray, t: float) -> str:
    """Where something is not defined, how that may be, and what to do."""
    where = ", ".join(f"{x:.6g}" for x in q)
    return (
        f"near q = [{where}] at t = {t:.6g} (a square root or logarithm of a negative number, a "
        "division by zero, an overflow): bound the motion, or try a smaller h"
    )


def keeps_energy(system: System) -> bool:
    """Whether nothing but impacts may change the energy, so that another change tells of a step
    too large.
    """
    s = system.structure
    return s.autonomous and not (s.forced or s.degenerate or s.nonholonomic)


@per_system
def balances_energy(system: System) -> bool:
    """Whether the energy changes by forces and by ∂L/∂t alone, whose work is known: no constraint
    moves.
    """
    s = system
    moved = ca.depends_on(ca.vertcat(s.constraint, s.contact), s.t)
    return not (moved or s.structure.degenerate or s.structure.nonholonomic)


@np.errstate(all="ignore")  # what is not finite is looked at
def nodes_astray(
    energy: np.ndarray, moving: np.ndarray, kicked: np.ndarray, part: float = 1.0
) -> np.ndarray:
    """At which nodes (members, nodes) the energy is off by as much as the kinetic energy, or by
    that part of it.
    """
    moving, kicked, size = (
        np.where(np.isfinite(x), np.abs(x), 0) for x in (moving, kicked, energy)
    )
    least = np.maximum(GROSS * moving.max(axis=-1), GROSS * kicked[..., 0])
    least = np.maximum(least, NOTHING * size.max(axis=-1))
    return ~(np.abs(energy - energy[..., :1]) <= part * least[..., None])


def energies(
    system: System, q: np.ndarray, p: np.ndarray, t: np.ndarray, c: np.ndarray, h: float
) -> list[np.ndarray]:
    """Energy, p·v and what a step from rest makes of p·v, at nodes (members, nodes, n)."""
    members, nodes, n = q.shape
    rows = [
        q.reshape(-1, n),
        p.reshape(-1, n),
        np.tile(t, members)[:, None],
        np.repeat(c, nodes, axis=0),
    ]
    return [
        x.reshape(members, nodes)
        for x in over_columns(_energy_of_momentum(system), *rows, np.array([h]))
    ]


def energy_jump(motion: Trajectory) -> EnergyJump | None:
    """The first of ten nodes whose energy is off its balance by as much as the kinetic energy:
    that of the start and the work of forces and of explicit time.

    A step that is much too large can have solutions that are none of the motion's, and an explicit
    rule beyond its limit of stability is finite for long: nothing else tells.
    """
    conserved = keeps_energy(motion.system)
    if not (conserved or balances_energy(motion.system)) or len(motion) < 2:
        return None
    last, h = len(motion) - 1, np.array((motion.h,))
    q, p, t, i = motion.q, motion.p, motion.t, np.arange(last + 1)
    if last >= SAMPLES:
        i = np.arange(SAMPLES) * last // (SAMPLES - 1)
        q, p, t = q[i], p[i], t[i]
    if motion.active_set is None:
        found = over_columns(_energy_of_momentum(motion.system), q, p, t[:, None], motion.c, h)
    else:
        v = motion[i].v if last >= SAMPLES else motion.v
        found = over_columns(_energy_function(motion.system), q, v, t[:, None], motion.c, h)
    # so few that lists are faster than arrays
    energy, moving, kicked = (x[:, 0].tolist() for x in found)
    if motion.system.structure.contacts:
        energy = (np.array(energy) - _given_by_impacts(motion, t)).tolist()
    before = energy[0]
    largest = max(GROSS * max(moving), GROSS * kicked[0], NOTHING * max(map(abs, energy)))
    given = [0.0] * len(energy) if conserved else _work_bound(motion)[i].tolist()
    known = conserved or not (np.diff(motion.k) > 1).any()
    if not known:  # what forces did between the nodes
        half = range((len(energy) + 1) // 2)  # a scene may begin at rest, with nothing that acts
        largest = max(largest, *(HUGE * max(abs(energy[k]), moving[k], kicked[k]) for k in half))
    if known and len(energy) == SAMPLES:
        largest = min(largest, _where_off_for_good(energy, moving, kicked[0], given))
    for k, after in enumerate(energy):
        if not abs(after - before) <= largest + given[k]:
            return EnergyJump(float(t[k]), before, after, q[k])
    return None


def _where_off_for_good(
    energy: list[float], moving: list[float], kicked: float, given: list[float]
) -> float:
    """What the energy may be off by where it is off at most nodes, which a start at full speed
    hides else; no bound where it is not.
    """
    off = [abs(after - energy[0]) - more for after, more in zip(energy, given, strict=True)]
    if any(map(math.isnan, [*off, *moving])):
        return math.inf
    usual = GROSS * max(_median(moving), NOTHING * max(moving))
    usual = max(usual, NOTHING * max(map(abs, energy)), NOTHING * kicked)
    return usual if _median(off) > usual else math.inf


def _median(x: list[float]) -> float:
    """Of few numbers: in a tenth of the time of `numpy.median`."""
    ordered, half = sorted(x), len(x) // 2
    return (ordered[half] + ordered[~half]) / 2


@np.errstate(all="ignore")  # what is not finite is looked at
def _work_bound(motion: Trajectory) -> np.ndarray:
    """What forces and explicit time can have given until each node at most: ∫ |F·v − ∂L/∂t| dt,
    twice for what a quadrature on the nodes may miss.
    """
    steps = len(motion.u)
    powers = []
    for shift in (0, -1):  # controls jump at a node
        at = np.clip(np.asarray(motion.k, dtype=int) + shift, 0, max(steps - 1, 0))
        u = motion.u[at].mean(axis=1) if steps and motion.u.shape[2] else np.empty((len(at), 0))
        inputs = motion.q, motion.v, u, motion.t[:, None], motion.c
        powers.append(np.abs(over_columns(_power_function(motion.system), *inputs)[0][:, 0]))
    power = np.nan_to_num(np.maximum(*powers), nan=0.0, posinf=0.0)
    gained = np.maximum(power[1:], power[:-1]) * np.abs(np.diff(motion.t))
    return MISSED * np.append(0.0, np.cumsum(gained))


@per_system
def _power_function(system: System) -> ca.Function:
    """(q, v, u, t, c) → dH/dt = F·v − ∂L/∂t."""
    s = system
    power = ca.dot(s.force, s.v) - ca.jacobian(s.lagrangian, s.t)
    return ca.Function("power", [s.q, s.v, s.control, s.t, s.c], [ca.densify(power)], {"cse": True})


def _given_by_impacts(motion: Trajectory, times: np.ndarray) -> np.ndarray:
    """Energy that impacts have given, or taken where it is negative, until each time."""
    impacts = [event for event in motion.events if event.contact is not None]
    gains = np.array([0.0, *(event.energy_after - event.energy_before for event in impacts)])
    direction = 1.0 if motion.h > 0 else -1.0
    when = np.array([direction * event.time for event in impacts])
    late = WAITED * abs(motion.h)
    return np.cumsum(gains)[np.searchsorted(when, direction * times + late, side="right")]


@per_system
def _energy_function(system: System) -> ca.Function:
    """(q, v, t, c, h) → H, p·v, and what a step from rest makes of p·v."""
    s, h = system, ca.SX.sym("h")
    mass = ca.fabs(ca.diag(s.mass_matrix))
    kicked = ca.if_else(mass > 0, (h * ca.gradient(s.lagrangian, s.q)) ** 2 / mass, 0)
    outputs = [s.energy, ca.fabs(ca.dot(s.momentum, s.v)), ca.sum1(kicked)]
    return ca.Function(
        "energy", [s.q, s.v, s.t, s.c, h], [ca.densify(x) for x in outputs], {"cse": True}
    )


@per_system
def _energy_of_momentum(system: System) -> ca.Function:
    """(q, p, t, c, h) → the same."""
    n, velocity = system.structure.n, velocity_function(system)
    symbol = ca.SX.sym if velocity.is_a("SXFunction") else ca.MX.sym
    q, p, t, c, h = (
        symbol(x, k) for x, k in zip("qptch", (n, n, 1, system.c.numel(), 1), strict=True)
    )
    outputs = _energy_function(system)(q, velocity(q, p, t, c), t, c, h)
    return ca.Function("energy", [q, p, t, c, h], outputs)

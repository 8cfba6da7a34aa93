"""Runs that went astray without a step that failed: their energy tells."""

from __future__ import annotations

import math
from functools import cache
from typing import TYPE_CHECKING, NamedTuple

import casadi as ca
import numpy as np

from varint.discrete.legendre import velocity_function
from varint.integration.exchanged_energy import exchanged_energies
from varint.integration.work_bound import (
    given_by_impacts,
    keeps_energy,
    work_bound,
)
from varint.numerics.arrays import median, over_columns
from varint.results.trajectory import Trajectory
from varint.scene.memory import per_scene
from varint.scene.system import System

if TYPE_CHECKING:
    from varint.codegen.rows import RowFunction

SAMPLES = 10  # nodes that are looked at
# more of them from so many steps on, beside which they cost next to nothing
MORE = ((3_000, 30), (30_000, 100))
GOLDEN = (5**0.5 - 1) / 2
GROSS = 0.25  # of the largest p·v, that is half of the kinetic energy
HUGE = 1e6  # times the energy: on nodes that are steps apart no more than an explosion can be told
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


@np.errstate(all="ignore")  # what is not finite is looked at
def nodes_astray(
    energy: np.ndarray,
    moving: np.ndarray,
    kicked: np.ndarray,
    part: float = 1.0,
    given: np.ndarray | float = 0.0,
) -> np.ndarray:
    """At which nodes (members, nodes) the energy is off by as much as the kinetic energy, or by
    that part of it, and by what forces can have given.
    """
    moving, kicked, size = (
        np.where(np.isfinite(x), np.abs(x), 0) for x in (moving, kicked, energy)
    )
    least = np.maximum(GROSS * moving.max(axis=-1), GROSS * kicked[..., 0])
    least = np.maximum(least, NOTHING * size.max(axis=-1))
    return ~(np.abs(energy - energy[..., :1]) <= part * least[..., None] + given)


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


def energies_along(
    system: System, q: np.ndarray, p: np.ndarray, t: np.ndarray, c: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Energy and p·v at nodes (N, n) at their times (N,), or one time for all."""
    f = energy_rows(system)
    if f is None:
        function, times = _energy_of_momentum(system), t if len(t) == 1 else t[:, None]
        found = over_columns(function, q, p, times, c, np.zeros(1))
    else:
        found = f.values(c, q, p, t[:, None])
    return found[0][:, 0], found[1][:, 0]


def energies_by_velocity(
    system: System, rows: np.ndarray, t: np.ndarray, c: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """`energies_along` of nodes (N, 3, n) whose q, p and v are known: without the equations of the
    velocities, which take Newton's method where L is not quadratic in them.
    """
    f = energy_rows_by_velocity(system)
    if f is None:
        return energies_along(system, rows[:, 0], rows[:, 1], t, c)
    found = f.values(c, rows[:, 0], rows[:, 2], t[:, None])
    return found[0][:, 0], found[1][:, 0]


def energy_jump(motion: Trajectory) -> EnergyJump | None:
    """The first of some nodes whose energy is off its balance by as much as the kinetic energy:
    that of the start and the work of forces, of explicit time and of constraints that move.

    A step that is much too large can have solutions that are none of the motion's, and an explicit
    rule beyond its limit of stability is finite for long: nothing else tells.
    """
    if len(motion) < 2:
        return None
    i: np.ndarray | slice = slice(None)  # of few all, without a copy
    if len(motion) > SAMPLES:
        i = nodes_looked_at(len(motion) - 1)
    h, q, p, t = np.array((motion.h,)), motion.q[i], motion.p[i], motion.t[i]
    if motion.system.structure.degenerate:
        energy, moving = exchanged_energies(motion, np.arange(len(motion))[i])
        kicked = np.zeros_like(moving)
    else:
        if motion.active_set is None or not any(x.rows or x.contacts for x in motion.active_sets):
            found = over_columns(_energy_of_momentum(motion.system), q, p, t[:, None], motion.c, h)
        else:
            v = motion.v if isinstance(i, slice) else motion[i].v
            found = over_columns(_energy_function(motion.system), q, v, t[:, None], motion.c, h)
        energy, moving, kicked = (x.reshape(-1) for x in found)
    if motion.events and motion.system.structure.contacts:
        energy = energy - given_by_impacts(motion, t)
    if _is_quiet(energy, NOTHING * _largest(energy)):
        return None
    quiet = NOTHING * max(_largest(energy), _largest(kicked[:1]), GROSS * _largest(moving))
    if _is_quiet(energy, quiet):
        return None
    astray = np.flatnonzero(_off_balance(motion, i, energy, moving, kicked, quiet))
    if not len(astray):
        return None
    k = int(astray[0])
    return EnergyJump(float(t[k]), float(energy[0]), float(energy[k]), q[k])


@np.errstate(all="ignore")  # what is not finite is looked at
def first_jump(motion: Trajectory) -> tuple[Trajectory, EnergyJump] | None:
    """The motion up to the step that leads to another energy, and the jump; None where there is
    none, or energy is not kept, not defined after it or not known at every step.

    What comes later plays no part.
    """
    system = motion.system
    if not keeps_energy(system) or system.structure.contacts or system.structure.degenerate:
        return None
    if motion.active_set is not None or (np.diff(motion.k) != 1).any():
        return None
    q, p, c = motion.q[None], motion.p[None], motion.c[None]
    energy, moving, kicked = (x[0] for x in energies(system, q, p, motion.t, c, motion.h))
    usual = np.maximum(np.maximum.accumulate(np.fmax(moving, 0)), kicked[0])
    astray = ~(np.abs(energy - energy[0]) <= np.maximum(GROSS * usual, NOTHING * abs(energy[0])))
    k = int(np.argmax(astray))
    if not astray.any() or not math.isfinite(energy[k]):
        return None
    jump = EnergyJump(float(motion.t[k]), float(energy[0]), float(energy[k]), motion.q[k])
    return motion[:k], jump


@np.errstate(all="ignore")  # what is not finite is looked at
def _off_balance(
    motion: Trajectory,
    i: np.ndarray | slice,
    energy: np.ndarray,
    moving: np.ndarray,
    kicked: np.ndarray,
    quiet: float,
) -> np.ndarray:
    """At which of the nodes i the energy is off its balance; changes below `quiet` are nothing."""
    change = np.abs(energy - energy[0])
    moving = np.where(np.isfinite(moving), moving, 0)
    largest = max(GROSS * moving.max(), GROSS * _largest(kicked[:1]), quiet)
    usual = max(GROSS * median(moving), quiet)
    conserved = keeps_energy(motion.system)
    if (change <= min(largest, usual)).all():
        return np.zeros(len(energy), dtype=bool)
    given = np.zeros(len(energy)) if conserved else work_bound(motion)[i]
    known = conserved or not (np.diff(motion.k) > 1).any()
    if not known:  # what forces did between the nodes
        half = slice((len(energy) + 1) // 2)  # a scene may begin at rest, with nothing that acts
        sizes = (_largest(x[half]) for x in (energy, moving, kicked))
        largest = max(largest, HUGE * max(sizes))
    if known and len(energy) >= SAMPLES and median(change - given) > usual:
        largest = min(largest, usual)  # off for good: a start at full speed hides it else
    return ~(change <= largest + given)


def _is_quiet(energy: np.ndarray, quiet: float) -> bool:
    """Whether no change since the start is above this."""
    first, *others = energy.tolist()
    return all(abs(x - first) <= quiet for x in others)


def _largest(x: np.ndarray) -> float:
    """The largest size among the numbers."""
    sizes = [abs(size) for size in x.tolist()]  # a hundred at most: faster than an array
    if not math.isfinite(sum(sizes)):
        sizes = [size for size in sizes if math.isfinite(size)]
    return max(sizes, default=0.0)


@cache
def places_looked_at(count: int) -> np.ndarray:
    """So many places in [0, 1], both ends among them: multiples of the golden ratio, for evenly
    spaced nodes may meet every turn of a motion at the same place.
    """
    return np.append(np.sort(np.arange(count - 1) * GOLDEN % 1), 1.0)


def nodes_looked_at(last: int) -> np.ndarray:
    """Of the nodes 0 … last those whose energy is looked at."""
    if last < SAMPLES:
        return np.arange(last + 1)
    count = max([SAMPLES, *(count for steps, count in MORE if last >= steps)])
    return (places_looked_at(count) * last).astype(int)


@per_scene
def _energy_function(system: System) -> ca.Function:
    """(q, v, t, c, h) → H, p·v, and what a step from rest makes of p·v."""
    s, h = system, ca.SX.sym("h")
    mass = ca.fabs(ca.diag(s.mass_matrix))
    kicked = ca.if_else(mass > 0, (h * ca.gradient(s.lagrangian, s.q)) ** 2 / mass, 0)
    outputs = [s.energy, ca.fabs(ca.dot(s.momentum, s.v)), ca.sum1(kicked)]
    return ca.Function(
        "energy", [s.q, s.v, s.t, s.c, h], [ca.densify(x) for x in outputs], {"cse": True}
    )


@per_scene
def energy_rows(system: System) -> RowFunction | None:
    """(q, p, t) → H, p·v as data; None where they have no such form."""
    from varint.codegen.rows import row_function_or_none

    s, velocity = system, velocity_function(system)
    if not velocity.is_a("SXFunction"):
        return None
    p = ca.SX.sym("p", s.structure.n)
    v = velocity(s.q, p, s.t, s.c)
    energy = ca.Function("energy", [s.q, s.v, s.t, s.c], [ca.densify(s.energy)])
    results = [energy(s.q, v, s.t, s.c), ca.fabs(ca.dot(p, v))]
    return row_function_or_none("energy", [s.q, p, s.t], s.c, results)


@per_scene
def energy_rows_by_velocity(system: System) -> RowFunction | None:
    """(q, v, t) → H, p·v as data; None where they have no such form."""
    from varint.codegen.rows import row_function_or_none

    s = system
    results = [ca.densify(s.energy), ca.densify(ca.fabs(ca.dot(s.momentum, s.v)))]
    return row_function_or_none("energy", [s.q, s.v, s.t], s.c, results)


@per_scene
def _energy_of_momentum(system: System) -> ca.Function:
    """(q, p, t, c, h) → the same."""
    n, velocity = system.structure.n, velocity_function(system)
    symbol = ca.SX.sym if velocity.is_a("SXFunction") else ca.MX.sym
    q, p, t, c, h = (
        symbol(x, k) for x, k in zip("qptch", (n, n, 1, system.c.numel(), 1), strict=True)
    )
    outputs = _energy_function(system)(q, velocity(q, p, t, c), t, c, h)
    return ca.Function("energy", [q, p, t, c, h], outputs)

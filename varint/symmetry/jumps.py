"""Places where a Lagrangian jumps: a symmetry leaves them where they are.

A step of the potential has no slope, so that δL vanishes on either side of it whatever moves across
it. What jumps is found by its operations: conditions, signs, roundings, each at the zeros of a
switch σ(q, v, t). Points are brought onto these, and L is compared on both sides, twice as near the
second time: a difference that stays is a jump. There a symmetry must have
∂σ/∂q·ξ + ∂σ/∂v·ξ̇ − τ ∂σ/∂t = 0.
"""

from __future__ import annotations

from typing import NamedTuple

import casadi as ca
import numpy as np

from varint.numerics.arrays import over_columns
from varint.numerics.operations import KINKS, WITH_STEPS, operation, operations_of
from varint.scene.memory import per_system
from varint.scene.system import System
from varint.symmetry.sampling import Region, at_points, draw, join_points, lively_points

POINTS = 60  # tried at a switch, of each kind
NEWTON = 30  # corrections onto a switch
NEAR = 1e-6, 1e-8  # of a point's size: how far from the switch L is looked at
STAYS = 0.5  # of a difference, a hundred times nearer, that is a jump
LEAST = 1e-9  # of L: less is round-off


class Switch(NamedTuple):
    """What an operation changes with: at the zeros of `sigma`, or at its whole numbers."""

    sigma: ca.SX
    whole: bool


class Jumps(NamedTuple):
    """Switches across which L jumps, and how many could not be looked at."""

    at: tuple[ca.SX, ...]
    unseen: int


def jumps(region: Region, rng: np.random.Generator) -> Jumps:
    """Where the Lagrangian jumps."""
    found, unseen = [], 0
    for switch in switches(region.system):
        here = _jumps_at(region, switch, rng)
        unseen += here is None
        if here:
            found.append(switch.sigma)
    return Jumps(tuple(found), unseen)


@per_system
def switches(system: System) -> tuple[Switch, ...]:
    """The switches of the Lagrangian that coordinates, velocities or time decide."""
    s = system
    symbols = [s.q, s.v, s.t, s.c]
    f = ca.Function("whole", symbols, [ca.densify(s.lagrangian)], {"cse": True})
    if not any(f.instruction_id(k) in _STEPS for k in range(f.n_instructions())):
        return ()
    work: list[ca.SX] = []
    found: dict[int, Switch] = {}
    for name, *taken in operations_of(f).nodes:
        if name == "const":
            work.append(ca.SX(taken[0]))
        elif name == "input":
            work.append(symbols[taken[0]][taken[1]])
        else:
            given = [work[i] for i in taken]
            work.append(operation(name, *given))
            switch = _switch(name, *given)
            if switch and ca.depends_on(switch.sigma, ca.vertcat(s.q, s.v, s.t)):
                found[switch.sigma.element_hash()] = switch
    return tuple(found.values())


_STEPS = {getattr(ca, f"OP_{name.upper()}") for name in WITH_STEPS - KINKS}


def _switch(name: str, a: ca.SX, b: ca.SX | None = None) -> Switch | None:
    """What an operation of a and b changes with, if it jumps; equality holds nowhere near."""
    if name in ("lt", "le"):
        return Switch(a - b, False)
    if name in ("sign", "floor", "ceil"):
        return Switch(a, name != "sign")
    if name == "copysign":
        return Switch(b, False)
    if name in ("fmod", "remainder"):
        return Switch(a / b + (0.5 if name == "remainder" else 0), True)
    return None


def _jumps_at(region: Region, switch: Switch, rng: np.random.Generator) -> bool | None:
    """Whether L jumps at a switch; None where no point of it was found."""
    s = region.system
    z = ca.vertcat(s.q, s.v, s.t)
    slope = ca.gradient(switch.sigma, z)
    level = at_points(s, "switch", [switch.sigma, slope])
    value = at_points(s, "lagrangian", [s.lagrangian, _size(s)])
    points = join_points(draw(region, POINTS, rng), lively_points(region, POINTS, rng))
    n, columns = s.structure.n, points.columns

    def at(function: ca.Function, z: np.ndarray, rows: np.ndarray | slice) -> list[np.ndarray]:
        _, _, a, u, _, c = columns
        q, v, t = (np.ascontiguousarray(x) for x in np.split(z, [n, 2 * n], axis=1))
        return over_columns(function, q, v, a[rows], u[rows], t, c[rows])

    with np.errstate(all="ignore"):  # what is not finite is no point of the switch
        z0 = np.concatenate([columns[0], columns[1], columns[4]], axis=1)
        sigma, _ = at(level, z0, slice(None))
        goal = np.round(sigma) if switch.whole else np.zeros_like(sigma)
        for _ in range(NEWTON):
            sigma, by_z = at(level, z0, slice(None))
            norm = (by_z**2).sum(axis=1, keepdims=True)
            z0 = z0 - np.where(norm > 0, (sigma - goal) / norm, np.nan) * by_z
        rows = np.flatnonzero(np.isfinite(z0).all(axis=1))
        if not len(rows):
            return None
        z0 = z0[rows]
        _, by_z = at(level, z0, rows)
        step = by_z / np.linalg.norm(by_z, axis=1, keepdims=True)
        step *= np.abs(z0).max(axis=1, keepdims=True)
        far, near = (
            np.abs(at(value, z0 + x * step, rows)[0] - at(value, z0 - x * step, rows)[0])
            for x in NEAR
        )
        size = at(value, z0 + NEAR[0] * step, rows)[1]
        seen = np.isfinite(far) & np.isfinite(near) & np.isfinite(size)
        if not seen.any():
            return None
        return bool((seen & (near > STAYS * far) & (near > LEAST * size)).any())


def _size(s: System) -> ca.SX:
    return ca.fabs(s.lagrangian) + ca.sum1(ca.fabs(s.momentum * s.v))


def moved(system: System, jump: ca.SX, xi: ca.SX, tau: ca.SX) -> ca.SX:
    """How fast a generator ξ + τ v moves a switch: ∂σ/∂q·ξ + ∂σ/∂v·ξ̇ − τ ∂σ/∂t."""
    s = system
    rate = ca.jtimes(xi, s.q, s.v) + ca.jacobian(xi, s.t)
    change = ca.jtimes(jump, s.q, xi) + ca.jtimes(jump, s.v, rate)
    return change - tau * ca.jacobian(jump, s.t)

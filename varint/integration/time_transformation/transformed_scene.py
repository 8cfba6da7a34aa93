"""Scenes in fictitious time τ, dt = σ dτ: ordinary systems, so that every rule and stepper applies.

Where the energy is E0 all along, the Lagrangian ``L̂(q, q') = σ(q) (L(q, q'/σ) + E0)`` has the same
paths on that level and the same momenta (Sundman; Hairer, Lubich & Wanner, Geometric Numerical
Integration, VIII.2: the Poincaré transform σ (H − E0)). The physical time is one more coordinate,
with ``w (½ (t' − σ)² + σ0 t')`` added to L̂: its momentum w (t' − σ + σ0) is conserved and starts as
w σ0, so t' = σ and the other equations do not notice. What round-off leaves of t' − σ acts on them
by w ∂σ/∂q: the weight w is small beside the energies of scenes of molecules in metres.

Over forces and explicit time the energy is kept account of. In ``L̂ = σ L(q, q'/σ, t) + (t' − σ)
s'`` the rate of a further coordinate s holds t' = σ, and is the momentum of t: −E, as in the
extended phase space, where the Poincaré transform is σ(q, t) (H(q, p, t) − E). The scene's forces
do the work σ F·v on it beside σ F on q. Without forces the steps are symplectic in all of that.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import casadi as ca

from varint.integration.time_transformation.flight_rate import INITIAL_ENERGY
from varint.integration.time_transformation.local_rate import SLOWEST_RATE
from varint.integration.work_bound import keeps_energy
from varint.scene.parameters import Parameters
from varint.scene.system import System, coordinates

# names that no scene of a user's has; σ0 t', and σ0 s', change no motion, but round-off in t' − σ
# has a momentum to compare with
TIME, HOLDS_TIME, SLOWEST = "physical time", "energy over time", SLOWEST_RATE.name()
BEGIN, ENERGY, START = "start time", "initial energy", "initial time scale"
WEIGHT = "weight of time"
FAINT = 1e-6  # of an energy over a time scale: beside it round-off of the time would be seen


@dataclass(frozen=True, eq=False)
class TransformedScene:
    """A scene in fictitious time: coordinates (q, t), or (q, s, t) where the energy is kept account
    of; parameters (c, weight of time, slowest rate, E0, σ0), there with the start's t0 for weight.

    Attributes
    ----------
    system : System
    translate : callable
        Expression of q, v, t, c of the original scene → the same in symbols of the rescaled one;
        without an account of energy its time begins at zero.
    energy : Function
        (q, v, t, c, slowest rate) → energy E0, and σ.
    weight : Function
        (q, v, t, c, slowest rate) → w at the start: a power of two, which rounds nothing, where
        energies are very small, else one.
    accounts : bool
        Whether the energy is kept account of.
    """

    system: System
    translate: Callable[[ca.SX], ca.SX]
    energy: ca.Function
    weight: ca.Function
    accounts: bool


def in_time_scale(system: System, sigma: ca.SX) -> TransformedScene:
    """The scene with a time scale σ(q, c), of t, too, where the scene depends on it."""
    accounts, n = not keeps_energy(system), system.q.numel()
    begin = {BEGIN: 0.0} if accounts else {WEIGHT: 1.0}
    params = Parameters(**system.defaults, **begin, **{SLOWEST: 0.0, ENERGY: 0.0, START: 1.0})
    q, v = coordinates(*system.names, *[HOLDS_TIME] * accounts, TIME)
    clock = q[-1] + getattr(params, BEGIN) if accounts else q[-1]
    symbols = [system.q, system.c, SLOWEST_RATE, INITIAL_ENERGY, system.t]
    constants = (ca.vec(getattr(params, name)) for name in system.defaults)
    own = [q[:n], ca.vertcat(ca.SX(0, 1), *constants)]
    own += [getattr(params, SLOWEST), getattr(params, ENERGY), clock]
    (scale,) = ca.substitute([sigma], symbols, own)
    before, after = [*symbols, system.v], [*own, v[:n] / scale]

    def translate(expression: ca.SX) -> ca.SX:
        return ca.substitute([expression], before, after)[0]

    lagrangian, start = translate(system.lagrangian), getattr(params, START)
    if accounts:
        lagrangian = scale * lagrangian + (v[n + 1] - scale + start) * v[n]
        push = translate(system.force)
        work = ca.dot(push, v[:n])
        force = ca.vertcat(scale * push, ca.SX(1, 1), -work) if system.structure.forced else None
    else:
        force = None
        lagrangian = scale * (lagrangian + getattr(params, ENERGY))
        lagrangian += getattr(params, WEIGHT) * ((v[n] - scale) ** 2 / 2 + start * v[n])
    rows = translate(system.nonholonomic)
    rows = ca.horzcat(rows, ca.SX(rows.shape[0], q.numel() - n))
    new = System(
        q,
        v,
        lagrangian,
        constraint=translate(system.constraint),
        nonholonomic=rows,
        force=force,
        params=params,
    )
    inputs = [system.q, system.v, system.t, system.c, SLOWEST_RATE]
    (scale,) = ca.substitute([sigma], [INITIAL_ENERGY], [system.energy])
    energy = ca.Function("start_energy", inputs, [system.energy, scale])
    large = ca.fmax(ca.fabs(ca.dot(system.momentum, system.v)), ca.fabs(system.energy)) / scale
    known = ca.logic_and(large > 0, large <= FAINT)
    near = 2 ** ca.floor(ca.log(ca.if_else(known, large, 1.0)) / math.log(2))
    weight = ca.Function("weight", inputs, [ca.densify(near)])
    return TransformedScene(new, translate, energy, weight, accounts)


def level_of(scene: TransformedScene, q: Any, p: Any, v: Any, c: Any) -> tuple[Any, Any]:
    """What is E0 all along, at coordinates, momenta and velocities of the rescaled scene: the
    energy, less what forces and explicit time have given; and its size |p·dq/dt|.
    """
    accounts = scene.accounts
    n, many = q.numel() - 1 - accounts, c.numel() - 4
    t = q[-1] + c[many] if accounts else ca.DM.zeros(1)
    energy, _ = scene.energy(q[:n], v[:n] / v[-1], t, c[:many], c[-3])
    given = -p[-1] - c[-2] if accounts else 0
    return energy - given, ca.fabs(ca.dot(p[:n], v[:n]) / v[-1])
